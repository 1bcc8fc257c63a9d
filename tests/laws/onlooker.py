"""Looks on while a shift works, and holds it to the laws after every step."""

from collections import Counter
from collections.abc import Sequence

import msgspec
from shapely import Polygon

from commands.decide import AnyCommand
from fleetledger.shift import START_MS, Shift
from ledger.codec import decode, encode
from ledger.events import AnyEvent, OrderCancelled, OrderFinished
from ledger.events.orders import OfOrder
from ledger.evolve import evolve
from ledger.ids import CommandId, OrderId, RobotName, robot_key
from ledger.scene import SceneFile
from ledger.state import BinStatus, Fleet, Order, OrderKind, OrderStatus, StepTask
from scheduler.dispatch.reasons import NotAssigned, Why
from scheduler.traffic.judge import body, collisions
from sim.robot import place

WAITS_MS_MAX = 4_000  # without a reason; placing robots and compiling the map come before
ON_GROUND_M2 = 1e-6  # of somebody's body on ground that somebody else has reserved
CODES = frozenset(str(code) for code in NotAssigned)
REASONS = frozenset(str(reason) for reason in Why)


def load(location: str) -> StepTask:
    """Fetch what lies in a bin."""
    arguments = '{"binTask":"Load"}'
    return StepTask(location=location, arguments=arguments, loads=True, withdrawable=True)


def unload(location: str) -> StepTask:
    """Put it into a bin."""
    return StepTask(location=location, arguments='{"binTask":"Unload"}', unloads=True)


def bins_of(file: SceneFile) -> list[str]:
    """Name the bins of a scene."""
    return [place.name for area in file.areas for place in area.bins]


def ask(shift: Shift, kind: type[msgspec.Struct], **fields: object) -> AnyCommand:
    """Make a command of now."""
    made = kind(id=CommandId(shift.handler.new_id()), by="tests", at_ms=shift.now_ms, **fields)
    assert isinstance(made, AnyCommand)
    return made


class Onlooker:
    """Folds what the ledger tells, and looks at the world itself for where robots are."""

    def __init__(self, shift: Shift) -> None:
        self.shift = shift
        self.fold = Fleet()
        self.created: set[OrderId] = set()
        self.ends: Counter[OrderId] = Counter()
        self.scheduler_since_ms = START_MS
        self._hear(list(shift.ledger.read(0)))
        shift.ledger.listen(self._hear)

    def _hear(self, events: Sequence[AnyEvent]) -> None:
        for event in events:
            evolve(self.fold, decode(encode(event)))
            if not isinstance(event, OfOrder):
                continue
            assert not self.ends[event.order], f"{event} after the order's end"
            self.created.add(event.order)
            self.ends[event.order] += isinstance(event, OrderFinished | OrderCancelled)

    def run(self, seconds: float) -> None:
        """Let time pass under watch."""
        self.shift.run(seconds, self.look)

    def restart_scheduler(self) -> None:
        """Kill it, start another."""
        self.shift.restart_scheduler()
        self.scheduler_since_ms = self.shift.now_ms

    def look(self) -> None:
        """Check what must hold at every moment."""
        self.nobody_overlaps()
        self.nobody_is_on_reserved_ground()
        self.bins_are_held_once()
        self.waiting_has_a_reason()

    def nobody_overlaps(self) -> None:
        """True footprints at true poses."""
        bodies = self.bodies()
        for area in {area for area, _ in bodies}:
            of_area = {name: shape for (where, name), shape in bodies.items() if where == area}
            assert collisions(of_area) == [], f"at {self.shift.now_ms - START_MS} ms"

    def nobody_is_on_reserved_ground(self) -> None:
        """But the robot that has reserved it."""
        claims = [claim.unit for claim in self.shift.fleet.claims.values() if claim.granted]
        bodies = self.bodies() if claims else {}
        for unit in claims:
            for (area, name), shape in bodies.items():
                if area == unit.area and name != unit.owner:
                    on_it = [Polygon(zone).intersection(shape).area for zone in unit.zones]
                    assert max(on_it) < ON_GROUND_M2, (name, unit)

    def bodies(self) -> dict[tuple[int, RobotName], Polygon]:
        """Footprints by area and robot, from the simulated world and not from reports."""
        scene = self.shift.fleet.scenes[self.shift.scene]
        footprints = {group.id: group.footprint for group in scene.groups}
        bodies: dict[tuple[int, RobotName], Polygon] = {}
        for robot in self.shift.world.robots():
            config = self.shift.fleet.robots[robot_key(scene.id, RobotName(robot.body.name))].config
            x_m, y_m, heading_rad, _ = place(robot)
            shape = body(footprints[config.group], x_m, y_m, heading_rad)
            bodies[robot.body.area, config.name] = shape
        return bodies

    def bins_are_held_once(self) -> None:
        """A bin's order and an order's bin name each other, and nobody else does."""
        held: set[tuple[RobotName, int]] = set()
        for order in self.shift.fleet.orders.values():
            if order.robot is None or order.bin is None:
                assert order.robot is None and order.bin is None
                continue
            assert (order.robot, order.bin) not in held, f"two orders in one bin: {order}"
            held.add((order.robot, order.bin))
        for robot in self.shift.fleet.robots.values():
            mine = [o.id for o in self.shift.fleet.orders.values() if o.robot == robot.name]
            assert sorted(robot.orders) == sorted(mine)
            for number, content in enumerate(robot.bins):
                if content.status in (BinStatus.RESERVED, BinStatus.FILLED):
                    assert content.order is not None
                    order = self.shift.fleet.orders[content.order]
                    assert (order.robot, order.bin) == (robot.name, number)
                else:
                    assert (robot.name, number) not in held

    def waiting_has_a_reason(self) -> None:
        """Who waits longer than a moment is told why, in codes."""
        for order in self.shift.fleet.orders.values():
            since_ms = max(order.modified_ms, self.scheduler_since_ms)
            if not _waits(order) or self.shift.now_ms - since_ms <= WAITS_MS_MAX:
                continue
            reject = order.allocation_reject
            assert reject is not None, f"no reason: {order}"
            assert reject.code in CODES
            assert REASONS.issuperset(reject.robots.values())

    def states_agree(self) -> None:
        """The fold of what was written, the core's state and the followers' are one."""
        state = self.shift.fleet.canonical()
        assert self.fold.canonical() == state
        scheduler = self.shift.role.scheduler._fleet
        if scheduler.position == self.shift.fleet.position:
            assert scheduler.canonical() == state

    def each_order_ended_once(self) -> None:
        """Made orders are live or have ended, exactly once."""
        for order in self.created:
            assert self.ends[order] == (order not in self.shift.fleet.orders), order


def _waits(order: Order) -> bool:
    return (
        order.kind is OrderKind.BUSINESS
        and order.status is OrderStatus.TO_BE_ALLOCATED
        and order.fault_reason is None
    )
