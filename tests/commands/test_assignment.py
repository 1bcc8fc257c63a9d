import pytest

from commands.rejected import Reason
from ledger.events import (
    AnyEvent,
    AssignmentRejected,
    ExecutionRejected,
    OrderCancelled,
    OrderCreated,
    OrderFaulted,
    OrderWithdrawn,
    RobotDisabled,
    RobotDisconnected,
    RobotWentOffDuty,
)
from ledger.ids import OrderId, RobotName, SceneId
from ledger.proposals import (
    AssignOrder,
    CreateSystemOrder,
    RejectAssignment,
    RejectExecution,
    WithdrawOrder,
)
from ledger.state import BinStatus, OrderKind, OrderStatus
from tests.commands.site import (
    BINS,
    ORDER,
    R1,
    R2,
    SCENE,
    SECOND,
    assigned,
    created,
    finished,
    opened,
    started,
    task,
)
from tests.scenario import given

WAITING = (*opened(R1, R2), created(ORDER, task(BINS[0], loads=True), task(BINS[1], unloads=True)))
PARKING = OrderId("TO20250806-000002P")


def assign(order: OrderId = ORDER, robot: RobotName = R1, bin: int = 0) -> AssignOrder:
    return AssignOrder(scene=SCENE, order=order, robot=robot, bin=bin, cost_s=1.0)


def parked(order: OrderId = PARKING) -> tuple[AnyEvent, ...]:
    made = OrderCreated(
        scene=SCENE,
        order=order,
        kind=OrderKind.PARKING,
        wanted_robots=(R1,),
        key_locations=("PP1",),
        sealed=True,
        tasks=(task("PP1"),),
    )
    return made, assigned(order)


def test_a_waiting_order_goes_to_a_free_bin() -> None:
    fleet = given(*WAITING).when(assign()).then(assigned())
    assert fleet.robots[f"{SCENE}/{R1}"].orders == (ORDER,)
    assert fleet.orders[ORDER].status is OrderStatus.ALLOCATED


def test_business_ends_what_the_system_wanted_of_the_robot() -> None:
    story = given(*WAITING, *parked(), started(0, PARKING))
    fleet = story.when(assign()).then(OrderCancelled(scene=SCENE, order=PARKING), assigned())
    robot = fleet.robots[f"{SCENE}/{R1}"]
    assert robot.orders == (ORDER,)
    assert robot.bins[0].order == ORDER


@pytest.mark.parametrize(
    ("past", "proposal", "reason"),
    [
        ((), assign(order=OrderId("TO1")), Reason.ORDER_UNKNOWN),
        ((OrderCancelled(scene=SCENE, order=ORDER),), assign(), Reason.ORDER_TERMINAL),
        ((assigned(robot=R2),), assign(), Reason.ORDER_ASSIGNED),
        ((OrderFaulted(scene=SCENE, order=ORDER, reason="x"),), assign(), Reason.ORDER_FAULTED),
        ((), assign(robot=RobotName("R9")), Reason.ROBOT_UNKNOWN),
        ((RobotDisabled(scene=SCENE, robot=R1),), assign(), Reason.ROBOT_NOT_AVAILABLE),
        ((RobotWentOffDuty(scene=SCENE, robot=R1),), assign(), Reason.ROBOT_NOT_AVAILABLE),
        ((RobotDisconnected(scene=SCENE, robot=R1),), assign(), Reason.ROBOT_NOT_AVAILABLE),
        ((), assign(bin=1), Reason.ROBOT_BIN_TAKEN),
        ((), assign(bin=-1), Reason.ROBOT_BIN_TAKEN),
        ((created(SECOND, task()), assigned(SECOND)), assign(), Reason.ROBOT_BIN_TAKEN),
    ],
)
def test_a_stale_assignment_is_refused(
    past: tuple[AnyEvent, ...], proposal: AssignOrder, reason: Reason
) -> None:
    given(*WAITING, *past).when(proposal).rejected(reason)


def test_left_over_loads_keep_their_bin() -> None:
    past = (assigned(), started(), finished(), OrderCancelled(scene=SCENE, order=ORDER))
    story = given(*WAITING, *past, created(SECOND, task()))
    story.when(assign(SECOND)).rejected(Reason.ROBOT_BIN_TAKEN, "Cancelled")


def test_named_robots_and_named_groups_are_one_list() -> None:
    only = created(SECOND, task(), wanted_robots=(R2,))
    given(*WAITING, only).when(assign(SECOND)).rejected(Reason.ROBOT_NOT_WANTED)
    given(*WAITING, only).when(assign(SECOND, R2)).then(assigned(SECOND, R2))
    either = created(SECOND, task(), wanted_robots=(R2,), wanted_groups=("AMR",))
    given(*WAITING, either).when(assign(SECOND)).then(assigned(SECOND))


def test_an_order_is_of_one_scene() -> None:
    proposal = AssignOrder(scene=SceneId("other"), order=ORDER, robot=R1, bin=0, cost_s=1.0)
    given(*WAITING).when(proposal).rejected(Reason.ORDER_SCENE_MISMATCH)


def test_what_is_not_loaded_can_be_withdrawn() -> None:
    withdrawn = OrderWithdrawn(scene=SCENE, order=ORDER, robot=R1, reason="cheaper")
    proposal = WithdrawOrder(scene=SCENE, order=ORDER, reason="cheaper")
    given(*WAITING, assigned(), started()).when(proposal).then(withdrawn)
    given(*WAITING).when(proposal).rejected(Reason.ORDER_NOT_ASSIGNED)
    loaded = (*WAITING, assigned(), started(), finished())
    given(*loaded).when(proposal).rejected(Reason.ORDER_LOADED, R1)


def test_what_was_put_down_can_be_withdrawn_again() -> None:
    order = created(ORDER, task(loads=True), task(unloads=True), task("AP125"))
    past = (order, assigned(), started(), finished(), started(1), finished(1))
    withdrawn = OrderWithdrawn(scene=SCENE, order=ORDER, robot=R1, reason="r")
    proposal = WithdrawOrder(scene=SCENE, order=ORDER, reason="r")
    given(*opened(R1), *past).when(proposal).then(withdrawn)


def test_an_order_of_the_system_ends_when_it_is_withdrawn() -> None:
    past = (*opened(R1), *parked(OrderId("TO20250806-000001P")))
    id_ = OrderId("TO20250806-000001P")
    proposal = WithdrawOrder(scene=SCENE, order=id_, reason="r")
    given(*past).when(proposal).then(OrderCancelled(scene=SCENE, order=id_))


def test_a_reason_is_stated_once() -> None:
    proposal = RejectAssignment(scene=SCENE, order=ORDER, code="None", robots={R1: "Busy"})
    event = AssignmentRejected(scene=SCENE, order=ORDER, code="None", robots={R1: "Busy"})
    given(*WAITING).when(proposal).then(event)
    given(*WAITING, event).when(proposal).nothing()
    given(*WAITING, assigned()).when(proposal).rejected(Reason.ORDER_ASSIGNED)


def test_a_reason_of_execution_is_stated_once_and_taken_back_once() -> None:
    proposal = RejectExecution(scene=SCENE, order=ORDER, code="Blocked")
    event = ExecutionRejected(scene=SCENE, order=ORDER, code="Blocked")
    back = RejectExecution(scene=SCENE, order=ORDER, code="")
    ended = ExecutionRejected(scene=SCENE, order=ORDER, code="")
    given(*WAITING).when(proposal).rejected(Reason.ORDER_NOT_ASSIGNED)
    given(*WAITING, assigned()).when(proposal).then(event)
    given(*WAITING, assigned(), event).when(proposal).nothing()
    given(*WAITING, assigned(), event).when(back).then(ended)
    given(*WAITING, assigned(), event, ended).when(back).nothing()


def park(location: str = "PP1", kind: OrderKind = OrderKind.PARKING) -> CreateSystemOrder:
    return CreateSystemOrder(scene=SCENE, kind=kind, robot=R1, location=location, cost_s=1.0)


def test_an_idle_robot_is_sent_to_park_even_off_duty() -> None:
    expected = parked(OrderId("TO20250806-000001P"))
    fleet = given(*opened(R1)).when(park()).then(*expected)
    assert fleet.robots[f"{SCENE}/{R1}"].bins[0].status is BinStatus.RESERVED
    off = RobotWentOffDuty(scene=SCENE, robot=R1)
    given(*opened(R1), off).when(park()).then(*expected)


def test_the_system_does_not_want_two_things_of_one_robot() -> None:
    story = given(*WAITING, assigned())
    story.when(park()).rejected(Reason.ROBOT_HAS_ORDERS, ORDER)
    loaded = (assigned(), started(), finished(), OrderCancelled(scene=SCENE, order=ORDER))
    given(*WAITING, *loaded).when(park()).rejected(Reason.ROBOT_BIN_TAKEN)
    given(*WAITING).when(park("AP9")).rejected(Reason.LOCATION_UNKNOWN)
    given(*WAITING).when(park(kind=OrderKind.BUSINESS)).rejected(Reason.ORDER_KIND_INVALID)
    gone = RobotDisconnected(scene=SCENE, robot=R1)
    given(*WAITING, gone).when(park()).rejected(Reason.ROBOT_NOT_AVAILABLE)
