"""Views for the phases: a fleet, where its robots stand, and roads on a line."""

from collections.abc import Mapping, Set

from hypothesis import strategies as st

from ledger.events import (
    AnyEvent,
    OrderCreated,
    RobotConnected,
    RobotDisabled,
    RobotWentOffDuty,
)
from ledger.ids import PointName, RobotName
from ledger.link import Alarm, AlarmLevel, Report
from ledger.scene_config import DispatchMethod, SceneConfig
from ledger.state import OrderKind, OrderStatus
from scheduler.current import current
from scheduler.places import find_places
from scheduler.view import RobotView, View
from tests.scheduler.small_core import SmallCore
from tests.scheduler.small_site import LENGTH, SCENE, added, carry, imported

NOW_MS = 1_000_000


class Line:
    """Roads on a line at 1 m/s; some points cannot be reached."""

    def __init__(
        self,
        x_m: Mapping[str, float],
        points: Mapping[str, float],
        cut: set[str],
        owners: Mapping[str, tuple[str, ...]] | None = None,
        crowded: Set[str] = frozenset(),
    ) -> None:
        self.x_m, self.points, self.cut = x_m, points, cut
        self.owners = owners or {}
        self.crowded = crowded

    def stands_at(self, robot: RobotName, point: PointName) -> bool:
        return self.x_m[robot] == self.points[point]

    def cost_s(self, robot: RobotName, point: PointName) -> float:
        if point in self.cut or point in self.owners:
            return float("inf")
        return abs(self.x_m[robot] - self.points[point])

    def has_room(self, robot: RobotName) -> bool:
        return robot not in self.crowded

    def reserved(self, robot: RobotName, point: PointName) -> tuple[str, ...]:
        return self.owners.get(point, ())


class Situation:
    """A fleet and what its robots report; gives views."""

    def __init__(self, config: SceneConfig | None = None, **spots: int) -> None:
        self.core = SmallCore()
        self.core.happen(imported(config, **spots))
        self.reports: dict[RobotName, Report] = {}
        self.cut: set[str] = set()  # points that no route leads to
        self.owners: dict[str, tuple[str, ...]] = {}  # of reserved ground, by point
        self.unready: set[str] = set()
        self.crowded: dict[str, tuple[RobotName, ...]] = {}  # no room for its load, for these
        self.still_since_ms: dict[str, int] = {}
        self.charging_since_ms: dict[str, int] = {}

    def happen(self, *events: AnyEvent) -> None:
        self.core.happen(*events)

    def robot(self, name: str, x_m: float, *, online: bool = True, **config: object) -> None:
        """Add a robot; keywords are of RobotConfig."""
        self.happen(added(name, **config))
        if online:
            self.happen(RobotConnected(scene=SCENE, robot=RobotName(name)))
        self.report(name, x_m)

    def report(self, name: str, x_m: float, **fields: object) -> None:
        scene = self.core.fleet.scenes[SCENE]
        points = {p.x_m: p.name for area in scene.areas for p in area.points}
        self.reports[RobotName(name)] = Report(
            scene=SCENE,
            robot=RobotName(name),
            number=1,
            at_ms=0,
            area=1,
            x_m=x_m,
            y_m=0.0,
            heading_rad=0.0,
            point=points.get(x_m),
            **fields,  # type: ignore[arg-type]
        )

    def view(self, *, reallocate: bool = False) -> View:
        fleet = self.core.fleet
        scene = fleet.scenes[SCENE]
        robots = {}
        for key in sorted(fleet.robots):
            robot = fleet.robots[key]
            orders = tuple(fleet.orders[o] for o in robot.orders)
            robots[robot.name] = RobotView(
                name=robot.name,
                robot=robot,
                orders=orders,
                at=current(orders),
                report=self.reports.get(robot.name),
                ready=robot.name not in self.unready,
                blocked_by=self.crowded.get(robot.name, ()),
                still_since_ms=self.still_since_ms.get(robot.name, 0),
                charging_since_ms=self.charging_since_ms.get(robot.name),
            )
        waiting = [
            o
            for o in fleet.orders.values()
            if o.status is OrderStatus.TO_BE_ALLOCATED and o.kind is OrderKind.BUSINESS
        ]
        points = {p.name: p.x_m for area in scene.areas for p in area.points}
        return View(
            scene=scene,
            places=find_places(scene),
            robots=robots,
            waiting=sorted(waiting, key=lambda o: (-o.priority, o.created_ms, o.id)),
            roads=Line(
                {n: r.x_m for n, r in self.reports.items()},
                points,
                self.cut,
                self.owners,
                self.crowded.keys(),
            ),
            reallocate=reallocate,
        )


@st.composite
def situations(
    draw: st.DrawFn, *, method: DispatchMethod | None = None, priorities: int = 3
) -> Situation:
    """Draw a fleet in any condition, and orders that want any robots."""
    config = SceneConfig(
        dispatch_method=method or draw(st.sampled_from(DispatchMethod)),
        dispatch_wait_s_max=draw(st.sampled_from([600, 900])),
    )
    found = Situation(config)
    names = [f"R{n}" for n in range(draw(st.integers(0, 6)))]
    for name in names:
        group, bins = draw(st.integers(0, 1)), draw(st.integers(1, 3))
        online = draw(st.integers(0, 4)) > 0
        x_m = float(draw(st.integers(0, LENGTH + 5)))
        found.robot(name, x_m, online=online, group=group, bin_count=bins)
        trouble = draw(st.integers(0, 12))
        if trouble == 1:
            found.happen(RobotDisabled(scene=SCENE, robot=RobotName(name)))
        elif trouble == 2:
            found.happen(RobotWentOffDuty(scene=SCENE, robot=RobotName(name)))
        elif trouble == 3:
            alarm = Alarm(level=AlarmLevel.ERROR, code="E", message="broken")
            found.report(name, x_m, alarms=(alarm,))
        elif trouble == 4:
            found.unready.add(name)
        elif trouble == 5:
            found.report(name, x_m, battery_ratio=0.1)
        elif trouble == 6:
            found.report(name, x_m, battery_ratio=0.25)
    found.cut = {f"W{n}" for n in draw(st.sets(st.integers(0, LENGTH - 1), max_size=3))}
    for n in range(draw(st.integers(0, 14))):
        found.core.now_ms = draw(st.sampled_from([0, 300_000, 900_000]))
        found.happen(_order(draw, n, names, priorities))
    found.core.now_ms = NOW_MS
    return found


def _order(draw: st.DrawFn, n: int, names: list[str], priorities: int) -> OrderCreated:
    start, end = draw(st.integers(0, LENGTH - 1)), draw(st.integers(0, LENGTH - 1))
    wanted = draw(st.sets(st.sampled_from(names), max_size=2)) if names else set()
    groups = draw(st.sampled_from([(), (), ("AMR",), ("forks",), ("AMR", "forks")]))
    return carry(
        n,
        f"B{start}",
        f"B{end}",
        priority=draw(st.integers(0, priorities - 1)),
        wanted_robots=tuple(RobotName(w) for w in sorted(wanted)) if draw(st.booleans()) else (),
        wanted_groups=groups,
    )
