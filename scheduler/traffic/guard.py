"""The judge at work: looks at what robots report, and stops one rather than trust a bug of ours.

It shares nothing with planners and conflict table but the polygons that were granted. A few times a
second it asks of every robot that moves whether its true body overlaps another's, whether another's
body is on ground that it may still drive over, and whether it is on its own ground at all.
"""

from collections.abc import Iterable, Set
from enum import StrEnum
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

from ledger.ids import RobotName
from ledger.scene import Value
from scheduler.traffic.classes import outline
from scheduler.traffic.geometry import MARGIN_M
from scheduler.traffic.grants import Grants
from scheduler.traffic.judge import OUTSIDE_M, OVERLAP_M2, bodies_at
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.track import Track

LOOK_MS = 300  # between two looks: a third of a metre at full speed
CLEAR_MS = 1_000  # who was in a breach is let go when it has been over for so long
OFF_M_MIN = 0.1  # whatever the scene says: poses are not better than that
OFF_M = 0.3  # unless the scene says another path_distance_m


Pose: TypeAlias = tuple[float, float, float, int, bool]  # and what its class is, or will be


class BreachKind(StrEnum):
    """What must not be."""

    OVERLAP = "BodiesOverlap"  # of two robots; both are stopped
    TAKEN = "GroundTaken"  # the second's body is where the first may drive; that is stopped
    OFF = "OffGround"  # it is not where it may be, beyond all tolerance; it is stopped


class Breach(Value, frozen=True, kw_only=True):
    """Something that must not be, and where."""

    kind: BreachKind
    robots: tuple[RobotName, ...]
    x_m: float
    y_m: float

    @property
    def stopped(self) -> tuple[RobotName, ...]:
        """Those that must not go on."""
        return self.robots if self.kind is BreachKind.OVERLAP else self.robots[:1]

    @property
    def words(self) -> str:
        """For people: what, who, where."""
        return f"{self.kind}: {' and '.join(self.robots)} at ({self.x_m:.2f}, {self.y_m:.2f})"


class Guard:
    """Looks on in one area. Deterministic: the same reports and grants, the same breaches."""

    def __init__(self, roadmap: Roadmap, grants: Grants) -> None:
        """Take polygons from these, and nothing else."""
        self._roadmap, self._grants = roadmap, grants
        self._outlines = {
            (group.id, loaded): outline(group, loaded=loaded)
            for group in roadmap.groups.values()
            for loaded in (False, True)
        }
        self._grounds: dict[int, shapely.Polygon] = {}  # by compiled cell, made once
        self._ways: dict[int, shapely.Geometry] = {}  # cell -> what a body on it sweeps
        self._bodies: dict[RobotName, shapely.Geometry] = {}
        self._seen: dict[RobotName, Pose] = {}
        self._names: list[RobotName] = []
        self._shapes: npt.NDArray[np.object_] = np.array([], dtype=object)
        self._tree = shapely.STRtree([])
        self._breaches: dict[tuple[BreachKind, tuple[RobotName, ...]], tuple[Breach, int]] = {}
        self._excused: set[RobotName] = set()
        self._look_ms = 0
        self.off_m = OFF_M  # so far off its ground a robot may be
        self.strays: set[RobotName] = set()  # whose bodies their own ground does not hold
        self.count = 0  # breaches so far

    @property
    def breaches(self) -> list[Breach]:
        """Those of now, and of a moment ago."""
        return [breach for _, (breach, _) in sorted(self._breaches.items())]

    @property
    def held(self) -> Set[RobotName]:
        """Those that get no more ground; not whom an operator has sent on all the same."""
        names = {name for breach in self.breaches for name in breach.stopped}
        self._excused &= names
        return names - self._excused

    def excuse(self, robot: RobotName) -> None:
        """An operator lets it go on, until it is in no breach any more."""
        self._excused.add(robot)

    def look(self, tracks: Iterable[Track], now_ms: int) -> bool:
        """Look, if it is time to; tells whether it has."""
        if 0 <= now_ms - self._look_ms < LOOK_MS:
            return False
        self._look_ms = now_ms
        known = [track for track in tracks if track.placed and track.report is not None]
        news = [t for t in known if t.name in self.strays or self._seen.get(t.name) != _pose(t)]
        self._take_in(known, news)
        fresh = {track.name for track in news}
        named = {name for _, names in self._breaches for name in names}
        moved = [*news, *(t for t in known if t.name in named and t.name not in fresh)]
        ahead = [t for t in known if not t.driven]
        for breach in (*self._overlaps(moved), *self._taken(ahead), *self._off(news)):
            key = breach.kind, breach.robots
            self.count += key not in self._breaches
            self._breaches[key] = breach, now_ms
        self._forget(now_ms)
        return True

    def _forget(self, now_ms: int) -> None:
        over = [key for key, (_, at_ms) in self._breaches.items() if now_ms - at_ms >= CLEAR_MS]
        for key in over:
            del self._breaches[key]

    def _take_in(self, known: list[Track], news: list[Track]) -> None:
        for gone in self._bodies.keys() - {track.name for track in known}:
            del self._bodies[gone]
            self._seen.pop(gone, None)
            self.strays.discard(gone)
        kinds: dict[tuple[int, bool], list[Track]] = {}
        for track in news:
            kinds.setdefault((track.group, self._loaded(track)), []).append(track)
        for kind, of_kind in kinds.items():
            poses = [_pose(track) for track in of_kind]
            bodies = bodies_at(self._outlines[kind], np.array(poses)[:, :3])
            for track, pose, body in zip(of_kind, poses, bodies, strict=True):
                self._bodies[track.name], self._seen[track.name] = body, pose
        self._names = sorted(self._bodies)
        self._shapes = np.array([self._bodies[name] for name in self._names], dtype=object)
        self._tree = shapely.STRtree(self._shapes)

    def _loaded(self, track: Track) -> bool:
        """Does it carry something; who waits for room to take a load does not yet."""
        if track.footprint == self._roadmap.footprint_of[track.group]:
            return False
        return not track.reshaping or (track.report is not None and bool(track.report.loads))

    def _overlaps(self, moved: list[Track]) -> Iterable[Breach]:
        """Of these with anybody."""
        names = [track.name for track in moved]
        for name, other, shared in self._met(names, [self._bodies[name] for name in names]):
            pair = (name, other) if name < other else (other, name)
            yield _breach(BreachKind.OVERLAP, pair, shared)

    def _taken(self, ahead: list[Track]) -> Iterable[Breach]:
        """Bodies of others where these may still drive."""
        cells = [(t.name, slot.cell) for t in ahead for slot in t.owned if not slot.standing]
        ways = self._way_over([cell for _, cell in cells])
        for name, other, shared in self._met([name for name, _ in cells], ways):
            yield _breach(BreachKind.TAKEN, (name, other), shared)

    def _met(
        self, owners: list[RobotName], shapes: list[shapely.Geometry]
    ) -> Iterable[tuple[RobotName, RobotName, shapely.Geometry]]:
        """Where one of these shapes lies over the body of another than its owner."""
        if not shapes or not self._names:
            return
        asked = np.array(shapes, dtype=object)
        number = {name: k for k, name in enumerate(self._names)}
        own = np.array([number[owner] for owner in owners])
        mine, body = self._tree.query(asked)
        foreign = own[mine] != body  # nearly all that is found is a robot on its own way
        mine, body = mine[foreign], body[foreign]
        met = shapely.intersects(asked[mine], self._shapes[body])
        for k, other in zip(mine[met].tolist(), body[met].tolist(), strict=True):
            shared = shapely.intersection(shapes[k], self._shapes[other])
            if shared.area > OVERLAP_M2:
                yield owners[k], self._names[other], shared

    def _off(self, news: list[Track]) -> Iterable[Breach]:
        """Those that are not on their own ground. Nearly all are on the first of their cells."""
        if not news:
            return
        self.strays.difference_update(track.name for track in news)
        bodies = np.array([self._bodies[track.name] for track in news], dtype=object)
        cells = [track.owned[track.stray is not None].cell for track in news]
        first = np.array([self._ground(cell) for cell in cells], dtype=object)
        for k in np.flatnonzero(~shapely.covers(first, bodies)).tolist():
            track, body = news[k], bodies[k]
            own = [self._ground(slot.cell) for slot in track.owned if slot is not track.stray]
            ground = shapely.union_all(own)
            if ground.buffer(OUTSIDE_M).covers(body):
                continue
            self.strays.add(track.name)
            if not ground.buffer(max(self.off_m, OFF_M_MIN)).covers(body):
                yield _breach(BreachKind.OFF, (track.name,), body)

    def _ground(self, cell: int) -> shapely.Polygon:
        if self._grants.is_shape(cell):
            return shapely.Polygon(self._grants.ring(cell))
        ground = self._grounds.get(cell)
        if ground is None:
            ground = self._grounds[cell] = self._roadmap.polygon(cell)
        return ground

    def _way_over(self, cells: list[int]) -> list[shapely.Geometry]:
        """What a true body sweeps on cells: without the margin by which footprints are widened."""
        new = [cell for cell in dict.fromkeys(cells) if cell not in self._ways]
        if new:
            grounds = np.array([self._ground(cell) for cell in new], dtype=object)
            made = shapely.buffer(grounds, -MARGIN_M, join_style="mitre")
            self._ways.update(zip(new, made.tolist(), strict=True))
        return [self._ways[cell] for cell in cells]


def _pose(track: Track) -> Pose:
    report = track.report
    assert report is not None
    return report.x_m, report.y_m, report.heading_rad, track.footprint, track.reshaping


def _breach(kind: BreachKind, robots: tuple[RobotName, ...], where: shapely.Geometry) -> Breach:
    at = where.representative_point()
    return Breach(kind=kind, robots=robots, x_m=round(at.x, 3), y_m=round(at.y, 3))
