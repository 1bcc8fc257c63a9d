"""Hypothesis strategies that several test packages share: values of any type, scenes, histories.

A history comes from a seed and a length, and a shorter one is a prefix of a longer one: it shrinks
by its length, and benchmarks may ask for a million events without Hypothesis.
"""

import types
from collections.abc import Iterator
from enum import Enum
from random import Random
from typing import Any, NewType, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
from hypothesis import strategies as st

from ledger.events import (
    EVENTS,
    AnyEvent,
    AssignmentRejected,
    CommandAnswered,
    Event,
    ExecutionRejected,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderFaulted,
    OrderFinished,
    OrderPrioritised,
    OrderRetried,
    OrderSealed,
    OrderWithdrawn,
    RobotAdded,
    RobotBinsCleared,
    RobotConnected,
    RobotDisabled,
    RobotDisconnected,
    RobotEnabled,
    RobotRemoved,
    RobotWentOffDuty,
    RobotWentOnDuty,
    SceneConfigured,
    SceneImported,
    SceneMapReplaced,
    StepChange,
    StepFinished,
    StepsAdded,
    StepsChanged,
    StepsDeleted,
    StepStarted,
    stamped,
)
from ledger.evolve import evolve
from ledger.ids import BinName, CommandId, OrderId, PointName, RobotName, SceneId
from ledger.scene import (
    Area,
    Bin,
    BinTask,
    Group,
    Path,
    Point,
    PointKind,
    RobotConfig,
    SceneFile,
)
from ledger.scene_config import SceneConfig
from ledger.state import (
    BinStatus,
    Candidate,
    Fleet,
    Order,
    OrderKind,
    OrderStatus,
    StepStatus,
    StepTask,
)

SCENE = SceneId("5f0c1e9a2b3c4d5e6f708192")
DAY_MS = 1_790_000_000_000  # some time in 2026, where histories begin

T = TypeVar("T")
_INTEGERS = st.integers(-(2**53), 2**53)
_FLOATS = st.floats(allow_nan=False, allow_infinity=False, width=64)


def values(of: type[T]) -> st.SearchStrategy[T]:
    """Any value of a msgspec struct, every field drawn by its type, defaults or not."""
    return st.deferred(lambda: _values(of))


def _values(of: Any) -> st.SearchStrategy[Any]:
    origin, args = get_origin(of), get_args(of)
    if isinstance(of, NewType):
        return _values(of.__supertype__)
    if of is type(None):
        return st.none()
    if of is bool:
        return st.booleans()
    if of is int:
        return _INTEGERS
    if of is float:
        return _FLOATS
    if of is str:
        return st.text(max_size=8)
    if origin in (Union, types.UnionType):
        return st.one_of([_values(arg) for arg in args])
    if origin is tuple and args[-1] is Ellipsis:
        return st.lists(values(args[0]), max_size=3).map(tuple)
    if origin is tuple:
        return st.tuples(*map(_values, args))
    if origin is dict:
        return st.dictionaries(_values(args[0]), values(args[1]), max_size=3)
    if isinstance(of, type) and issubclass(of, Enum):
        return st.sampled_from(of)
    assert isinstance(of, type) and issubclass(of, msgspec.Struct), of
    hints = get_type_hints(of)
    fields = {name: values(hints[name]) for name in of.__struct_fields__}
    return st.builds(of, **fields)


def any_events() -> st.SearchStrategy[AnyEvent]:
    """One event of any type with any content; it need not make sense after any other."""
    return st.sampled_from(sorted(EVENTS, key=lambda t: t.__name__)).flatmap(values)  # type: ignore[arg-type]


def events_of(kind: type[Event]) -> st.SearchStrategy[Event]:
    """One event of this type with any content."""
    return values(kind)


def grid(columns: int = 4, rows: int = 3, robots: int = 2, pitch_m: float = 3.0) -> SceneFile:
    """A grid of two-way straight paths; bins on the bottom row, chargers and parking on the top."""

    def name(column: int, row: int) -> PointName:
        prefix = "AP" if row == 0 else "CP" if row == rows - 1 and column == 0 else "LM"
        return PointName(f"{prefix}{row * columns + column + 1}")

    def kind(column: int, row: int) -> PointKind:
        if row == 0:
            return PointKind.ACTION
        if row < rows - 1:
            return PointKind.WAYPOINT
        return PointKind.CHARGING if column == 0 else PointKind.PARKING

    cells = [(c, r) for r in range(rows) for c in range(columns)]
    points = tuple(
        Point(name=name(c, r), x_m=c * pitch_m, y_m=r * pitch_m, kind=kind(c, r)) for c, r in cells
    )
    lanes = [((c, r), (c + 1, r)) for c, r in cells if c + 1 < columns]
    lanes += [((c, r), (c, r + 1)) for c, r in cells if r + 1 < rows]
    paths = tuple(
        Path(start=name(*a), end=name(*b)) for lane in lanes for a, b in (lane, lane[::-1])
    )
    tasks = (BinTask(name="load", operation="JackLoad"), BinTask(name="unload", operation="Unload"))
    bins = tuple(
        Bin(name=BinName(f"B{c + 1}"), point=name(c, 0), tasks=tasks) for c in range(columns)
    )
    area = Area(
        id=0,
        name="hall",
        map_name="hall",
        map_digest="0" * 32,
        points=points,
        paths=paths,
        bins=bins,
    )
    return SceneFile(
        name="grid",
        areas=(area,),
        groups=(Group(id=0, name="small"),),
        robots=tuple(robot_config(n) for n in range(robots)),
    )


def robot_config(number: int, bins: int = 1) -> RobotConfig:
    """A simulated robot, numbered from 0."""
    return RobotConfig(name=RobotName(f"R{number + 1}"), simulated=True, bin_count=bins)


def scene_files() -> st.SearchStrategy[SceneFile]:
    """Small connected scenes with bins, a charger and robots."""
    return st.builds(grid, st.integers(2, 5), st.integers(2, 5), st.integers(1, 4))


def robot_configs() -> st.SearchStrategy[RobotConfig]:
    """Robots as scenes hold them."""
    return st.builds(robot_config, st.integers(0, 99), st.integers(1, 3))


def histories(min_events: int = 0, max_events: int = 120) -> st.SearchStrategy[list[AnyEvent]]:
    """Stamped events from position 1 that evolve accepts in this order, from an empty fleet."""
    return st.builds(history, st.integers(0, 2**16), st.integers(min_events, max_events))


def history(seed: int, count: int, scene: SceneId = SCENE) -> list[AnyEvent]:
    """Give the first `count` events of the history with this seed."""
    happening = happenings(seed, scene)
    return [next(happening) for _ in range(count)]


def happenings(seed: int, scene: SceneId = SCENE) -> Iterator[AnyEvent]:
    """Go on for ever: a scene with robots and the lives of orders, each event evolved."""
    random = Random(seed)
    fleet = Fleet()
    for blank in _openings(scene):
        yield _happen(random, fleet, blank)
    while True:
        blank = _next(random, fleet, scene)
        if blank is not None:
            yield _happen(random, fleet, blank)


def _happen(random: Random, fleet: Fleet, blank: AnyEvent) -> AnyEvent:
    position = fleet.position + 1
    at_ms = max(fleet.at_ms, DAY_MS) + random.choice((0, 0, 1, 40, 2_000))
    by = random.choice(("alice", "scheduler"))
    command = CommandId(f"c{position}")
    if isinstance(blank, CommandAnswered):
        by, command = "alice", CommandId(f"key-{position}")
    event = stamped(blank, position, at_ms, by, command)
    evolve(fleet, event)
    return event


def _openings(scene: SceneId) -> Iterator[AnyEvent]:
    file = grid(robots=3)
    yield SceneImported(
        scene=scene, name=file.name, digest="d" * 64, areas=file.areas, groups=file.groups
    )
    for config in file.robots:
        yield RobotAdded(scene=scene, config=config)
        yield RobotConnected(scene=scene, robot=config.name)


def _next(random: Random, fleet: Fleet, scene: SceneId) -> AnyEvent | None:
    roll = random.random()
    if roll < 0.12 or not fleet.orders:
        return _created(random, fleet, scene) if len(fleet.orders) < 40 else None
    if roll < 0.90:
        order = fleet.orders[random.choice(list(fleet.orders))]
        may = _life(random, fleet, order)
        return random.choice(may) if may else None
    if roll < 0.98:
        return _of_robot(random, fleet, scene)
    if roll < 0.985:
        file = grid(columns=random.randint(4, 5), robots=0)
        return SceneMapReplaced(
            scene=scene,
            digest=f"{random.getrandbits(64):064x}",
            areas=file.areas,
            groups=file.groups,
        )
    if roll < 0.99:
        return SceneConfigured(
            scene=scene, config=SceneConfig(withdrawn_cost_min=float(random.randint(0, 9)))
        )
    return CommandAnswered(scene=scene, digest="a" * 64, status=200, body='{"ok":true}')


def _created(random: Random, fleet: Fleet, scene: SceneId) -> OrderCreated:
    day = "20260922"
    number = fleet.order_counts.get(day, 0) + 1
    return OrderCreated(
        scene=scene,
        order=OrderId(f"TO{day}-{number:06}"),
        kind=OrderKind.BUSINESS,
        external_id=f"wms-{number}" if random.random() < 0.5 else None,
        priority=random.randint(-5, 100),
        container=f"C{number}" if random.random() < 0.5 else None,
        sealed=random.random() < 0.7,
        tasks=_tasks(random),
    )


def _tasks(random: Random) -> tuple[StepTask, ...]:
    where = [f"B{random.randint(1, 4)}" for _ in range(random.randint(1, 3))]
    last = len(where) - 1
    return tuple(
        StepTask(
            location=location,
            arguments='{"binTask": "load"}' if n == 0 else None,
            loads=n == 0 and last > 0,
            unloads=n == last and last > 0,
            withdrawable=n == 0,
        )
        for n, location in enumerate(where)
    )


def _life(random: Random, fleet: Fleet, order: Order) -> list[AnyEvent]:
    """Give what may happen to the order next; likely things are there more than once."""
    scene, id_ = order.scene, order.id
    coming = range(max(order.current_step, order.done_step) + 1, len(order.steps))
    may: list[AnyEvent] = []
    if random.random() < 0.1:
        may.append(OrderPrioritised(scene=scene, order=id_, priority=random.randint(0, 9)))
    if random.random() < 0.1:
        may.append(OrderCancelled(scene=scene, order=id_))
    if not order.sealed:
        may.append(StepsAdded(scene=scene, order=id_, tasks=_tasks(random)))
        may += [OrderSealed(scene=scene, order=id_)] * 3
        if coming:
            change = StepChange(step=coming[0], task=StepTask(location="B1"))
            may.append(StepsChanged(scene=scene, order=id_, changes=(change,)))
        if len(coming) > 1:
            gone = (order.steps[coming[-1]].id,)
            may.append(StepsDeleted(scene=scene, order=id_, steps=gone))
    if order.robot is None:
        return may + _waiting(random, fleet, order)
    return may + _going(random, order, coming)


def _waiting(random: Random, fleet: Fleet, order: Order) -> list[AnyEvent]:
    free = [
        (robot, number)
        for robot in fleet.robots.values()
        if robot.online and not robot.off_duty and not robot.config.disabled
        for number, content in enumerate(robot.bins)
        if content.status is BinStatus.EMPTY
    ]
    if not free:
        robots = dict.fromkeys((r.name for r in fleet.robots.values()), "RobotBusy")
        code = "AllRobotUnDispatchable"
        if order.allocation_reject is not None and order.allocation_reject.robots == robots:
            return []  # only news is stated
        return [AssignmentRejected(scene=order.scene, order=order.id, code=code, robots=robots)]
    robot, number = random.choice(free)
    cost_s = round(random.uniform(1, 60), 3)
    assigned = OrderAssigned(
        scene=order.scene,
        order=order.id,
        robot=robot.name,
        bin=number,
        cost_s=cost_s,
        candidates=(Candidate(robot=robot.name, cost_s=cost_s),),
    )
    return [assigned] * 4


def _going(random: Random, order: Order, coming: range) -> list[AnyEvent]:
    scene, id_, robot = order.scene, order.id, order.robot
    assert robot is not None
    if order.fault_reason is not None:
        return [OrderRetried(scene=scene, order=id_)] * 4
    may: list[AnyEvent] = []
    if random.random() < 0.1:
        may.append(OrderFaulted(scene=scene, order=id_, reason="JackFailed"))
        may.append(ExecutionRejected(scene=scene, order=id_, code="Blocked", robots={robot: "R9"}))
        may.append(ExecutionRejected(scene=scene, order=id_, code=""))
        if not order.loaded:
            may.append(OrderWithdrawn(scene=scene, order=id_, robot=robot, reason="Cheaper"))
    now = order.current_step
    if 0 <= now < len(order.steps) and order.steps[now].status is StepStatus.EXECUTING:
        may += [StepFinished(scene=scene, order=id_, step=now, robot=robot)] * 8
    elif coming:
        may += [StepStarted(scene=scene, order=id_, step=coming[0], robot=robot)] * 8
    elif order.sealed and order.status is OrderStatus.PENDING:
        may += [OrderFinished(scene=scene, order=id_)] * 8
    return may


def _of_robot(random: Random, fleet: Fleet, scene: SceneId) -> AnyEvent | None:
    if not fleet.robots or (len(fleet.robots) < 12 and random.random() < 0.1):
        taken = {r.name for r in fleet.robots.values()}
        config = next(c for c in map(robot_config, range(99)) if c.name not in taken)
        return RobotAdded(scene=scene, config=config)
    robot = fleet.robots[random.choice(list(fleet.robots))]
    name = robot.name
    if not robot.online:
        return RobotConnected(scene=scene, robot=name)
    if robot.off_duty:
        return RobotWentOnDuty(scene=scene, robot=name)
    if robot.config.disabled:
        return RobotEnabled(scene=scene, robot=name)
    if any(b.status is BinStatus.CANCELLED for b in robot.bins):
        return RobotBinsCleared(scene=scene, robot=name)
    may: list[AnyEvent] = [
        RobotDisconnected(scene=scene, robot=name),
        RobotWentOffDuty(scene=scene, robot=name),
        RobotDisabled(scene=scene, robot=name),
    ]
    if not robot.orders and len(fleet.robots) > 2:
        may.append(RobotRemoved(scene=scene, robot=name))
    return random.choice(may)
