from itertools import islice

from ledger.events import EVENTS, CallbackGivenUp, CallbacksConfigured, SceneRemoved
from tests.histories import happenings, history


def test_histories_hold_every_event_that_changes_the_state() -> None:
    """Guard of all laws over histories: what never happens in them is not tested by them."""
    happened = {type(event) for seed in range(4) for event in islice(happenings(seed), 4_000)}
    # nothing could happen after the first; tests of callbacks put in the others themselves
    last = {SceneRemoved, CallbacksConfigured, CallbackGivenUp}
    assert happened == {kind for kind in EVENTS if EVENTS[kind] != "access"} - last


def test_a_shorter_history_is_the_beginning_of_a_longer_one() -> None:
    assert history(5, 400)[:100] == history(5, 100)
