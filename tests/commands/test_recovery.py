from commands.recovery import RecoverRobots
from commands.rejected import Reason
from ledger.events import (
    OrderFaulted,
    OrderFinished,
    OrderRetried,
    OrderSealed,
    RobotAlarmsCleared,
    RobotControlTaken,
    RobotDisabled,
    RobotDisconnected,
    RobotReconnectAsked,
    RobotTrafficReset,
)
from ledger.ids import RobotName
from tests.commands.site import (
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
from tests.scenario import ask, given

R9 = RobotName("R9")
TAKEN = RobotControlTaken(scene=SCENE, robot=R1, gently=True)
CLEARED = RobotAlarmsCleared(scene=SCENE, robot=R1)
RESET = RobotTrafficReset(scene=SCENE, robot=R1)


def recover(*robots: RobotName) -> object:
    return ask(RecoverRobots, scene=SCENE, robots=robots)


def faulted(order: str = ORDER) -> OrderFaulted:
    return OrderFaulted(scene=SCENE, order=order, reason="JackFailed")


def test_an_idle_robot_gets_its_traffic_reset() -> None:
    given(*opened(R1)).when(recover(R1)).then(TAKEN, RESET, CLEARED)


def test_a_robot_that_is_away_is_reached_for_first() -> None:
    away = RobotDisconnected(scene=SCENE, robot=R1)
    asked = RobotReconnectAsked(scene=SCENE, robot=R1)
    given(*opened(R1), away).when(recover(R1)).then(asked, TAKEN, RESET, CLEARED)


def test_an_order_with_a_fault_is_retried_and_one_without_goes_on() -> None:
    past = (*opened(R1), created(ORDER, task()), assigned(), started())
    retried = OrderRetried(scene=SCENE, order=ORDER)
    given(*past).when(recover(R1)).then(TAKEN, CLEARED)
    given(*past, faulted()).when(recover(R1)).then(TAKEN, retried, CLEARED)


def test_every_order_at_hand_that_has_a_fault_is_retried() -> None:
    orders = (created(ORDER, task()), created(SECOND, task()))
    past = (*opened(R1, bins=2), *orders, assigned(), assigned(SECOND, bin=1))
    both = (OrderRetried(scene=SCENE, order=ORDER), OrderRetried(scene=SCENE, order=SECOND))
    given(*past, faulted(SECOND), faulted()).when(recover(R1)).then(TAKEN, *both, CLEARED)


def test_what_a_retry_does_is_done_here_too() -> None:
    past = (*opened(R1), created(ORDER, task(), sealed=False), assigned(), started(), finished())
    sealed = (*past, faulted(), OrderSealed(scene=SCENE, order=ORDER))
    ended = (OrderRetried(scene=SCENE, order=ORDER), OrderFinished(scene=SCENE, order=ORDER))
    given(*sealed).when(recover(R1)).then(TAKEN, *ended, CLEARED)


def test_each_robot_is_recovered_on_its_own() -> None:
    off = RobotDisabled(scene=SCENE, robot=R2)
    outcome = given(*opened(R1, R2), off).when(recover(R9, R2, R1))
    outcome.refused(R9=Reason.ROBOT_UNKNOWN, R2=Reason.ROBOT_NOT_AVAILABLE)
    outcome.then(TAKEN, RESET, CLEARED)
