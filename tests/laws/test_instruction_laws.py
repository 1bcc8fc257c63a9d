"""Whatever operators tell robots, whenever: who is stopped stands, and in the end all goes on.

The whole system in one process on virtual time, schedulers restarted in between.
"""

from typing import Any

import hypothesis
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
    run_state_machine_as_test,
)

from commands.instructions import (
    CancelNavigation,
    ClearRobotAlarms,
    ControlRobots,
    PauseRobots,
    ReconnectRobots,
    SoftStopRobots,
)
from commands.order_suspension import SuspendOrders
from commands.orders import CancelOrder, CreateOrder, RetryOrders
from commands.recovery import RecoverRobots
from commands.rejected import Rejected
from commands.robot_duty import ClearRobotBins, DisableRobots
from commands.scene_life import DisableScene, PauseDispatch
from fleetledger.shift import Shift
from ledger.ids import RobotName, robot_key
from ledger.state import Order, OrderKind, StepTask
from sim.faults import NONE, FaultMix
from sim.robot import SimRobot, place
from sim.warehouses import generate
from tests.laws.onlooker import Onlooker, ask, bins_of, load, unload
from tests.laws.test_shift_machine import SLOW

ORDERS_MAX = 6
NUMBER = st.integers(0, 2**16)
# told within a pass, at rest after 1.2 m/s / (3 · 0.6 m/s²) = 0.7 s; the rest is for the messages
STANDS_AFTER_MS = 2_500
END_ROUND_S = 20.0
END_ROUNDS_MAX = 40


class AnyInstruction(RuleBasedStateMachine):
    """Instructions, good and bad, between stretches of time."""

    @initialize(robots=st.integers(1, 3), seed=st.integers(0, 99), delays=st.booleans())
    def open(self, robots: int, seed: int, delays: bool) -> None:
        file = generate(aisles=2, bays=2, robots=robots, seed=seed)
        faults = FaultMix(late_ratio=0.2, late_mean_s=3.0) if delays else NONE
        self.shift = Shift(file, seed=seed, faults=faults)
        self.onlooker = Onlooker(self.shift)
        self.bins = bins_of(file)
        self.stopped_ms: dict[RobotName, int] = {}  # by a command, robot linked ever since
        self.stands: dict[RobotName, tuple[float, ...]] = {}
        self.onlooker.run(2.0)
        self.carry(seed, seed + 3)

    # -- what happens

    def do(self, kind: type, **fields: Any) -> bool:
        try:
            decided = self.shift.handler.handle(ask(self.shift, kind, **fields))
        except Rejected:
            return False
        return not decided.refused

    def robot(self, number: int) -> RobotName:
        robots = sorted(robot.name for robot in self.shift.fleet.robots.values())
        return robots[number % len(robots)]

    def here(self, number: int) -> RobotName | None:
        """A robot that the simulated world has: disabled ones are not in it."""
        name = self.robot(number)
        return name if robot_key(self.shift.scene, name) in self.shift.world else None

    def tell(self, kind: type, number: int, **fields: Any) -> bool:
        name = self.robot(number)
        return self.do(kind, scene=self.shift.scene, robots=(name,), **fields)

    def moves_again(self, name: RobotName) -> None:
        self.stopped_ms.pop(name, None)
        self.stands.pop(name, None)

    @rule(a=NUMBER, b=NUMBER)
    def carry(self, a: int, b: int) -> None:
        if len(self.shift.fleet.orders) < ORDERS_MAX:
            tasks = load(self.bins[a % len(self.bins)]), unload(self.bins[b % len(self.bins)])
            self.do(CreateOrder, scene=self.shift.scene, sealed=True, tasks=tasks)

    @rule(a=NUMBER)
    def fail(self, a: int) -> None:
        if len(self.shift.fleet.orders) < ORDERS_MAX:
            there = self.bins[a % len(self.bins)]
            task = StepTask(location=there, arguments='{"operation":"Fail"}')
            self.do(CreateOrder, scene=self.shift.scene, sealed=True, tasks=(task,))

    @rule(n=NUMBER, on=st.booleans())
    def soft_stop(self, n: int, on: bool) -> None:
        name = self.robot(n)
        if self.tell(SoftStopRobots, n, stopped=on):
            if not on:
                self.moves_again(name)
            elif self.shift.world.is_linked(robot_key(self.shift.scene, name)):
                self.stopped_ms.setdefault(name, self.shift.now_ms)

    @rule(n=NUMBER, on=st.booleans())
    def press(self, n: int, on: bool) -> None:
        if name := self.here(n):
            self.shift.world.press_soft_stop(self.shift.scene, name, on=on)
            if not on:
                self.moves_again(name)

    @rule(n=NUMBER, on=st.booleans())
    def pause(self, n: int, on: bool) -> None:
        self.tell(PauseRobots, n, paused=on)

    @rule(n=NUMBER, on=st.booleans())
    def control(self, n: int, on: bool) -> None:
        self.tell(ControlRobots, n, taken=on)

    @rule(n=NUMBER, who=st.sampled_from(["", "Roboshop"]))
    def seize(self, n: int, who: str) -> None:
        if name := self.here(n):
            self.shift.world.seize(self.shift.scene, name, who)

    @rule(n=NUMBER, deaf=st.booleans())
    def cut(self, n: int, deaf: bool) -> None:
        if name := self.here(n):
            self.moves_again(name)  # it may not have heard
            self.shift.world.cut(self.shift.scene, name, deaf=deaf)

    @rule(n=NUMBER, what=st.sampled_from([ReconnectRobots, RecoverRobots, ClearRobotAlarms]))
    def help(self, n: int, what: type) -> None:
        self.tell(what, n)

    @rule(n=NUMBER)
    def cancel_navigation(self, n: int) -> None:
        self.tell(CancelNavigation, n)

    @rule(n=NUMBER, disabled=st.booleans())
    def disable(self, n: int, disabled: bool) -> None:
        self.moves_again(self.robot(n))
        self.tell(DisableRobots, n, disabled=disabled)

    @rule(n=NUMBER, suspended=st.booleans())
    def suspend(self, n: int, suspended: bool) -> None:
        orders = sorted(self.shift.fleet.orders)
        if orders:
            self.do(SuspendOrders, orders=(orders[n % len(orders)],), suspended=suspended)

    @rule(paused=st.booleans())
    def pause_dispatch(self, paused: bool) -> None:
        self.do(PauseDispatch, scene=self.shift.scene, paused=paused)

    @rule(disabled=st.booleans())
    def disable_scene(self, disabled: bool) -> None:
        self.stopped_ms.clear()
        self.stands.clear()
        self.do(DisableScene, scene=self.shift.scene, disabled=disabled)

    @rule()
    def restart_scheduler(self) -> None:
        self.onlooker.restart_scheduler()
        self.stopped_ms = dict.fromkeys(self.stopped_ms, self.shift.now_ms)

    @rule(seconds=st.integers(3, 15))
    def run(self, seconds: int) -> None:
        self.shift.run(seconds, self.look)

    @rule(steps=st.integers(1, 10))
    def run_a_little(self, steps: int) -> None:
        self.shift.run(0.2 * steps, self.look)

    @rule(a=NUMBER, b=NUMBER, steps=st.integers(1, 40))
    def stop_on_the_way(self, a: int, b: int, steps: int) -> None:
        """Stop whoever drives, fast or slow."""
        self.carry(a, b)
        self.run_a_little(steps)
        robots = sorted(robot.name for robot in self.shift.fleet.robots.values())
        for robot in self.shift.world.robots():
            if robot.speed > 0.0:
                self.soft_stop(robots.index(RobotName(robot.body.name)), True)
        self.run(5)

    # -- what must hold

    def look(self) -> None:
        self.onlooker.nobody_overlaps()
        self.onlooker.bins_are_held_once()
        for robot in self.shift.world.robots():
            name = RobotName(robot.body.name)
            since_ms = self.stopped_ms.get(name)
            if since_ms is not None and self.shift.now_ms - since_ms >= STANDS_AFTER_MS:
                now = pose(robot)
                assert self.stands.setdefault(name, now) == now, f"{name} moves"

    @invariant()
    def states_agree(self) -> None:
        self.onlooker.states_agree()
        self.onlooker.each_order_ended_once()

    def teardown(self) -> None:
        """Lift everything; then every order ends."""
        self.stopped_ms.clear()
        self.stands.clear()
        for _ in range(END_ROUNDS_MAX):
            self.put_right()
            if not self.business():
                break
            self.shift.run(END_ROUND_S, self.look)
        self.states_agree()
        left = self.business()
        assert not left, (left, [r.hears for r in self.shift.world.robots()])

    def business(self) -> list[Order]:
        live = self.shift.fleet.orders.values()
        return [order for order in live if order.kind is OrderKind.BUSINESS]

    def put_right(self) -> None:
        scene = self.shift.scene
        robots = tuple(sorted(robot.name for robot in self.shift.fleet.robots.values()))
        self.do(DisableScene, scene=scene, disabled=False)
        self.do(PauseDispatch, scene=scene, paused=False)
        self.do(DisableRobots, scene=scene, robots=robots, disabled=False)
        for robot in self.shift.world.robots():
            self.shift.world.mend(scene, RobotName(robot.body.name))
        self.shift.run(1.0, self.look)
        of_robots = {"scene": scene, "robots": robots}
        self.do(SoftStopRobots, **of_robots, stopped=False)
        self.do(PauseRobots, **of_robots, paused=False)
        self.do(ControlRobots, **of_robots, taken=True)
        self.do(ClearRobotAlarms, **of_robots)
        self.do(ClearRobotBins, **of_robots)
        for order in self.business():
            self.do(SuspendOrders, orders=(order.id,), suspended=False)
            if order.fault_reason is not None and not self.forget_failing(order):
                self.do(RetryOrders, orders=(order.id,))

    def forget_failing(self, order: Order) -> bool:
        """What always fails is given up."""
        if not any("Fail" in (step.task.arguments or "") for step in order.steps):
            return False
        return self.do(CancelOrder, scene=self.shift.scene, order=order.id)


def pose(robot: SimRobot) -> tuple[float, ...]:
    return tuple(round(value, 9) for value in place(robot)[:3])


def test_who_is_stopped_stands_and_in_the_end_all_goes_on() -> None:
    run_state_machine_as_test(
        AnyInstruction,
        settings=settings(
            max_examples=12, stateful_step_count=20, deadline=None, suppress_health_check=SLOW
        ),
    )


def stage(seed: int) -> None:
    """For the soak: longer stories."""
    run_state_machine_as_test(
        hypothesis.seed(seed)(AnyInstruction),
        settings=settings(
            max_examples=20,
            stateful_step_count=50,
            deadline=None,
            database=None,
            suppress_health_check=SLOW,
        ),
    )
