"""A robot is told something on its way, through the whole system, and what becomes of that."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from commands.instructions import (
    CancelNavigation,
    ControlRobots,
    PauseRobots,
    ReconnectRobots,
    SoftStopRobots,
)
from commands.orders import CancelOrder, RetryOrders
from commands.recovery import RecoverRobots
from commands.robot_duty import DisableRobots
from commands.scene_life import DisableScene
from fleetledger.shift import Shift
from ledger.events import (
    AnyEvent,
    OrderFaulted,
    OrderFinished,
    OrderWithdrawn,
    RobotConnected,
    RobotDisconnected,
    RobotGivenUp,
)
from ledger.ids import RobotName, robot_key
from ledger.state import Order, StepTask
from sim.robot import SimRobot, place
from sim.warehouses import generate
from tests.laws.onlooker import Onlooker, ask, bins_of, load, unload

FILE = generate(aisles=2, bays=2, robots=2, seed=3)


class Work:
    """Two robots, one order, and whoever looks on."""

    def __init__(self, seed: int = 3) -> None:
        self.shift = Shift(FILE, seed=seed)
        self.onlooker = Onlooker(self.shift)
        bins = bins_of(FILE)
        self.order_id = self.shift.order(load(bins[0]), unload(bins[-1]))

    @property
    def order(self) -> Order:
        return self.shift.fleet.orders[self.order_id]

    @property
    def name(self) -> RobotName:
        """The robot that has the order."""
        assert self.order.robot is not None
        return self.order.robot

    def robot(self, name: RobotName) -> SimRobot:
        return next(r for r in self.shift.world.robots() if r.body.name == name)

    def until(self, wanted: Callable[[], bool], seconds: float = 120.0) -> None:
        for _ in range(int(seconds * 5)):
            if wanted():
                return
            self.onlooker.run(0.2)
        raise AssertionError("it does not come true")

    def on_the_way(self) -> RobotName:
        self.until(lambda: self.order.robot is not None and self.robot(self.name).speed > 0.8)
        return self.name

    def tell(self, kind: type, *names: RobotName, **fields: object) -> None:
        command = ask(self.shift, kind, scene=self.shift.scene, robots=names, **fields)
        assert not self.shift.handler.handle(command).refused

    def ended(self) -> bool:
        return self.order_id not in self.shift.fleet.orders

    def happened(self, kind: type[AnyEvent]) -> list[Any]:
        return [event for event in self.shift.ledger.read(0) if isinstance(event, kind)]

    def reject(self) -> str:
        reject = self.order.execution_reject
        return "" if reject is None else reject.code


def pose(robot: SimRobot) -> tuple[float, ...]:
    return place(robot)[:3]


@pytest.mark.parametrize("restart", [False, True])
def test_a_soft_stop_stands_within_its_braking_distance_until_it_is_lifted(restart: bool) -> None:
    work = Work()
    name = work.on_the_way()
    robot = work.robot(name)
    odometer_m, speed = robot.odometer_m, robot.speed
    work.tell(SoftStopRobots, name, stopped=True)
    work.onlooker.run(2.0)
    assert robot.speed == 0.0
    # v²/2a at three times 0.6 m/s², and 0.6 s until it has heard
    assert robot.odometer_m - odometer_m <= speed * speed / (2 * 1.8) + 0.6 * 1.2
    stands = pose(robot)
    if restart:
        work.onlooker.restart_scheduler()
    work.onlooker.run(20.0)
    assert pose(robot) == stands
    assert work.reject() == "RobotSoftStopped"
    work.tell(SoftStopRobots, name, stopped=False)
    work.until(work.ended)


@given(
    stops=st.lists(st.tuples(st.integers(1, 40), st.booleans()), min_size=1, max_size=4),
    seed=st.integers(0, 99),
)
@example(stops=[(38, True), (7, False), (9, False)], seed=31)  # stopped 14 µm before its goal
@settings(max_examples=12, deadline=None)
def test_who_drives_stands_soon_after_a_stop_at_any_moment(
    stops: list[tuple[int, bool]], seed: int
) -> None:
    work = Work(seed)
    work.onlooker.run(1.0)  # until they have connected
    for steps, restart in stops:
        work.onlooker.run(0.2 * steps)
        names = [RobotName(r.body.name) for r in work.shift.world.robots()]
        work.tell(SoftStopRobots, *names, stopped=True)
        if restart:
            work.onlooker.restart_scheduler()
        work.onlooker.run(3.0)
        stands = [pose(robot) for robot in work.shift.world.robots()]
        work.onlooker.run(3.0)
        assert [pose(robot) for robot in work.shift.world.robots()] == stands
        work.tell(SoftStopRobots, *names, stopped=False)
    work.until(work.ended)


def test_lifting_a_stop_does_not_lift_one_pressed_at_the_robot_later() -> None:
    work = Work()
    name = work.on_the_way()
    work.tell(SoftStopRobots, name, stopped=True)
    work.onlooker.run(1.0)
    work.tell(SoftStopRobots, name, stopped=False)
    work.onlooker.run(1.0)
    work.shift.world.press_soft_stop(work.shift.scene, name)
    work.onlooker.restart_scheduler()
    work.onlooker.run(30.0)
    assert work.robot(name).soft_stop
    work.tell(SoftStopRobots, name, stopped=False)
    work.until(work.ended)


def test_a_paused_robot_brakes_softly_keeps_its_order_and_goes_on() -> None:
    work = Work()
    name = work.on_the_way()
    work.tell(PauseRobots, name, paused=True)
    work.onlooker.run(4.0)
    stands = pose(work.robot(name))
    work.onlooker.run(60.0)
    assert pose(work.robot(name)) == stands
    assert (work.name, work.reject()) == (name, "RobotPaused")
    work.tell(PauseRobots, name, paused=False)
    work.until(work.ended)
    assert not work.happened(OrderWithdrawn)


def test_a_robot_of_somebody_else_drives_to_its_authority_and_no_further() -> None:
    work = Work()
    name = work.on_the_way()
    work.shift.world.seize(work.shift.scene, name, "Roboshop")
    work.tell(RecoverRobots, name)  # takes control only if nobody holds it
    work.onlooker.run(25.0)
    robot = work.robot(name)
    assert robot.speed == 0.0
    assert robot.progress == robot.authority or not robot.legs
    assert robot.controller == "Roboshop"
    assert work.reject() in ("RobotNotControlled", "")
    work.tell(ControlRobots, name, taken=True)
    work.until(work.ended)


def test_cancelled_navigation_stops_at_what_was_granted_until_a_retry() -> None:
    work = Work()
    name = work.on_the_way()
    work.tell(CancelNavigation, name)
    work.onlooker.run(30.0)
    assert work.robot(name).speed == 0.0
    assert len(work.happened(OrderFaulted)) == 1
    work.shift.handler.handle(ask(work.shift, RetryOrders, orders=(work.order_id,)))
    work.until(work.ended)


def test_a_lost_robot_comes_back_when_it_is_reached_for() -> None:
    work = Work()
    name = work.on_the_way()
    work.shift.world.cut(work.shift.scene, name)
    work.until(work.ended)
    assert [e.robot for e in work.happened(RobotDisconnected)] == [name]
    assert len(work.happened(RobotConnected)) == 3
    assert not work.happened(RobotGivenUp)


def test_a_robot_that_does_not_come_back_is_given_up_until_somebody_asks() -> None:
    work = Work()
    name = work.on_the_way()
    scene = work.shift.scene
    work.shift.world.cut(scene, name, deaf=True)
    work.onlooker.run(75.0)
    assert [e.robot for e in work.happened(RobotGivenUp)] == [name]
    work.shift.world.cut(scene, name)
    work.onlooker.run(30.0)
    key = robot_key(scene, name)
    assert not work.shift.fleet.robots[key].online, "nobody reaches for it any more"
    work.tell(ReconnectRobots, name)
    work.onlooker.run(5.0)
    assert work.shift.fleet.robots[key].online
    assert not work.shift.fleet.robots[key].given_up
    work.until(work.ended)


def test_the_orders_of_a_disabled_robot_go_to_another() -> None:
    work = Work()
    name = work.on_the_way()
    work.tell(DisableRobots, name, disabled=True)
    work.until(lambda: work.order.robot not in (None, name))
    work.tell(DisableRobots, name, disabled=False)  # it is in the other's way, where it stands
    work.until(work.ended)
    assert [(e.robot, e.reason) for e in work.happened(OrderWithdrawn)] == [(name, "RobotDisabled")]


def test_a_load_stays_with_a_disabled_robot_and_says_so() -> None:
    work = Work()
    work.until(lambda: work.order.loaded)
    name = work.on_the_way()
    work.tell(DisableRobots, name, disabled=True)
    work.onlooker.run(40.0)
    assert (work.name, work.reject()) == (name, "RobotDisabled")
    work.tell(DisableRobots, name, disabled=False)
    work.until(work.ended)


def test_a_disabled_scene_rests_and_goes_on_where_it_was() -> None:
    work = Work()
    work.on_the_way()
    poses = {r.body.name: pose(r) for r in work.shift.world.robots()}
    disable = ask(work.shift, DisableScene, scene=work.shift.scene, disabled=True)
    work.shift.handler.handle(disable)
    work.onlooker.run(60.0)
    assert not list(work.shift.world.robots())
    assert not work.happened(OrderWithdrawn)
    enable = ask(work.shift, DisableScene, scene=work.shift.scene, disabled=False)
    work.shift.handler.handle(enable)
    work.shift.sim.tick(work.shift.now_ms)
    assert {r.body.name: pose(r) for r in work.shift.world.robots()} == poses
    work.until(work.ended)


def test_a_failing_operation_leaves_a_fault_and_an_alarm_that_recovery_clears() -> None:
    work = Work()
    work.until(work.ended)
    spot = bins_of(FILE)[0]
    failing = work.shift.order(StepTask(location=spot, arguments='{"operation":"Fail"}'))
    live = work.shift.fleet.orders
    work.until(lambda: live[failing].fault_reason is not None)
    name = live[failing].robot
    assert name is not None
    work.onlooker.run(1.0)
    assert list(work.robot(name).alarms) == ["ActionFailed"]
    cancel = ask(work.shift, CancelOrder, scene=work.shift.scene, order=failing)
    work.shift.handler.handle(cancel)
    work.tell(RecoverRobots, name)
    work.onlooker.run(2.0)
    assert not work.robot(name).alarms
    work.order_id = work.shift.order(load(spot), unload(bins_of(FILE)[1]))
    work.until(work.ended)
    assert len(work.happened(OrderFinished)) >= 2
