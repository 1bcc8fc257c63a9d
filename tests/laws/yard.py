"""Simulated robots with kinematics under traffic alone: no core, no dispatch, orders at random.

The robots are those of `sim` with its faults, the judge goes by their true polygons, and what a
fault mix has for the surroundings (closed paths, reserved ground, strangers, restarts) happens too.
"""

import math
import random
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import DISPATCHER, Report
from ledger.scene import XY, Area, Group, RobotConfig, Scene
from ledger.scene_config import SceneConfig
from scheduler.goal import Goal
from scheduler.traffic.judge import bodies_at, collisions, double_grants, outside
from scheduler.traffic.traffic import Traffic
from sim.faults import NONE, FaultMix
from sim.robot import SimRobot, place
from sim.world import World
from tests.stands import STALL_MS, Stands
from tests.surroundings import Stranger

SCENE = SceneId("0123456789abcdef01234567")
GROUP = Group(id=0, name="g")
STEP_MS = 200
REPORT_MS = 1_000  # everybody, news or not
SILENT_MS = 10_000  # then a robot counts as lost
LOOK_MS = 1_000  # between two looks for who stands without a cause
LANE_MAX = 2  # orders at a time into one aisle (design notes, traffic §11 rule 10)
SETTLED_MS = 2_000  # after people have moved a robot, until it is where it says


class Yard:
    """Deterministic by its seed."""

    def __init__(
        self,
        area: Area,
        starts: Mapping[str, tuple[str, float]] | int,
        goals: Sequence[PointName],
        *,
        seed: int = 0,
        mix: FaultMix = NONE,
        service_s: float = 5.0,
        groups: tuple[Group, ...] = (GROUP,),
        lane_of: Mapping[PointName, str] | None = None,
        endless: bool = True,
    ) -> None:
        self.area, self.groups, self.mix, self.service_s = area, groups, mix, service_s
        self.chance = random.Random(seed)
        self.now_ms = 1_000_000
        self.scene = Scene(id=SCENE, name="yard", digest="", areas=(area,), groups=groups)
        self.world = World(random.Random(seed + 1), mix)
        self.points = {point.name: point for point in area.points}
        self.outline = shapely.Polygon(groups[0].footprint)
        self._place(starts)
        self.goal_points, self.lane_of = list(goals), dict(lane_of or {})
        self.endless = endless  # orders at random, without end
        self.orders: dict[RobotName, list[PointName]] = {name: [] for name in self.robots}
        self.goals: dict[RobotName, Goal] = {}
        self.busy: dict[RobotName, int] = {}
        self.done: Counter[RobotName] = Counter()
        self.ordered_ms = dict.fromkeys(self.robots, self.now_ms)
        self.heard: dict[RobotName, Report] = {}
        self.heard_ms = dict.fromkeys(self.robots, self.now_ms)
        self.moved_ms = dict.fromkeys(self.robots, self.now_ms)
        self.people_ms: dict[RobotName, int] = {}  # when they last had a robot in hand
        self.strays: set[RobotName] = set()  # people left them on reserved ground …
        self.amid: set[RobotName] = set()  # … and on what another robot was granted
        self.poses: dict[RobotName, tuple[float, float, float]] = {}
        self.claims: dict[str, tuple[str, tuple[XY, ...]]] = {}
        self.owned: set[str] = set()
        self.ends_ms: dict[str, int] = {}
        self.strangers: dict[str, Stranger] = {}
        self.due_ms: dict[str, float] = {}
        self.happened: Counter[str] = Counter()
        self.longest_ms = 0  # that an order has taken
        self.still_ms = 0  # that a robot with an order stood, whatever the reason
        self.stands = Stands()
        self.planning_s = 0.0  # of processor time
        self._claims = 0
        self.config = SceneConfig()
        self.traffic = self._traffic()

    def tune(self, config: SceneConfig) -> None:
        """Have traffic work by these settings."""
        self.config = config
        self.traffic.tune(config)

    def _place(self, starts: Mapping[str, tuple[str, float]] | int) -> None:
        names = [f"R{k:03}" for k in range(starts)] if isinstance(starts, int) else sorted(starts)
        self.robots: dict[RobotName, SimRobot] = {}
        for name in names:
            config = RobotConfig(name=RobotName(name), group=self.groups[0].id, simulated=True)
            assert self.world.add(self.scene, config, self.now_ms), f"no room for {name}"
        for robot in self.world.robots():
            self.robots[robot.body.name] = robot
            if not isinstance(starts, int):
                point, robot.heading = starts[robot.body.name]
                robot.point = PointName(point)
                robot.x, robot.y = self.points[robot.point].x_m, self.points[robot.point].y_m

    def _traffic(self) -> Traffic:
        traffic = Traffic(SCENE, self.area, self.groups)
        traffic.tune(self.config)
        for name in self.robots:
            traffic.add(name, self.groups[0].id)
        return traffic

    def restart(self) -> None:
        """A new scheduler: it knows the claims, what of them was granted, and the last plans."""
        plans = self.traffic.plans(self.now_ms)
        self.traffic = self._traffic()
        for plan in plans:
            self.traffic.remember(plan)
        for id_, (owner, ring) in sorted(self.claims.items()):
            self.traffic.claim(id_, owner, (ring,), owned=id_ in self.owned)

    def calm(self) -> None:
        """From now on nothing goes wrong any more, and all ground is given back."""
        self.mix = NONE
        self.world.calm()
        for id_ in list(self.claims):
            self.release(id_)

    # -- one step

    def tick(self) -> None:
        self.now_ms += STEP_MS
        self.world.step(STEP_MS / 1000)
        self._surroundings()
        whole = {SCENE} if self.now_ms % REPORT_MS < STEP_MS else set()
        reports = self.world.reports(self.now_ms, changed_only=True, whole=whole)
        began = time.process_time()
        for report in reports:
            self.heard[report.robot], self.heard_ms[report.robot] = report, self.now_ms
            self.traffic.observe(report)
        for name, at_ms in self.heard_ms.items():
            if self.now_ms - at_ms > SILENT_MS:
                self.traffic.lost(name)
        self._orders()
        held = {n for n, report in self.heard.items() if report.controller != DISPATCHER}
        for message in self.traffic.step(self.now_ms, self.goals, self.busy.keys() | held):
            self.world.tell(SCENE, message)
        self.planning_s += time.process_time() - began
        self.owned = {id_ for id_ in self.claims if self.traffic.claimed(id_)}
        self._look()

    def _orders(self) -> None:
        for name in self.robots:
            goal = self.goals.get(name)
            if name in self.busy:
                if self.now_ms >= self.busy[name]:
                    del self.busy[name], self.goals[name]
                    self.done[name] += 1
            elif goal is not None and self.traffic.stands_at(name, goal.point):
                self.busy[name] = self.now_ms + int(self.service_s * 1000)
            elif goal is None:
                point = self._next_goal(name)
                if point is not None:
                    self.goals[name] = Goal(point=point, rank=(0, self.now_ms, name))
                    self.ordered_ms[name] = self.moved_ms[name] = self.now_ms

    def _next_goal(self, name: RobotName) -> PointName | None:
        if self.orders[name]:
            return self.orders[name].pop(0)
        if not self.endless:
            return None
        taken = {other.point for other in self.goals.values()}
        full = Counter(self.lane_of[p] for p in taken if p in self.lane_of)
        free = [p for p in self.goal_points if p not in taken]
        free = [p for p in free if full.get(self.lane_of.get(p, ""), 0) < LANE_MAX]
        if not free:
            return None
        point = self.chance.choice(free)
        return point if self.traffic.cost_s(name, point) < math.inf else None

    # -- the surroundings

    def _surroundings(self) -> None:
        for id_ in self.strangers.keys() & self.owned:
            self.strangers[id_] = self.strangers[id_].further(STEP_MS / 1000)
            if self.strangers[id_].gone:
                self.ends_ms[id_] = self.now_ms
        for id_ in [i for i, end_ms in self.ends_ms.items() if self.now_ms >= end_ms]:
            self.release(id_)
        mix = self.mix
        for what, per_h, mean_s in (
            ("closed", mix.closed_per_h, mix.closed_mean_s),
            ("reserved", mix.reserved_per_h, mix.reserved_mean_s),
            ("stranger", mix.stranger_per_h, 0.0),
            ("restart", mix.scheduler_restarts_per_h, 0.0),
        ):
            if not per_h:
                continue
            if self.now_ms >= self.due_ms.get(what, math.inf):
                self.happened[what] += 1
                self._happen(what, mean_s)
                del self.due_ms[what]
            if what not in self.due_ms:
                wait_ms = self.chance.expovariate(per_h / 3_600_000)
                self.due_ms[what] = self.now_ms + wait_ms

    def _happen(self, what: str, mean_s: float) -> None:
        if what == "restart":
            self.restart()
            return
        path = self.chance.choice(self.area.paths)
        a, b = ((self.points[n].x_m, self.points[n].y_m) for n in (path.start, path.end))
        ring: tuple[XY, ...]
        if what == "closed":
            ring = tuple(
                map(tuple, shapely.get_coordinates(shapely.LineString((a, b)).buffer(0.05)))
            )
        elif what == "reserved":
            x, y = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
            wide, high = self.chance.uniform(0.3, 1.5), self.chance.uniform(0.3, 1.5)
            ring = ((x, y), (x + wide, y), (x + wide, y + high), (x, y + high))
        else:
            stranger = Stranger(start=a, end=b)
            ring = stranger.ground()
        polygon = shapely.Polygon(ring)
        if any(shapely.Polygon(other).intersects(polygon) for _, other in self.claims.values()):
            return
        id_ = self.reserve(what, ring)
        if what == "stranger":
            self.strangers[id_] = stranger
            self.ends_ms[id_] = self.now_ms + 120_000  # it does not wait for longer
        else:
            self.ends_ms[id_] = self.now_ms + int(1000 * self.chance.expovariate(1 / mean_s))

    def reserve(self, owner: str, ring: tuple[XY, ...]) -> str:
        self._claims += 1
        id_ = f"c{self._claims}"
        self.claims[id_] = (f"{owner}-{id_}", ring)
        self.traffic.claim(id_, f"{owner}-{id_}", (ring,))
        return id_

    def release(self, id_: str) -> None:
        del self.claims[id_]
        self.owned.discard(id_)
        self.ends_ms.pop(id_, None)
        self.strangers.pop(id_, None)
        self.traffic.unclaim(id_)

    # -- looking on

    def _look(self) -> None:
        for name, robot in self.robots.items():
            pose = place(robot)[:3]
            if pose != self.poses.get(name) or name not in self.goals or name in self.busy:
                self.moved_ms[name] = self.now_ms
            self.poses[name] = pose
            self.still_ms = max(self.still_ms, self.now_ms - self.moved_ms[name])
            if name in self.goals:
                self.longest_ms = max(self.longest_ms, self.now_ms - self.ordered_ms[name])
        for key, trouble in self.world.troubles.items():
            if trouble in ("jump", "hand"):
                name = RobotName(key.split("/")[1])
                self.people_ms[name] = self.now_ms
                self.strays.add(name)
                self.amid.add(name)
        stood = Stands.long(self.moved_ms, self.now_ms)
        if stood and self.now_ms % LOOK_MS < STEP_MS:
            plans = {plan.robot: plan for plan in self.traffic.plans(self.now_ms)}
            struck = {RobotName(key.split("/")[1]) for key in self.world.troubles}
            late = {name for name, robot in self.robots.items() if robot.held_s > 0.0}
            self.stands.look(stood, self.moved_ms, plans, late | struck, self.now_ms)

    def bodies(self, names: Sequence[RobotName] | None = None) -> dict[RobotName, shapely.Polygon]:
        chosen = list(self.robots) if names is None else names
        poses = np.array([place(self.robots[name])[:3] for name in chosen]).reshape(-1, 3)
        return dict(zip(chosen, bodies_at(self.outline, poses), strict=True))

    def nobody_overlaps(self) -> None:
        """True bodies of robots and of strangers, and of robots and granted ground."""
        near = near_others(self.robots)
        if near:
            met = [pair for pair in collisions(self.bodies(near)) if not self.excused(pair)]
            assert not met, f"at {self.now_ms - 1_000_000} ms: {met}"
        grounds = {id_: shapely.Polygon(self.claims[id_][1]) for id_ in self.owned}
        bodies = self.bodies(self._near(grounds.values()))
        on = {
            (name, self.claims[id_][0])
            for id_, ground in grounds.items()
            for name, shape in bodies.items()
            if shape.intersection(ground).area > 1e-6
        }
        self.strays = {n for n in self.strays if self.in_hand(n) or n in dict(on)}
        wrong = {(name, owner) for name, owner in on if name not in self.strays}
        assert not wrong, f"on reserved ground at {self.now_ms - 1_000_000} ms: {wrong}"
        for id_ in self.strangers.keys() & self.owned:
            shape = shapely.Polygon(self.strangers[id_].corners())
            hit = [n for n, b in bodies.items() if n not in self.strays and shape.intersects(b)]
            assert not hit, f"with the foreign vehicle {id_} at {self.now_ms - 1_000_000} ms: {hit}"

    def excused(self, pair: tuple[RobotName, RobotName]) -> bool:
        """May these two overlap: never, but for whom a run says otherwise."""
        return False

    def _near(self, grounds: Collection[shapely.Polygon]) -> list[RobotName]:
        """Robots whose discs reach into the boxes round these."""
        found: dict[RobotName, None] = {}
        for left, low, right, high in (ground.bounds for ground in grounds):
            for name, robot in self.robots.items():
                (x, y, _, _), reach_m = place(robot), robot.body.radius_m
                if left - reach_m < x < right + reach_m and low - reach_m < y < high + reach_m:
                    found[name] = None
        return list(found)

    def in_hand(self, name: RobotName) -> bool:
        """Do people drive or push it just now, or have they just let go of it."""
        return self.now_ms - self.people_ms.get(name, 0) <= SETTLED_MS

    def grants_hold(self) -> None:
        """Exclusive and contained, by polygons (design notes §8, 1 and 2)."""
        plans = self.traffic.plans(self.now_ms)
        twice = double_grants(plans)
        wrong = [pair for pair in twice if self.amid.isdisjoint(pair)]
        assert not wrong, f"granted twice at {self.now_ms - 1_000_000} ms: {wrong}"
        met = {name for pair in twice for name in pair}
        self.amid = {name for name in self.amid if self.in_hand(name) or name in met}
        for plan in plans:
            if plan.spaces and not self.in_hand(plan.robot):
                shape = self.bodies([plan.robot])[plan.robot]
                assert not outside(plan, shape), plan

    def run(self, seconds: float, *, judge_every: int = 1, grants_every: int = 3) -> None:
        for k in range(round(seconds * 1000 / STEP_MS)):
            self.tick()
            if k % judge_every == 0:
                self.nobody_overlaps()
            if grants_every and k % grants_every == 0:
                self.grants_hold()

    def finish(self, seconds: float) -> float:
        """Run until all orders are done, and give how long that took; fails beyond the bound."""
        began_ms = self.now_ms
        while self.goals or any(self.orders.values()) or self.now_ms == began_ms:
            assert self.now_ms - began_ms < seconds * 1000, (
                {n: (g.point, self.poses[n]) for n, g in self.goals.items()},
                [plan.wait for plan in self.traffic.plans(self.now_ms)],
            )
            self.run(2.0, grants_every=10)
        assert self.stands.unnamed_ms < STALL_MS, self.stands.unnamed
        return (self.now_ms - began_ms) / 1000


def near_others(robots: Mapping[RobotName, SimRobot]) -> list[RobotName]:
    """Robots whose discs meet another's: of these alone the bodies can overlap."""
    names = list(robots)
    at = np.array([place(robot)[:2] for robot in robots.values()]).reshape(-1, 2)
    reach_m = 2 * max((robot.body.radius_m for robot in robots.values()), default=0.0)
    pairs = cKDTree(at).query_pairs(reach_m, output_type="ndarray")
    return [names[k] for k in np.unique(pairs)]


def _corners(shape: shapely.Polygon) -> tuple[XY, ...]:
    return tuple((x, y) for x, y in shapely.get_coordinates(shape)[:-1].tolist())
