"""A floor with perfect robots for tests of traffic: they drive their route up to their authority.

Written for these tests alone and on purpose not taken from `sim`: siblings do not know each other.
"""

import math
import random
from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import cast

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import Drive, Mark, Piece, Plan, Report, TellRoute
from ledger.scene import XY, Area, Group
from ledger.scene_config import SceneConfig
from scheduler.corridors import Corridors
from scheduler.goal import Goal
from scheduler.traffic.judge import body, collisions, double_grants, outside
from scheduler.traffic.traffic import Traffic
from tests.scheduler.traffic.free_flow import FreeFlow

SCENE = SceneId("0123456789abcdef01234567")
DT_S = 0.1
LATE_S = 6.0  # mean of a delay, exponential
NEWS_MS = 500  # a robot of which there is nothing new reports this often
PROGRESS_MS = 1_000  # progress of orders is looked at this often
NEARER_S = 0.1  # this much less to its goal is progress


def wrap(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


class Curve:
    """Poses along a Bezier curve by a table of chords."""

    def __init__(self, piece: Piece) -> None:
        self.table: list[tuple[float, float, float]] = []  # along, x, y
        count = 1 if len(piece.curve) == 2 else 200
        way, last = 0.0, piece.curve[0]
        for k in range(count + 1):
            xy = self._at(piece.curve, k / count)
            way += math.dist(xy, last)
            self.table.append((way, *xy))
            last = xy
        self.scale = way / piece.length_m if piece.length_m else 1.0
        self.flip = math.pi if piece.backward else 0.0

    def _at(self, controls: tuple[XY, ...], t: float) -> XY:
        level = list(controls)
        while len(level) > 1:
            level = [
                (a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t) for a, b in pairwise(level)
            ]
        return level[0]

    def pose(self, along_m: float) -> tuple[float, float, float]:
        way = along_m * self.scale
        k = 1
        while k < len(self.table) - 1 and self.table[k][0] < way:
            k += 1
        (w0, x0, y0), (w1, x1, y1) = self.table[k - 1], self.table[k]
        share = min(max((way - w0) / (w1 - w0), 0.0), 1.0) if w1 > w0 else 0.0
        heading = wrap(math.atan2(y1 - y0, x1 - x0) + self.flip)
        return x0 + (x1 - x0) * share, y0 + (y1 - y0) * share, heading


class Robot:
    def __init__(self, name: RobotName, group: Group, x: float, y: float, heading: float) -> None:
        self.name, self.group = name, group
        self.x, self.y, self.heading = x, y, heading
        self.speed = 0.0
        self.session = ""
        self.pieces: dict[int, Piece] = {}
        self.progress, self.authority = Mark(), Mark()
        self.frozen_s = 0.0
        self.number = 0
        self.tells = False
        self.curve: tuple[int, Curve] | None = None
        self.turn_from = 0.0
        self.commit = 0  # of the piece it is on
        self.news: object = None  # what it reported last …
        self.news_ms = 0  # … and when

    def tell(self, message: Drive | TellRoute) -> None:
        if isinstance(message, TellRoute):
            self.tells = True
            return
        if message.session != self.session:
            assert self.speed == 0.0
            self.session, self.pieces, self.curve = message.session, {}, None
            self.progress = self.authority = Mark()
        for piece in message.pieces:
            assert self.pieces.setdefault(piece.number, piece) == piece
        assert message.authority >= self.authority
        self.authority = message.authority

    def _reach_m(self) -> float:
        """Way to the next halt: authority, a turn, a reversal, the end of the route."""
        total, number, along = 0.0, self.progress.piece, self.progress.along_m
        while (piece := self.pieces.get(number)) is not None and piece.path is not None:
            if self.authority.piece == number:
                return total + max(self.authority.along_m - along, 0.0)
            if self.authority.piece < number:
                return total
            total += piece.length_m - along
            after = self.pieces.get(number + 1)
            if after is None or after.path is None or after.backward != piece.backward:
                return total
            gap = wrap(after.heading_rad - piece.heading_rad) if len(after.curve) == 2 else 0.0
            assert abs(gap) < 0.06 or self.authority.piece <= number, "driven through a corner"
            number, along = number + 1, 0.0
        return total

    def step(self, dt: float, chance: random.Random, late: float) -> None:
        if self.frozen_s > 0:
            self.frozen_s, self.speed = self.frozen_s - dt, 0.0
            return
        self._next(chance, late)
        piece = self.pieces.get(self.progress.piece)
        if piece is None:
            self.speed = 0.0
            return
        limits = self.group.kinematics
        if piece.path is None:
            self.speed = 0.0
            room = piece.length_m - self.progress.along_m
            if self.authority < Mark(piece=piece.number, along_m=piece.length_m):
                room = 0.0
            turned = self.progress.along_m + min(room, limits.turn_radps_max * dt)
            self.progress = Mark(piece=piece.number, along_m=turned)
            away = wrap(piece.heading_rad - self.turn_from)
            share = turned / piece.length_m
            self.heading = wrap(self.turn_from + away * share)
            return
        reach = self._reach_m()
        top = min(limits.speed_mps_max, piece.speed_mps_max or limits.speed_mps_max)
        gain = limits.acceleration_mps2_max
        speed = min(abs(self.speed) + gain * dt, top, math.sqrt(2 * gain * max(reach, 0.0)))
        way = min(speed * dt, reach)
        self.speed = (-speed if piece.backward else speed) if way > 1e-6 else 0.0
        along = self.progress.along_m + way
        while along >= piece.length_m - 1e-9:
            after = self.pieces.get(piece.number + 1)
            if after is None or after.path is None or after.backward != piece.backward:
                along = piece.length_m
                break
            if self.authority <= Mark(piece=piece.number, along_m=piece.length_m):
                along = piece.length_m
                break
            along, piece = max(along - piece.length_m, 0.0), after
            self._be_late(piece, chance, late)
        self.progress = Mark(piece=piece.number, along_m=along)
        if self.curve is None or self.curve[0] != piece.number:
            self.curve = (piece.number, Curve(piece))
        self.x, self.y, self.heading = self.curve[1].pose(along)

    def _next(self, chance: random.Random, late: float) -> None:
        """On to the next piece, if this one is done and the next may be begun."""
        piece = self.pieces.get(self.progress.piece)
        after = self.pieces.get(self.progress.piece + 1)
        done = piece is None or self.progress.along_m >= piece.length_m - 1e-9
        if done and after is not None and self.authority.piece >= after.number:
            self.progress = Mark(piece=after.number)
            self.turn_from = self.heading
            self._be_late(after, chance, late)

    def _be_late(self, piece: Piece, chance: random.Random, late: float) -> None:
        """A share of the moves is late: of moves, not of pieces, whose number is the map's."""
        if piece.commit != self.commit:
            self.commit = piece.commit
            if late and chance.random() < late:
                self.frozen_s = chance.expovariate(1 / LATE_S)

    def report_news(self, at_ms: int, area: int) -> Report | None:
        """A report, if there is something new: most robots of a jam have nothing to say."""
        pose = self.x, self.y, self.heading, self.speed
        news = (*pose, self.session, self.progress, self.authority, self.tells)
        if news == self.news and at_ms - self.news_ms < NEWS_MS:
            return None
        self.news, self.news_ms = news, at_ms
        return self.report(at_ms, area)

    def report(self, at_ms: int, area: int) -> Report:
        self.number += 1
        route = None
        if self.tells:
            self.tells = False
            route = tuple(p for n, p in sorted(self.pieces.items()) if n >= self.progress.piece)
        return Report(
            scene=SCENE,
            robot=self.name,
            number=self.number,
            at_ms=at_ms,
            area=area,
            x_m=self.x,
            y_m=self.y,
            heading_rad=self.heading,
            speed_mps=self.speed,
            session=self.session,
            progress=self.progress,
            authority=self.authority,
            route=route,
        )


class Floor:
    """Robots, traffic, and orders to random goals; the judge looks on."""

    def __init__(
        self,
        area: Area,
        groups: tuple[Group, ...],
        starts: Mapping[str, tuple[str, float]],
        goals: list[PointName],
        seed: int = 0,
        late: float = 0.0,
        service_s: float = 5.0,
        group_of: Mapping[str, int] | None = None,
        corridors: Corridors | None = None,
        free_flow: bool = False,
        config: SceneConfig | None = None,
    ) -> None:
        """`corridors`: no more orders at a time lead into each than dispatch allows;
        `free_flow`: the control, robots that pass through each other.
        """
        self.area, self.groups = area, groups
        self.chance = random.Random(seed)
        self.goal_points, self.late, self.service_s = goals, late, service_s
        self.corridors: Corridors = {} if corridors is None else corridors
        self.points = {point.name: point for point in area.points}
        self.now_ms = 1_000_000
        self.robots: dict[RobotName, Robot] = {}
        kinds = {group.id: group for group in groups}
        self.group_of = dict(group_of or dict.fromkeys(starts, groups[0].id))
        for name, (at, heading) in sorted(starts.items()):
            point = self.points[PointName(at)]
            group = kinds[self.group_of[name]]
            self.robots[RobotName(name)] = Robot(
                RobotName(name), group, point.x_m, point.y_m, heading
            )
        self.goals: dict[RobotName, Goal] = {}
        self.busy: dict[RobotName, int] = {}
        self.done: dict[RobotName, int] = dict.fromkeys(self.robots, 0)
        self.last_done: dict[RobotName, int] = dict.fromkeys(self.robots, self.now_ms)
        self.longest_ms = 0  # that one order has taken
        self.moved_ms: dict[RobotName, int] = dict.fromkeys(self.robots, self.now_ms)
        self.still_ms = 0  # longest that a robot with an order stood still, without a fault
        self.idle: set[RobotName] = set()
        self.best: dict[RobotName, tuple[Goal, float, int]] = {}  # nearest to the goal, and when
        self.unserved_ms = 0  # longest that an order came no nearer to its goal, whatever the cause
        self.begun_ms, self.begun_done = self.now_ms, 0  # of the measurement
        self.radius_m = max(math.hypot(*xy) for group in groups for xy in group.footprint)
        self.starts, self.free_flow = starts, free_flow
        self.config = config
        self.traffic: Traffic = self.fresh_traffic()

    def fresh_traffic(self) -> Traffic:
        if self.free_flow:
            return cast(Traffic, FreeFlow(self.area, self.groups, self.starts, self.group_of))
        traffic = Traffic(SCENE, self.area, self.groups)
        if self.config is not None:
            traffic.tune(self.config)
        for name in self.robots:
            traffic.add(name, self.group_of[name])
        return traffic

    def restart(self, known: Iterable[Plan] = ()) -> None:
        """The scheduler forgets everything but these last plans; the robots do not."""
        self.traffic = self.fresh_traffic()
        for plan in known:
            self.traffic.remember(plan)

    def _orders(self) -> None:
        for name in self.robots:
            goal = self.goals.get(name)
            if name in self.busy:
                self.moved_ms[name] = self.now_ms
                if self.now_ms >= self.busy[name]:
                    del self.busy[name]
                    del self.goals[name]
                    self.done[name] += 1
                    self.last_done[name] = self.now_ms
            elif goal is not None and self.traffic.stands_at(name, goal.point):
                self.busy[name] = self.now_ms + int(self.service_s * 1000)
            elif goal is None and name not in self.idle:
                self.moved_ms[name] = self.now_ms
                taken = {other.point for other in self.goals.values()}
                free = [p for p in self.goal_points if p not in taken]
                full = self._full(taken)
                free = [p for p in free if p not in full]
                if not free:
                    continue
                point = self.chance.choice(free)
                if self.traffic.cost_s(name, point) < math.inf:
                    self.goals[name] = Goal(point=point, rank=(0, self.now_ms, name))

    def _full(self, taken: set[PointName]) -> set[PointName]:
        """Points of corridors that enough orders lead into."""
        many = Counter(c.name for p in taken if (c := self.corridors.get(p)) is not None)
        return {p for p, c in self.corridors.items() if many[c.name] >= c.orders_max}

    def tick(self, report_loss: float = 0.0) -> None:
        self.now_ms += int(DT_S * 1000)
        for robot in self.robots.values():
            before = robot.progress
            robot.step(DT_S, self.chance, self.late)
            if robot.speed or robot.frozen_s > 0 or robot.progress != before:
                self.moved_ms[robot.name] = self.now_ms
            report = robot.report_news(self.now_ms, self.area.id)
            if report is not None and not (report_loss and self.chance.random() < report_loss):
                self.traffic.observe(report)
        self._orders()
        for message in self.traffic.step(self.now_ms, self.goals, self.busy.keys()):
            self.robots[message.robot].tell(message)
        for name in self.goals.keys() - self.busy.keys():
            self.still_ms = max(self.still_ms, self.now_ms - self.moved_ms[name])
        for name in self.goals:
            self.longest_ms = max(self.longest_ms, self.now_ms - self.last_done[name])
        if self.now_ms % PROGRESS_MS == 0:
            self._look_at_progress()

    def _look_at_progress(self) -> None:
        """By what is left to the goal from the end of the committed moves."""
        for name, goal in self.goals.items():
            known, least_s, at_ms = self.best.get(name, (None, 0.0, 0))
            left_s = self.traffic.cost_s(name, goal.point)
            if goal is not known or name in self.busy or left_s < least_s - NEARER_S:
                self.best[name] = goal, left_s, self.now_ms
            else:
                self.unserved_ms = max(self.unserved_ms, self.now_ms - at_ms)

    def begin(self) -> None:
        """Measure from now on: the robots are spread as they will stay."""
        self.begun_ms, self.begun_done = self.now_ms, sum(self.done.values())
        self.longest_ms = self.still_ms = self.unserved_ms = 0
        self.best.clear()

    def orders_per_h(self) -> float:
        """Since `begin`."""
        hours = (self.now_ms - self.begun_ms) / 3_600_000
        return (sum(self.done.values()) - self.begun_done) / hours

    def bodies(self):
        return {r.name: body(r.group.footprint, r.x, r.y, r.heading) for r in self.robots.values()}

    def judge_bodies(self) -> None:
        """Overlaps alone, and only of robots near each other: a twentieth of the whole judge."""
        robots = sorted(self.robots.values(), key=lambda r: (r.x, r.name))
        near: dict[RobotName, Robot] = {}
        for k, robot in enumerate(robots):
            for other in robots[k + 1 :]:
                if other.x - robot.x > 2 * self.radius_m:
                    break
                if abs(other.y - robot.y) <= 2 * self.radius_m:
                    near[robot.name], near[other.name] = robot, other
        bodies = {n: body(r.group.footprint, r.x, r.y, r.heading) for n, r in near.items()}
        assert collisions(bodies) == []

    def judge(self) -> None:
        bodies = self.bodies()
        assert collisions(bodies) == []
        plans = self.traffic.plans(self.now_ms)
        assert double_grants(plans) == []
        for plan in plans:
            if plan.spaces:
                assert not outside(plan, bodies[plan.robot]), plan

    def run(self, seconds: float, judge_every_s: float = 0.5, report_loss: float = 0.0) -> None:
        every = max(1, round(judge_every_s / DT_S))
        for k in range(round(seconds / DT_S)):
            self.tick(report_loss)
            if k % every == 0:
                self.judge()
