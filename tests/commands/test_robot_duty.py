from commands.rejected import Reason
from commands.robot_duty import ClearRobotBins, DisableRobots, SendRobotsOffDuty
from ledger.events import (
    OrderCancelled,
    RobotBinsCleared,
    RobotDisabled,
    RobotEnabled,
    RobotWentOffDuty,
    RobotWentOnDuty,
)
from ledger.ids import RobotName
from ledger.state import BinStatus
from tests.commands.site import (
    BINS,
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
from tests.scenario import ask, given

R9 = RobotName("R9")


def test_disabling_is_for_all_or_for_none_and_only_news_is_stated() -> None:
    disable = ask(DisableRobots, scene=SCENE, robots=(R1, R2), disabled=True)
    enable = ask(DisableRobots, scene=SCENE, robots=(R1, R2), disabled=False)
    disabled = RobotDisabled(scene=SCENE, robot=R1)
    past = (*opened(R1, R2), disabled)
    given(*past).when(disable).then(RobotDisabled(scene=SCENE, robot=R2))
    given(*past).when(enable).then(RobotEnabled(scene=SCENE, robot=R1))
    asked = ask(DisableRobots, scene=SCENE, robots=(R2, R9), disabled=True)
    given(*past).when(asked).rejected(Reason.ROBOT_UNKNOWN, "robotNames")


def test_going_off_duty_is_each_robots_own_matter() -> None:
    asked = ask(SendRobotsOffDuty, scene=SCENE, robots=(R1, R9), off_duty=True)
    off = RobotWentOffDuty(scene=SCENE, robot=R1)
    given(*opened(R1)).when(asked).refused(R9=Reason.ROBOT_UNKNOWN).then(off)
    given(*opened(R1), off).when(asked).refused(R9=Reason.ROBOT_UNKNOWN).nothing()
    back = ask(SendRobotsOffDuty, scene=SCENE, robots=(R1,), off_duty=False)
    given(*opened(R1), off).when(back).then(RobotWentOnDuty(scene=SCENE, robot=R1))


def test_only_what_a_cancelled_order_left_behind_is_cleared() -> None:
    past = (*opened(R1), created(ORDER, task(BINS[0], loads=True), task()))
    loaded = (*past, assigned(), started(), finished())
    asked = ask(ClearRobotBins, scene=SCENE, robots=(R1, R9))
    refused = {"R9": Reason.ROBOT_UNKNOWN}
    given(*loaded).when(asked).refused(**refused).nothing()
    left = (*loaded, OrderCancelled(scene=SCENE, order=ORDER))
    story = given(*left).when(asked).refused(**refused)
    fleet = story.then(RobotBinsCleared(scene=SCENE, robot=R1))
    assert fleet.robots[f"{SCENE}/{R1}"].bins[0].status is BinStatus.EMPTY


def test_a_robot_with_orders_may_be_disabled_and_keeps_them() -> None:
    past = (*opened(R1), created(ORDER, task()), assigned())
    asked = ask(DisableRobots, scene=SCENE, robots=(R1,), disabled=True)
    fleet = given(*past).when(asked).then(RobotDisabled(scene=SCENE, robot=R1))
    assert fleet.robots[f"{SCENE}/{R1}"].orders == (ORDER,)
