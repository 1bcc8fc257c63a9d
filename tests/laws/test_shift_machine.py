"""Anything a client may do, in any order, at a small site: the laws hold all along.

In the end everything is put right as people would do it, and every order ends.
"""

from typing import Any

import hypothesis
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
    run_state_machine_as_test,
)

from commands.orders import (
    CancelAllOrders,
    CancelOrder,
    CreateOrder,
    PrioritiseOrders,
    RetryOrders,
    SealOrder,
)
from commands.rejected import Rejected
from commands.resources import (
    ReleaseAllMapResources,
    ReleaseMapResources,
    RequestMapResources,
    UnitAsked,
)
from commands.robot_duty import ClearRobotBins, DisableRobots, SendRobotsOffDuty
from commands.steps import AddSteps, ChangeSteps, DeleteSteps, StepPatch
from fleetledger.shift import Shift
from ledger.ids import OrderId, RobotName
from ledger.state import Order, OrderKind, StepTask
from sim.faults import NONE, FaultMix
from sim.warehouses import generate
from tests.laws.onlooker import Onlooker, ask, bins_of, load, unload

ORDERS_MAX = 8  # live at once, so that the end comes soon
END_ROUND_S = 30.0
END_ROUNDS_MAX = 30
NUMBER = st.integers(0, 2**16)


class AnyShift(RuleBasedStateMachine):
    """Commands, good and bad, between stretches of time."""

    @initialize(robots=st.integers(2, 4), seed=st.integers(0, 99), delays=st.booleans())
    def open(self, robots: int, seed: int, delays: bool) -> None:
        file = generate(aisles=2, bays=2, robots=robots, seed=seed)
        faults = FaultMix(late_ratio=0.3, late_mean_s=4.0) if delays else NONE
        self.shift = Shift(file, seed=seed, faults=faults)
        self.onlooker = Onlooker(self.shift)
        self.file, self.bins = file, bins_of(file)
        self.points = [point.name for point in file.areas[0].points]
        self.onlooker.run(1.0)

    def do(self, kind: type, **fields: Any) -> bool:
        """Tell whether it was accepted; what is refused changes nothing."""
        before = self.shift.fleet.canonical()
        try:
            self.shift.handler.handle(ask(self.shift, kind, **fields))
        except Rejected:
            assert self.shift.fleet.canonical() == before
            return False
        return True

    def order(self, number: int) -> Order | None:
        orders = sorted(self.shift.fleet.orders)
        return self.shift.fleet.orders[orders[number % len(orders)]] if orders else None

    def robot(self, number: int) -> RobotName:
        robots = sorted(robot.name for robot in self.shift.fleet.robots.values())
        return robots[number % len(robots)]

    def bin(self, number: int) -> str:
        return self.bins[number % len(self.bins)]

    def create(self, sealed: bool, *tasks: StepTask, **fields: Any) -> bool:
        if len(self.shift.fleet.orders) >= ORDERS_MAX:
            return False
        scene = self.shift.scene
        return self.do(CreateOrder, scene=scene, sealed=sealed, tasks=tasks, **fields)

    @rule(a=NUMBER, b=NUMBER, sealed=st.booleans(), priority=st.integers(-2, 3))
    def carry(self, a: int, b: int, sealed: bool, priority: int) -> None:
        self.create(sealed, load(self.bin(a)), unload(self.bin(b)), priority=priority)

    @rule(n=NUMBER, robot=NUMBER)
    def visit(self, n: int, robot: int) -> None:
        point = StepTask(location=self.points[n % len(self.points)])
        self.create(True, point, wanted_robots=(self.robot(robot),))

    @rule(n=NUMBER)
    def promise(self, n: int) -> None:
        self.create(False, key_locations=(self.bin(n),))

    @rule(
        tasks=st.sampled_from(
            (
                (),
                (StepTask(location="nowhere"),),
                (StepTask(location="LM1", loads=True, unloads=True),),
                (StepTask(location="ST-01", arguments='{"binTask":"Juggle"}'),),
                (StepTask(location="ST-01", arguments='{"binTask":7}'),),
            )
        )
    )
    def nonsense(self, tasks: tuple[StepTask, ...]) -> None:
        scene = self.shift.scene
        assert not self.do(CreateOrder, scene=scene, sealed=True, tasks=tasks)

    @rule(n=NUMBER)
    def cancel(self, n: int) -> None:
        if order := self.order(n):
            assert self.do(CancelOrder, scene=self.shift.scene, order=order.id)
        assert not self.do(CancelOrder, scene=self.shift.scene, order=OrderId("TO-none"))

    @rule()
    def cancel_all(self) -> None:
        assert self.do(CancelAllOrders, scene=self.shift.scene)
        assert not self.shift.fleet.orders

    @rule(n=NUMBER, where=NUMBER, unloads=st.booleans())
    def add_step(self, n: int, where: int, unloads: bool) -> None:
        if order := self.order(n):
            task = unload(self.bin(where)) if unloads else StepTask(location=self.bin(where))
            assert self.do(AddSteps, order=order.id, tasks=(task,)) is not order.sealed

    @rule(n=NUMBER, step=st.integers(-1, 3), where=NUMBER)
    def change_step(self, n: int, step: int, where: int) -> None:
        if order := self.order(n):
            patch = StepPatch(step=step, location=self.bin(where))
            self.do(ChangeSteps, order=order.id, patches=(patch,))

    @rule(n=NUMBER, step=NUMBER)
    def delete_step(self, n: int, step: int) -> None:
        if (order := self.order(n)) and order.steps:
            gone = order.steps[step % len(order.steps)].id
            self.do(DeleteSteps, order=order.id, steps=(gone,))

    @rule(n=NUMBER)
    def seal(self, n: int) -> None:
        if order := self.order(n):
            self.do(SealOrder, order=order.id)

    @rule(n=NUMBER, priority=st.integers(-2, 9))
    def prioritise(self, n: int, priority: int) -> None:
        if order := self.order(n):
            assert self.do(PrioritiseOrders, orders=(order.id,), priority=priority)

    @rule(n=NUMBER, off=st.booleans())
    def off_duty(self, n: int, off: bool) -> None:
        robots = (self.robot(n),)
        assert self.do(SendRobotsOffDuty, scene=self.shift.scene, robots=robots, off_duty=off)

    @rule(n=NUMBER, disabled=st.booleans())
    def disable(self, n: int, disabled: bool) -> None:
        robots = (self.robot(n),)
        assert self.do(DisableRobots, scene=self.shift.scene, robots=robots, disabled=disabled)

    @rule(n=NUMBER, what=st.sampled_from(("Load", "Unload")))
    def break_an_action(self, n: int, what: str) -> None:
        robots = list(self.shift.world.robots())
        if robots:
            name = RobotName(robots[n % len(robots)].body.name)
            self.shift.world.fail_next(self.shift.scene, name, what)

    @rule(n=NUMBER)
    def clear(self, n: int) -> None:
        assert self.do(ClearRobotBins, scene=self.shift.scene, robots=(self.robot(n),))

    @rule(n=NUMBER, where=NUMBER, wide=st.floats(0.1, 4.0), owner=NUMBER)
    def reserve(self, n: int, where: int, wide: float, owner: int) -> None:
        point = self.file.areas[0].points[where % len(self.points)]
        x, y = point.x_m - wide / 3, point.y_m - wide / 4
        zone = ((x, y), (x + wide, y), (x + wide, y + wide), (x, y + wide))
        names = ("WMS", "MES", self.robot(owner))
        unit = UnitAsked(id=f"u{n % 4}", owner=names[owner % 3], zones=(zone,))
        self.do(RequestMapResources, units=(unit,))

    @rule(n=NUMBER)
    def give_back(self, n: int) -> None:
        assert self.do(ReleaseMapResources, units=(f"u{n % 4}",))

    @rule()
    def restart_scheduler(self) -> None:
        self.onlooker.restart_scheduler()

    @rule(seconds=st.integers(1, 20))
    def run(self, seconds: int) -> None:
        self.onlooker.run(seconds)

    @invariant()
    def laws(self) -> None:
        self.onlooker.look()
        self.onlooker.states_agree()
        self.onlooker.each_order_ended_once()

    def teardown(self) -> None:
        """Put everything right; then every order ends."""
        for _ in range(END_ROUNDS_MAX):
            self._put_right()
            if not self._business():
                break
            self.onlooker.run(END_ROUND_S)
        self.laws()
        assert not self._business()

    def _business(self) -> list[Order]:
        live = self.shift.fleet.orders.values()
        return [order for order in live if order.kind is OrderKind.BUSINESS]

    def _put_right(self) -> None:
        scene = self.shift.scene
        robots = tuple(sorted(robot.name for robot in self.shift.fleet.robots.values()))
        self.do(DisableRobots, scene=scene, robots=robots, disabled=False)
        self.do(SendRobotsOffDuty, scene=scene, robots=robots, off_duty=False)
        self.do(ClearRobotBins, scene=scene, robots=robots)
        self.do(ReleaseAllMapResources)
        for order in self._business():
            if order.fault_reason is not None:
                self.do(RetryOrders, orders=(order.id,))
            if not order.sealed and not self.do(SealOrder, order=order.id):
                self.do(CancelOrder, scene=scene, order=order.id)


SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]


def test_whatever_clients_do_the_laws_hold() -> None:
    run_state_machine_as_test(
        AnyShift,
        settings=settings(
            max_examples=25, stateful_step_count=25, deadline=None, suppress_health_check=SLOW
        ),
    )


def stage(seed: int) -> None:
    """For the soak: longer stories."""
    run_state_machine_as_test(
        hypothesis.seed(seed)(AnyShift),
        settings=settings(
            max_examples=20,
            stateful_step_count=60,
            deadline=None,
            database=None,
            suppress_health_check=SLOW,
        ),
    )
