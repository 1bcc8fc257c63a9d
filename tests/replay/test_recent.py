"""What has just happened is found in the ledger alone."""

from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.events import OrderCreated
from ledger.events.orders import OfOrder
from ledger.evolve import fold
from ledger.state import Fleet
from ledger.store import MemoryLedger
from replay.recent import Recent
from replay.story import tell
from tests.histories import histories
from tests.strategies import SCENE


@given(events=histories(min_events=5), looks=st.lists(st.integers(0, 200), min_size=1, max_size=6))
@settings(max_examples=50, deadline=None)
def test_ended_orders_are_those_that_have_left_the_state(events: list, looks: list[int]) -> None:
    recent = Recent(MemoryLedger(events).read)
    for look in looks:
        position = look % (len(events) + 1)
        then = events[:position]
        made = {e.order for e in then if isinstance(e, OrderCreated)}
        ended = recent.finished(SCENE, position, 1_000)
        assert {o.id for o in ended} == made - set(fold(Fleet(), then).orders)
        assert [o.created_ms for o in ended] == sorted((o.created_ms for o in ended), reverse=True)
        assert recent.finished(SCENE, position, 1) == ended[:1]


@given(events=histories(min_events=5), looks=st.lists(st.integers(0, 200), min_size=1, max_size=6))
@settings(max_examples=50, deadline=None)
def test_a_story_grows_with_the_ledger_and_leads_to_the_orders_state(
    events: list, looks: list[int]
) -> None:
    recent = Recent(MemoryLedger(events).read)
    of_orders = [e for e in events if isinstance(e, OfOrder)]
    for look in sorted(looks):
        position = look % (len(events) + 1)
        for order in {e.order for e in of_orders}:
            story = recent.story(order, position)
            said = [e.position for e in of_orders if e.order == order]
            assert {e.position for e in story} >= {p for p in said if p <= position}
            told = tell(order, story)
            assert told is None or len(told.events) == len(story)


def test_a_position_of_another_scene_has_nothing_to_show() -> None:
    assert Recent(MemoryLedger(()).read).finished(SCENE, 0, 10) == []
