from hypothesis import given
from hypothesis import strategies as st

from fleetledger.access.refusals import CALL_CHARS_MAX, KINDS_MAX, REST, Refusals

_texts = st.text(max_size=3)
_refused = st.tuples(_texts, _texts, _texts, st.sampled_from(["errNotSignedIn", "errForbidden"]))


def test_alike_ones_are_one_event_with_their_number() -> None:
    refusals = Refusals()
    for _ in range(1_000):
        refusals.refused("wms", "10.0.0.1", "GET /metrics", "errForbidden")
    refusals.refused("wms", "10.0.0.2", "GET /metrics", "errForbidden")

    first, second = refusals.taken()

    assert (first.address, first.count) == ("10.0.0.1", 1_000)
    assert (second.address, second.count) == ("10.0.0.2", 1)
    assert refusals.taken() == ()


@given(st.lists(_refused, max_size=300))
def test_none_is_lost_from_the_count(calls: list[tuple[str, str, str, str]]) -> None:
    refusals = Refusals()
    for call in calls:
        refusals.refused(*call)

    assert sum(event.count for event in refusals.taken()) == len(calls)


def test_a_flood_of_different_ones_is_few_events() -> None:
    refusals = Refusals()
    for number in range(50_000):
        address = f"10.0.{number % 999}.1"
        refusals.refused(f"guess{number}", address, "x" * 10_000, "errNotSignedIn")

    events = refusals.taken()

    assert len(events) <= 2 * KINDS_MAX + 1
    assert sum(event.count for event in events) == 50_000
    assert max(len(event.call) for event in events) == CALL_CHARS_MAX
    assert any(event.address == REST for event in events)


def test_one_address_does_not_hide_the_others() -> None:
    refusals = Refusals()
    for number in range(10_000):
        refusals.refused(f"guess{number}", "10.0.0.1", "GET /", "errNotSignedIn")
    refusals.refused("wms", "10.0.0.2", "GET /metrics", "errForbidden")

    assert ("wms", "10.0.0.2") in {(event.caller, event.address) for event in refusals.taken()}
