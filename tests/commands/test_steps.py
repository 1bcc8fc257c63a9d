import pytest

from commands.rejected import Reason
from commands.steps import AddSteps, ChangeSteps, DeleteSteps, StepPatch
from ledger.events import OrderCancelled, StepChange, StepsAdded, StepsChanged, StepsDeleted
from ledger.events.orders import OrderFaulted, OrderFinished
from ledger.ids import OrderId, StepId
from ledger.state import OrderStatus
from tests.commands.site import (
    BINS,
    ORDER,
    R1,
    SCENE,
    assigned,
    created,
    finished,
    opened,
    started,
    task,
)
from tests.scenario import ask, given

OPEN = (*opened(R1), created(ORDER, task(), task("AP125"), sealed=False))
STEP_0, STEP_1 = StepId(f"{ORDER}-Step0"), StepId(f"{ORDER}-Step1")


def add(*tasks: object) -> object:
    return ask(AddSteps, order=ORDER, tasks=tasks)


def change(*patches: StepPatch) -> object:
    return ask(ChangeSteps, order=ORDER, patches=patches)


def delete(*steps: str) -> object:
    return ask(DeleteSteps, order=ORDER, steps=steps)


def test_steps_are_appended_in_the_order_given() -> None:
    tasks = (task("AP2483"), task(BINS[0]))
    event = StepsAdded(scene=SCENE, order=ORDER, tasks=tasks)
    fleet = given(*OPEN).when(add(*tasks)).then(event)
    assert [s.id for s in fleet.orders[ORDER].steps] == [f"{ORDER}-Step{n}" for n in range(4)]


def test_a_step_that_loads_later_gives_the_order_its_container() -> None:
    loads = task(BINS[0], loads=True)
    event = StepsAdded(scene=SCENE, order=ORDER, tasks=(loads,), container=f"container-{ORDER}")
    fleet = given(*OPEN).when(add(loads)).then(event)
    assert fleet.orders[ORDER].container == f"container-{ORDER}"
    again = StepsAdded(scene=SCENE, order=ORDER, tasks=(loads,))
    given(*OPEN, event).when(add(loads)).then(again)


def test_an_order_that_waits_for_steps_goes_on_with_them() -> None:
    past = (*OPEN, assigned(), started(0), finished(0), started(1), finished(1))
    assert given(*past).fleet.orders[ORDER].status is OrderStatus.PENDING
    event = StepsAdded(scene=SCENE, order=ORDER, tasks=(task(),))
    fleet = given(*past).when(add(task())).then(event)
    assert fleet.orders[ORDER].status is OrderStatus.ALLOCATED


def test_sealed_finished_and_unknown_orders_take_no_steps() -> None:
    sealed = created(ORDER, task())
    given(*opened(), sealed).when(add(task())).rejected(Reason.ORDER_SEALED)
    gone = OrderCancelled(scene=SCENE, order=ORDER)
    given(*OPEN, gone).when(add(task())).rejected(Reason.ORDER_TERMINAL)
    asked = ask(AddSteps, order=OrderId("TO1"), tasks=(task(),))
    given(*OPEN).when(asked).rejected(Reason.ORDER_UNKNOWN)


def test_added_steps_obey_the_rules_of_steps_and_a_limit() -> None:
    story = given(*OPEN)
    story.when(add()).rejected(Reason.STEPS_MISSING, "steps")
    story.when(add(task("AP9"))).rejected(Reason.LOCATION_UNKNOWN, "steps[0]")
    story.when(add(*[task()] * 999)).rejected(Reason.TOO_MANY, "steps")


def test_only_what_is_named_changes() -> None:
    patch = StepPatch(step=1, location=BINS[0], arguments='{"binTask":"Load"}', loads=True)
    to = task(BINS[0], arguments='{"binTask":"Load"}', loads=True)
    event = StepsChanged(
        scene=SCENE,
        order=ORDER,
        changes=(StepChange(step=1, task=to),),
        container=f"container-{ORDER}",
    )
    fleet = given(*OPEN).when(change(patch)).then(event)
    assert fleet.orders[ORDER].container == f"container-{ORDER}"
    back = StepPatch(step=1, arguments="{}", loads=False)
    to = task(BINS[0])
    event = StepsChanged(scene=SCENE, order=ORDER, changes=(StepChange(step=1, task=to),))
    happening = StepsChanged(
        scene=SCENE,
        order=ORDER,
        changes=(StepChange(step=1, task=task(BINS[0], arguments='{"binTask":"Load"}')),),
    )
    given(*OPEN, happening).when(change(back)).then(event)


def test_a_change_to_what_is_already_so_is_nothing() -> None:
    given(*OPEN).when(change(StepPatch(step=0, location="AP110"))).nothing()


@pytest.mark.parametrize(
    ("patches", "reason"),
    [
        ((), Reason.STEPS_MISSING),
        ((StepPatch(step=2),), Reason.STEP_UNKNOWN),
        ((StepPatch(step=-1),), Reason.STEP_UNKNOWN),
        ((StepPatch(step=1), StepPatch(step=1)), Reason.STEP_REPEATED),
        ((StepPatch(step=0, location="AP125"),), Reason.STEP_NOT_EXECUTABLE),
        ((StepPatch(step=1, location="AP9"),), Reason.LOCATION_UNKNOWN),
        ((StepPatch(step=1, loads=True, unloads=True),), Reason.STEP_LOADS_AND_UNLOADS),
        ((StepPatch(step=1, arguments='{"binTask":"Load"}'),), Reason.BIN_TASK_NEEDS_BIN),
    ],
)
def test_a_change_against_the_rules_changes_nothing(
    patches: tuple[StepPatch, ...], reason: Reason
) -> None:
    past = (*OPEN, assigned(), started(0))
    given(*past).when(change(*patches)).rejected(reason)


def test_a_bin_task_does_not_survive_a_move_to_a_point() -> None:
    loading = created(ORDER, task(BINS[0], arguments='{"binTask":"Load"}'))
    asked = change(StepPatch(step=0, location="AP125"))
    given(*opened(), loading).when(asked).rejected(Reason.BIN_TASK_NEEDS_BIN)


def test_steps_are_deleted_by_id_and_ids_are_not_given_again() -> None:
    event = StepsDeleted(scene=SCENE, order=ORDER, steps=(STEP_1,))
    fleet = given(*OPEN).when(delete(STEP_1, STEP_1)).then(event)
    assert [s.id for s in fleet.orders[ORDER].steps] == [STEP_0]
    more = StepsAdded(scene=SCENE, order=ORDER, tasks=(task(),))
    after = given(*OPEN, event, more).fleet.orders[ORDER]
    assert [s.id for s in after.steps] == [STEP_0, f"{ORDER}-Step2"]


def test_steps_that_are_unknown_or_begun_are_not_deleted() -> None:
    story = given(*OPEN, assigned(), started(0))
    story.when(delete()).rejected(Reason.STEPS_MISSING)
    story.when(delete(STEP_1, "x")).rejected(Reason.STEP_UNKNOWN, "stepIds[1]")
    story.when(delete(STEP_0)).rejected(Reason.STEP_NOT_EXECUTABLE, "Executing")


def test_a_sealed_order_left_with_done_steps_only_is_finished() -> None:
    past = (*opened(R1), created(ORDER, task(), task("AP125")), assigned(), started(), finished())
    deleted = StepsDeleted(scene=SCENE, order=ORDER, steps=(STEP_1,))
    fleet = given(*past).when(delete(STEP_1)).then(deleted, OrderFinished(scene=SCENE, order=ORDER))
    assert not fleet.orders
    fault = OrderFaulted(scene=SCENE, order=ORDER, reason="x")
    given(*past, fault).when(delete(STEP_1)).then(deleted)


def test_a_sealed_order_keeps_a_step_and_an_open_one_need_not() -> None:
    sealed = (*opened(), created(ORDER, task()))
    given(*sealed).when(delete(STEP_0)).rejected(Reason.ORDER_NO_STEPS)
    gone = StepsDeleted(scene=SCENE, order=ORDER, steps=(STEP_0, STEP_1))
    given(*OPEN).when(delete(STEP_0, STEP_1)).then(gone)
