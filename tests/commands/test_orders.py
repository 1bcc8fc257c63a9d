import pytest

from commands.orders import (
    CancelAllOrders,
    CancelOrder,
    CancelOrders,
    CreateOrder,
    PrioritiseOrders,
    RetryOrders,
    SealOrder,
    SealOrders,
)
from commands.rejected import Reason
from ledger.events import (
    OrderCancelled,
    OrderCreated,
    OrderFaulted,
    OrderFinished,
    OrderPrioritised,
    OrderRetried,
    OrderSealed,
)
from ledger.ids import OrderId, RobotName, SceneId
from ledger.state import OrderKind, StepTask
from tests.commands.site import (
    BINS,
    ORDER,
    R1,
    SCENE,
    SECOND,
    assigned,
    created,
    finished,
    opened,
    started,
    task,
)
from tests.scenario import ask, given

UNKNOWN = OrderId("TO20250806-000777")
LOAD = StepTask(location=BINS[0], arguments='{"binTask":"Load"}', loads=True, withdrawable=True)
UNLOAD = StepTask(location=BINS[1], arguments='{"binTask":"Unload"}', unloads=True)


def create(*tasks: StepTask, **fields: object) -> object:
    return ask(CreateOrder, scene=SCENE, tasks=tasks, **fields)


def test_an_order_that_carries_names_its_container_and_key_locations_by_itself() -> None:
    command = create(LOAD, UNLOAD, sealed=True)
    event = created(
        ORDER, LOAD, UNLOAD, key_locations=BINS, container="container-TO20250806-000001"
    )
    given(*opened()).when(command).then(event)


def test_an_order_that_only_moves_has_no_container() -> None:
    event = created(ORDER, task(), key_locations=("AP110",), sealed=False)
    given(*opened()).when(create(task())).then(event)


def test_what_the_client_named_is_kept() -> None:
    fields = {
        "external_id": "x" * 50,
        "priority": 2**31 - 1,
        "wanted_robots": (R1,),
        "wanted_groups": ("AMR",),
        "container": "C7",
        "container_type": "pallet",
        "container_heading_rad": 1.5,
        "key_locations": ("AP125",),
    }
    event = created(ORDER, LOAD, sealed=False, **fields)
    given(*opened(R1)).when(create(LOAD, **fields)).then(event)


def test_an_open_order_needs_only_a_key_location_which_may_be_a_bin() -> None:
    event = created(ORDER, sealed=False, key_locations=(BINS[0],))
    given(*opened()).when(create(key_locations=(BINS[0],))).then(event)


@pytest.mark.parametrize(
    ("command", "reason", "word"),
    [
        (create(), Reason.ORDER_WITHOUT_GOAL, "keyLocations"),
        (create(key_locations=("AP110",), sealed=True), Reason.ORDER_NO_STEPS, "steps"),
        (create(key_locations=("AP9",)), Reason.LOCATION_UNKNOWN, "keyLocations[0]"),
        (create(task(), task("AP9")), Reason.LOCATION_UNKNOWN, "steps[1].location"),
        (create(task(), external_id="x" * 51), Reason.EXTERNAL_ID_TOO_LONG, "externalId"),
        (create(task(), priority=2**31), Reason.PRIORITY_INVALID, "priority"),
        (create(task(), wanted_robots=("R9",)), Reason.ROBOT_UNKNOWN, "expectedRobotNames"),
        (create(task(), wanted_groups=("big",)), Reason.GROUP_UNKNOWN, "expectedRobotGroups"),
        (create(task(), container_type="box"), Reason.CONTAINER_TYPE_UNKNOWN, "containerTypeName"),
        (create(task(loads=True, unloads=True)), Reason.STEP_LOADS_AND_UNLOADS, "steps[0]"),
        (create(task(arguments='{"binTask":"Load"}')), Reason.BIN_TASK_NEEDS_BIN, "AP110"),
        (create(task(BINS[0], arguments='{"binTask":"Lift"}')), Reason.BIN_TASK_UNKNOWN, "Lift"),
        (create(task(BINS[0], arguments='{"binTask":7}')), Reason.ARGUMENTS_INVALID, "rbkArgs"),
        (create(*[task()] * 1001), Reason.TOO_MANY, "steps"),
        (ask(CreateOrder, scene=SceneId(" ")), Reason.SCENE_BLANK, "sceneId"),
        (ask(CreateOrder, scene=SceneId("S")), Reason.SCENE_UNKNOWN, "S"),
    ],
)
def test_an_order_against_the_rules_is_refused(command: object, reason: Reason, word: str) -> None:
    given(*opened(R1)).when(command).rejected(reason, word)


def test_an_operation_may_be_asked_for_at_a_point() -> None:
    asked = task(arguments='{"operation":"Load"}', loads=True)
    outcome = given(*opened()).when(create(asked))
    assert outcome.then(*outcome.decision.events).orders[ORDER].steps[0].task == asked


def test_sealing_an_order_that_still_has_something_to_do_only_seals_it() -> None:
    order = created(ORDER, task(), sealed=False)
    given(*opened(), order).when(ask(SealOrder, order=ORDER)).then(
        OrderSealed(scene=SCENE, order=ORDER)
    )


def test_sealing_an_order_whose_steps_are_all_done_finishes_it() -> None:
    order = created(ORDER, task(), sealed=False)
    story = given(*opened(R1), order, assigned(), started(), finished())
    fleet = story.when(ask(SealOrder, order=ORDER)).then(
        OrderSealed(scene=SCENE, order=ORDER), OrderFinished(scene=SCENE, order=ORDER)
    )
    assert not fleet.orders


def test_a_faulted_order_is_finished_by_its_retry_not_by_its_seal() -> None:
    order = created(ORDER, task(), sealed=False)
    fault = OrderFaulted(scene=SCENE, order=ORDER, reason="x")
    sealed = OrderSealed(scene=SCENE, order=ORDER)
    past = (*opened(R1), order, assigned(), started(), finished(), fault)
    given(*past).when(ask(SealOrder, order=ORDER)).then(sealed)
    given(*past, sealed).when(ask(RetryOrders, orders=(ORDER,))).then(
        OrderRetried(scene=SCENE, order=ORDER), OrderFinished(scene=SCENE, order=ORDER)
    )


def test_sealing_twice_nothing_or_the_unknown_is_refused() -> None:
    empty = created(ORDER, sealed=False, key_locations=("AP110",))
    given(*opened(), empty).when(ask(SealOrder, order=ORDER)).rejected(Reason.ORDER_NO_STEPS)
    sealed = created(ORDER, task())
    given(*opened(), sealed).when(ask(SealOrder, order=ORDER)).rejected(Reason.ORDER_SEALED)
    given(*opened()).when(ask(SealOrder, order=ORDER)).rejected(Reason.ORDER_UNKNOWN, ORDER)
    gone = (sealed, OrderCancelled(scene=SCENE, order=ORDER))
    given(*opened(), *gone).when(ask(SealOrder, order=ORDER)).rejected(Reason.ORDER_TERMINAL)


def test_a_batch_of_seals_does_what_it_can() -> None:
    past = (*opened(), created(ORDER, task(), sealed=False), created(SECOND, task()))
    asked = ask(SealOrders, orders=(SECOND, ORDER, UNKNOWN, ORDER))
    outcome = given(*past).when(asked)
    outcome.then(OrderSealed(scene=SCENE, order=ORDER))
    assert {k: v.reason for k, v in outcome.decision.refused.items()} == {
        SECOND: Reason.ORDER_SEALED,
        UNKNOWN: Reason.ORDER_UNKNOWN,
    }


def test_a_live_order_can_be_cancelled_and_a_finished_one_is_left_alone() -> None:
    cancelled = OrderCancelled(scene=SCENE, order=ORDER)
    past = (*opened(R1), created(ORDER, task()))
    asked = ask(CancelOrder, scene=SCENE, order=ORDER)
    given(*past, assigned(), started()).when(asked).then(cancelled)
    given(*past, cancelled).when(asked).nothing()


def test_an_unknown_order_or_one_of_another_scene_cannot_be_cancelled() -> None:
    past = (*opened(), created(ORDER, task()))
    asked = ask(CancelOrder, scene=SCENE, order=UNKNOWN)
    given(*past).when(asked).rejected(Reason.ORDER_UNKNOWN, UNKNOWN)
    other = SceneId("0" * 24)
    elsewhere = opened()[0].__class__(scene=other, name="b", digest="", areas=(), groups=())
    asked = ask(CancelOrder, scene=other, order=ORDER)
    given(*past, elsewhere).when(asked).rejected(Reason.ORDER_SCENE_MISMATCH, "sceneId")


def test_a_batch_of_cancels_ignores_the_finished_and_refuses_the_unknown() -> None:
    gone = OrderCancelled(scene=SCENE, order=ORDER)
    past = (*opened(), created(ORDER, task()), created(SECOND, task()), gone)
    outcome = given(*past).when(ask(CancelOrders, orders=(ORDER, SECOND, UNKNOWN)))
    outcome.then(OrderCancelled(scene=SCENE, order=SECOND))
    assert list(outcome.decision.refused) == [UNKNOWN]


def test_all_orders_of_a_scene_can_be_cancelled_and_none_is_no_error() -> None:
    asked = ask(CancelAllOrders, scene=SCENE)
    given(*opened()).when(asked).nothing()
    past = (*opened(), created(ORDER, task()), created(SECOND, task()))
    given(*past).when(asked).then(
        OrderCancelled(scene=SCENE, order=ORDER), OrderCancelled(scene=SCENE, order=SECOND)
    )


def test_priorities_are_set_for_all_orders_or_for_none() -> None:
    past = (*opened(), created(ORDER, task()), created(SECOND, task(), priority=3))
    asked = ask(PrioritiseOrders, orders=(ORDER, SECOND), priority=3)
    given(*past).when(asked).then(OrderPrioritised(scene=SCENE, order=ORDER, priority=3))
    asked = ask(PrioritiseOrders, orders=(ORDER, UNKNOWN), priority=3)
    given(*past).when(asked).rejected(Reason.ORDER_UNKNOWN)
    gone = OrderCancelled(scene=SCENE, order=ORDER)
    asked = ask(PrioritiseOrders, orders=(ORDER, SECOND), priority=4)
    given(*past, gone).when(asked).rejected(Reason.ORDER_TERMINAL)


def test_only_faulted_orders_are_retried() -> None:
    fault = OrderFaulted(scene=SCENE, order=ORDER, reason="jack")
    past = (*opened(), created(ORDER, task()), created(SECOND, task()), fault)
    outcome = given(*past).when(ask(RetryOrders, orders=(ORDER, SECOND, UNKNOWN)))
    outcome.then(OrderRetried(scene=SCENE, order=ORDER))
    assert {k: v.reason for k, v in outcome.decision.refused.items()} == {
        SECOND: Reason.ORDER_NOT_FAULTED,
        UNKNOWN: Reason.ORDER_UNKNOWN,
    }


def test_a_batch_has_a_limit() -> None:
    asked = ask(CancelOrders, orders=(ORDER,) * 10_001)
    given(*opened()).when(asked).rejected(Reason.TOO_MANY, "orderIds")


def test_a_robot_name_of_another_scene_does_not_count() -> None:
    fields = {"wanted_robots": (RobotName(f"x/{R1}"),)}
    given(*opened(R1)).when(create(task(), **fields)).rejected(Reason.ROBOT_UNKNOWN)


def test_the_events_of_creation_hold_the_kind_business() -> None:
    outcome = given(*opened()).when(create(task()))
    event = outcome.decision.events[0]
    assert isinstance(event, OrderCreated)
    assert event.kind is OrderKind.BUSINESS
