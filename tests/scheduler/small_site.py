"""A small site: points on a line one second apart, traffic without collisions, robots that obey."""

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from itertools import pairwise

import msgspec
import shapely

from ledger.events import OrderCreated, RobotAdded, SceneImported
from ledger.ids import BinName, OrderId, PointName, RobotName, SceneId
from ledger.link import (
    Act,
    ActionPhase,
    ActionReport,
    Cancel,
    Drive,
    Plan,
    Report,
    TellRoute,
    ToRobot,
)
from ledger.scene import (
    XY,
    Area,
    Bin,
    BinTask,
    Door,
    Group,
    Path,
    Point,
    PointKind,
    RobotConfig,
)
from ledger.scene_config import SceneConfig
from ledger.state import StepTask
from scheduler.goal import Goal
from scheduler.traffic.doors import DoorNow
from scheduler.traffic.guard import Breach

SCENE = SceneId("5f0000000000000000000001")
ACTION_MS = 2_000
LENGTH = 20  # waypoints W0 … W19; then P0 … parking, C0 … charging


def area(parking: int = 4, charging: int = 2) -> Area:
    names = [f"W{n}" for n in range(LENGTH)]
    kinds = [PointKind.WAYPOINT] * LENGTH
    names += [f"P{n}" for n in range(parking)] + [f"C{n}" for n in range(charging)]
    kinds += [PointKind.PARKING] * parking + [PointKind.CHARGING] * charging
    points = tuple(
        Point(name=PointName(name), x_m=float(x), y_m=0.0, kind=kind)
        for x, (name, kind) in enumerate(zip(names, kinds, strict=True))
    )
    there = [Path(start=a.name, end=b.name) for a, b in pairwise(points)]
    back = [Path(start=p.end, end=p.start) for p in there]
    bins = tuple(
        Bin(
            name=BinName(f"B{n}"),
            point=PointName(f"W{n}"),
            tasks=(
                BinTask(name="Load", operation="JackLoad", arguments='{"height":1}'),
                BinTask(name="Unload", operation="JackUnload"),
            ),
        )
        for n in range(LENGTH)
    )
    return Area(
        id=1,
        name="ground",
        map_name="line",
        map_digest="0" * 32,
        points=points,
        paths=tuple(there + back),
        bins=bins,
    )


def imported(config: SceneConfig | None = None, **spots: int) -> SceneImported:
    return SceneImported(
        scene=SCENE,
        name="line",
        digest="d",
        areas=(area(**spots),),
        groups=(Group(id=0, name="AMR"), Group(id=1, name="forks")),
        config=config or SceneConfig(),
    )


def added(name: str, **config: object) -> RobotAdded:
    robot = RobotConfig(name=RobotName(name), **config)  # type: ignore[arg-type]
    return RobotAdded(scene=SCENE, config=robot)


def carry(number: int, start: str, end: str, **fields: object) -> OrderCreated:
    """Make an order that carries something from bin to bin."""
    tasks = (
        StepTask(location=start, arguments='{"binTask":"Load"}', loads=True, withdrawable=True),
        StepTask(location=end, arguments='{"binTask":"Unload"}', unloads=True),
    )
    return order(number, *tasks, **fields)


def order(number: int, *tasks: StepTask, **fields: object) -> OrderCreated:
    fields = {"sealed": True, **fields}
    id_ = OrderId(f"TO20260101-{number:06}")
    return OrderCreated(scene=SCENE, order=id_, tasks=tasks, **fields)  # type: ignore[arg-type]


class SmallTraffic:
    """Traffic on an empty line: whoever has a goal gets there at 1 m/s, through everybody else."""

    def __init__(self, scene: SceneId, area: Area, groups: Sequence[Group]) -> None:
        self.scene = scene
        self.at: dict[PointName, float] = {p.name: p.x_m for p in area.points}
        self.known: dict[RobotName, float | None] = {}  # where it ends up; None = not placed yet
        self.gone: set[RobotName] = set()
        self.breaches: list[Breach] = []
        self.excused: set[RobotName] = set()
        self.stuck: set[RobotName] = set()
        self.busy: AbstractSet[RobotName] = frozenset()
        self.goals: Mapping[RobotName, Goal] = {}
        self.last_ms: int | None = None
        self.claims: dict[str, tuple[str, tuple[tuple[XY, ...], ...], bool]] = {}
        self.tuned: SceneConfig | None = None

    def tune(self, config: SceneConfig) -> None:
        self.tuned = config

    @property
    def ready(self) -> bool:
        return all(x is not None or r in self.gone for r, x in self.known.items())

    def lay_doors(self, doors: Sequence[Door]) -> None:
        pass

    def follow_doors(self, now: Mapping[int, DoorNow]) -> None:
        pass

    def wanted_doors(self) -> Mapping[int, tuple[RobotName, ...]]:
        return {}

    def add(self, robot: RobotName, group: int) -> None:
        assert robot not in self.known, "added twice"
        self.known[robot] = None

    def remove(self, robot: RobotName) -> None:
        del self.known[robot]

    def observe(self, report: Report) -> None:
        self.known[report.robot] = report.x_m
        self.gone.discard(report.robot)

    def load(self, robot: RobotName, *, loaded: bool) -> None:
        assert robot in self.known

    def look(self, now_ms: int) -> list[Breach]:
        return self.breaches

    def excuse(self, robot: RobotName) -> None:
        self.excused.add(robot)

    breaches_so_far = 0

    def lost(self, robot: RobotName) -> None:
        assert robot in self.known
        self.gone.add(robot)

    def step(
        self, now_ms: int, goals: Mapping[RobotName, Goal], busy: AbstractSet[RobotName]
    ) -> list[Drive | TellRoute]:
        dt_s = 0.0 if self.last_ms is None else (now_ms - self.last_ms) / 1000
        self.last_ms, self.goals, self.busy = now_ms, goals, busy
        if not self.ready:
            return []
        for robot, goal in goals.items():
            x_m = self.known[robot]
            if x_m is not None and robot not in busy | self.stuck | self.gone:
                way_m = self.at[goal.point] - x_m
                self.known[robot] = round(x_m + max(-dt_s, min(dt_s, way_m)), 6)
        return []

    def stands_at(self, robot: RobotName, point: PointName) -> bool:
        return self.known[robot] == self.at[point]

    def cost_s(self, robot: RobotName, point: PointName) -> float:
        x_m = self.known[robot]
        if x_m is None or self.reserved(robot, point):
            return float("inf")
        return abs(self.at[point] - x_m)

    def has_room(self, robot: RobotName) -> bool:
        return True

    def reserved(self, robot: RobotName, point: PointName) -> tuple[str, ...]:
        """Owners of ground that holds the point; the line leads past it all the same."""
        here = shapely.Point(self.at[point], 0.0)
        return tuple(
            sorted(
                owner
                for owner, rings, _ in self.claims.values()
                if owner != robot and any(shapely.Polygon(ring).covers(here) for ring in rings)
            )
        )

    def claim(
        self, id_: str, owner: str, rings: Sequence[tuple[XY, ...]], *, owned: bool = False
    ) -> None:
        assert id_ not in self.claims, "claimed twice"
        self.claims[id_] = (owner, tuple(rings), owned)

    def unclaim(self, id_: str) -> None:
        del self.claims[id_]

    def claimed(self, id_: str) -> bool:
        """Ground is free once nobody but its owner stands on it."""
        owner, rings, owned = self.claims[id_]
        bodies = [
            shapely.Point(x, 0.0) for r, x in self.known.items() if r != owner and x is not None
        ]
        return owned or not any(shapely.Polygon(g).covers(b) for g in rings for b in bodies)

    pushes = 0
    plannings: Mapping[str, int] = {}
    ladder: Mapping[str, int] = {}

    def plans(self, now_ms: int) -> list[Plan]:
        return [
            Plan(
                scene=self.scene,
                robot=r,
                at_ms=now_ms,
                ready=x is not None,
                target=self.goals[r].point if r in self.goals else None,
            )
            for r, x in sorted(self.known.items())
        ]


class SmallRobots:
    """Robots that are where traffic takes them, and act when told. Also the link to them."""

    def __init__(self, traffic: dict[int, SmallTraffic]) -> None:
        self.traffic = traffic
        self.reports: dict[RobotName, Report] = {}
        self.told: list[ToRobot] = []
        self.ends_ms: dict[RobotName, int] = {}
        self.failing: set[str] = set()  # names of actions
        self.now_ms = 0

    def place(self, name: str, x_m: float, **fields: object) -> None:
        robot = RobotName(name)
        self.reports[robot] = Report(
            scene=SCENE,
            robot=robot,
            number=1,
            at_ms=0,
            area=1,
            x_m=x_m,
            y_m=0.0,
            heading_rad=0.0,
            session="s",
            **fields,  # type: ignore[arg-type]
        )

    def set(self, name: str, **fields: object) -> None:
        robot = RobotName(name)
        self.reports[robot] = msgspec.structs.replace(self.reports[robot], **fields)

    def tell(self, scene: SceneId, message: ToRobot) -> None:
        self.told.append(message)
        name = message.robot
        action = self.reports[name].action
        if isinstance(message, Act) and (action is None or action.id != message.id):
            assert action is None or action.phase is not ActionPhase.RUNNING
            self.set(
                name,
                action=ActionReport(id=message.id, phase=ActionPhase.RUNNING),
                charging=message.name == "Charge",
            )
            fails = message.name in self.failing
            self.ends_ms[name] = self.now_ms + (0 if fails else ACTION_MS)
            if fails:
                self._end(name, ActionPhase.FAILED)
        elif isinstance(message, Cancel) and action is not None and action.id == message.id:
            self._end(name, ActionPhase.DONE if self.reports[name].charging else ActionPhase.FAILED)

    def _end(self, name: RobotName, phase: ActionPhase) -> None:
        action = self.reports[name].action
        assert action is not None
        ended = ActionReport(id=action.id, phase=phase, message=phase)
        self.set(name, action=ended, charging=False)

    def step(self, now_ms: int) -> list[Report]:
        self.now_ms = now_ms
        points = {x: n for t in self.traffic.values() for n, x in t.at.items()}
        for name, report in self.reports.items():
            known = [t.known.get(name) for t in self.traffic.values()]
            x_m = next((x for x in known if x is not None), report.x_m)
            self.set(
                name,
                number=report.number + 1,
                at_ms=now_ms,
                x_m=x_m,
                point=points.get(x_m),
            )
            report = self.reports[name]
            running = report.action is not None and report.action.phase is ActionPhase.RUNNING
            if report.charging:
                self.set(name, battery_ratio=min(1.0, report.battery_ratio + 0.001))
            elif running and now_ms >= self.ends_ms[name]:
                self._end(name, ActionPhase.DONE)
        return [self.reports[name] for name in sorted(self.reports)]
