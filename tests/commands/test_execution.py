import pytest

from commands.rejected import Reason
from ledger.events import (
    AnyEvent,
    OrderCancelled,
    OrderFaulted,
    OrderFinished,
    RobotConnected,
    RobotDisconnected,
    RobotGivenUp,
)
from ledger.ids import RobotName
from ledger.proposals import (
    ConnectRobot,
    DisconnectRobot,
    FaultOrder,
    FinishStep,
    GiveUpRobot,
    StartStep,
)
from ledger.state import OrderStatus
from tests.commands.site import (
    ORDER,
    R1,
    R2,
    SCENE,
    assigned,
    created,
    finished,
    opened,
    started,
    task,
)
from tests.scenario import given

OPEN = (*opened(R1, R2), created(ORDER, task(), task("AP125"), sealed=False), assigned())
SEALED = (*opened(R1, R2), created(ORDER, task(), task("AP125")), assigned())
FAULT = OrderFaulted(scene=SCENE, order=ORDER, reason="jack")


def start(step: int = 0, robot: RobotName = R1) -> StartStep:
    return StartStep(scene=SCENE, order=ORDER, step=step, robot=robot)


def finish(step: int = 0, robot: RobotName = R1) -> FinishStep:
    return FinishStep(scene=SCENE, order=ORDER, step=step, robot=robot)


def test_steps_are_started_one_after_another() -> None:
    given(*OPEN).when(start()).then(started())
    given(*OPEN, started(), finished()).when(start(1)).then(started(1))


def test_the_last_step_of_a_sealed_order_finishes_it() -> None:
    past = (started(), finished(), started(1))
    fleet = (
        given(*SEALED, *past)
        .when(finish(1))
        .then(finished(1), OrderFinished(scene=SCENE, order=ORDER))
    )
    assert not fleet.orders
    assert not fleet.robots[f"{SCENE}/{R1}"].orders


def test_an_open_order_waits_after_its_last_step() -> None:
    fleet = given(*OPEN, started(), finished(), started(1)).when(finish(1)).then(finished(1))
    assert fleet.orders[ORDER].status is OrderStatus.PENDING


@pytest.mark.parametrize(
    ("past", "proposal", "reason"),
    [
        ((), start(1), Reason.STEP_NOT_EXECUTABLE),
        ((started(),), start(), Reason.STEP_NOT_EXECUTABLE),
        ((), start(2), Reason.STEP_UNKNOWN),
        ((), start(-1), Reason.STEP_UNKNOWN),
        ((), start(robot=R2), Reason.ORDER_NOT_ASSIGNED),
        ((FAULT,), start(), Reason.ORDER_FAULTED),
        ((), finish(), Reason.STEP_NOT_EXECUTING),
        ((started(), finished()), finish(), Reason.STEP_NOT_EXECUTING),
        ((started(),), finish(robot=R2), Reason.ORDER_NOT_ASSIGNED),
        ((started(), FAULT), finish(), Reason.ORDER_FAULTED),
        ((OrderCancelled(scene=SCENE, order=ORDER),), start(), Reason.ORDER_TERMINAL),
    ],
)
def test_what_does_not_fit_the_state_is_refused(
    past: tuple[AnyEvent, ...], proposal: StartStep | FinishStep, reason: Reason
) -> None:
    given(*OPEN, *past).when(proposal).rejected(reason)


def test_the_first_fault_is_kept() -> None:
    given(*OPEN).when(FaultOrder(scene=SCENE, order=ORDER, reason="jack")).then(FAULT)
    given(*OPEN, FAULT).when(FaultOrder(scene=SCENE, order=ORDER, reason="other")).nothing()


def test_only_a_change_of_connection_is_an_event() -> None:
    connect = ConnectRobot(scene=SCENE, robot=R1)
    disconnect = DisconnectRobot(scene=SCENE, robot=R1)
    gone = RobotDisconnected(scene=SCENE, robot=R1)
    given(*OPEN).when(connect).nothing()
    given(*OPEN).when(disconnect).then(gone)
    given(*OPEN, gone).when(disconnect).nothing()
    given(*OPEN, gone).when(connect).then(RobotConnected(scene=SCENE, robot=R1))
    stranger = ConnectRobot(scene=SCENE, robot=RobotName("R9"))
    given(*OPEN).when(stranger).rejected(Reason.ROBOT_UNKNOWN)


def test_a_robot_is_given_up_once_and_only_while_it_is_away() -> None:
    give_up = GiveUpRobot(scene=SCENE, robot=R1)
    gone, up = RobotDisconnected(scene=SCENE, robot=R1), RobotGivenUp(scene=SCENE, robot=R1)
    given(*OPEN).when(give_up).nothing()
    fleet = given(*OPEN, gone).when(give_up).then(up)
    assert fleet.robots[f"{SCENE}/{R1}"].given_up
    given(*OPEN, gone, up).when(give_up).nothing()
    stranger = GiveUpRobot(scene=SCENE, robot=RobotName("R9"))
    given(*OPEN).when(stranger).rejected(Reason.ROBOT_UNKNOWN)
