import msgspec

from commands.access import RecordAccess
from commands.decide import decide
from ledger.events import AccessRefused, SignedIn
from ledger.evolve import fold
from ledger.ids import CommandId, SceneId
from ledger.state import Fleet

EVENTS = (
    SignedIn(scene=SceneId(""), user="anna", address="10.0.0.1"),
    AccessRefused(
        scene=SceneId(""), caller="eve", address="10.0.0.2", call="GET /", code="errForbidden"
    ),
)


def test_what_happened_to_access_is_stated_as_told_and_changes_no_state() -> None:
    command = RecordAccess(id=CommandId("c"), by="anna", at_ms=1, events=EVENTS)

    decision = decide(Fleet(), command)

    assert decision.events == EVENTS
    before = msgspec.json.encode(Fleet())
    assert msgspec.json.encode(fold(Fleet(), decision.events)) == before
