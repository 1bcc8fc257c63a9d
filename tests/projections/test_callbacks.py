import json

from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.events import (
    AnyEvent,
    CallbacksConfigured,
    OrderCancelled,
    OrderFinished,
    OrderSealed,
    OrderWithdrawn,
    SceneRenamed,
)
from ledger.state import Fleet, OrderKind
from projections.callbacks import Callback, Telling
from tests.commands.site import ORDER, R1, SCENE, assigned, created, finished, opened, started, task
from tests.projections.told import ALL, OPENED, URLS, expected, fleet_at, heard, told_history
from tests.scenario import happened, stamped

configs = st.builds(
    CallbackConfig,
    enabled=st.booleans(),
    statuses=st.lists(st.sampled_from(CallbackStatus), max_size=3, unique=True).map(tuple),
    urls=st.lists(st.sampled_from(URLS), max_size=2, unique=True).map(tuple),
)
changes = st.dictionaries(st.integers(OPENED, 90), configs, min_size=1, max_size=4)


def told(events: list[AnyEvent], fleet: Fleet | None = None) -> list[Callback]:
    telling = Telling(fleet or Fleet())
    return [c for e in events[telling.position :] for c in telling.take(e)]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**16), changes)
def test_all_changes_are_told_in_order_as_was_settled_then(
    seed: int, changes: dict[int, CallbackConfig]
) -> None:
    events = told_history(seed, 100, changes)
    assert heard(told(events)) == list(expected(events))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**16), changes, st.integers(0, 100))
def test_a_fold_begun_anywhere_tells_the_same(
    seed: int, changes: dict[int, CallbackConfig], position: int
) -> None:
    events = told_history(seed, 100, changes)
    later = told(events, fleet_at(events, position))
    whole = [c for c in told(events) if c.position > position]
    assert heard(later) == heard(whole)
    assert [c.id for c in later] == [c.id for c in whole]


@given(st.integers(0, 2**16))
@settings(max_examples=20, deadline=None)
def test_no_two_callbacks_have_one_id(seed: int) -> None:
    callbacks = told(told_history(seed, 100, {OPENED: ALL}))
    assert len({c.id for c in callbacks}) == len(callbacks)


def story(*events: AnyEvent) -> list[dict[str, object]]:
    """Bodies for one address, of a scene whose callbacks are enabled at once."""
    config = CallbackConfig(enabled=True, urls=(URLS[0],))
    past = [*opened(R1), CallbacksConfigured(scene=SCENE, callbacks=config)]
    telling = Telling(happened(past))
    bodies = []
    for event in events:
        position = telling.position + 1
        of_event = telling.take(stamped(event, position, 1000 + position, "alice", event.command))
        bodies += [json.loads(callback.body) for callback in of_event]
    return bodies


def words(*events: AnyEvent) -> list[tuple[object, object, object]]:
    return [(b["previousStatus"], b["status"], b["robotName"]) for b in story(*events)]


def test_a_body_says_all_that_a_receiver_needs() -> None:
    body = story(created(external_id="W-7"))[0]
    assert len(str(body.pop("id"))) == 32
    assert body == {
        "type": "OrderStatus",
        "sceneId": SCENE,
        "sceneName": "site",
        "orderId": ORDER,
        "externalId": "W-7",
        "status": "ToBeAllocated",
        "previousStatus": None,
        "robotName": None,
        "at": 1005,
        "position": 5,
    }


def test_a_sealed_order_is_never_pending_for_others() -> None:
    life = created(ORDER, task()), assigned(), started(), finished()
    assert words(*life, OrderFinished(scene=SCENE, order=ORDER)) == [
        (None, "ToBeAllocated", None),
        ("ToBeAllocated", "Allocated", R1),
        ("Allocated", "Executing", R1),
        ("Executing", "Done", R1),
    ]


def test_an_order_that_waits_for_steps_is_pending_until_sealed() -> None:
    life = created(ORDER, task(), sealed=False), assigned(), started(), finished()
    sealed = OrderSealed(scene=SCENE, order=ORDER), OrderFinished(scene=SCENE, order=ORDER)
    assert words(*life, *sealed)[3:] == [("Executing", "Pending", R1), ("Pending", "Done", R1)]


def test_what_is_on_the_way_is_told_just_before() -> None:
    withdrawn = OrderWithdrawn(scene=SCENE, order=ORDER, robot=R1, reason="better")
    gone = OrderCancelled(scene=SCENE, order=ORDER)
    assert words(created(ORDER, task()), assigned(), withdrawn, gone)[2:] == [
        ("Allocated", "Withdrawing", R1),
        ("Withdrawing", "ToBeAllocated", None),
        ("ToBeAllocated", "Cancelling", None),
        ("Cancelling", "Cancelled", None),
    ]


def test_orders_that_the_system_makes_for_itself_are_told_to_nobody() -> None:
    own = created(ORDER, task(), kind=OrderKind.PARKING)
    assert story(own, assigned(), OrderCancelled(scene=SCENE, order=ORDER)) == []


def test_the_scene_is_named_as_it_is_called_by_then() -> None:
    renamed = SceneRenamed(scene=SCENE, name="hall", display_order=1)
    assert [body["sceneName"] for body in story(renamed, created())] == ["hall"]
