"""Where a simulated robot begins: off the lanes if it can, and clear of everybody else."""

from collections import Counter
from collections.abc import Iterable, Iterator
from math import atan2, dist, hypot, inf, pi

from ledger.ids import PointName
from ledger.scene import XY, Area, Group, Path, Point, PointKind, Value
from sim.legs import Leg
from sim.robot import JOIN_M, SimRobot, place

CLEARANCE_M = 0.05
SQUARE_M = 2.0  # about the reach of a robot
_ORDER = {
    PointKind.PARKING: 0,
    PointKind.CHARGING: 1,
    PointKind.ACTION: 2,
    PointKind.WAYPOINT: 3,
}


class Place(Value, frozen=True, kw_only=True):
    """A point to stand on, and how."""

    area: Area
    point: PointName
    x_m: float
    y_m: float
    heading_rad: float


class Ground:
    """An area as a place to put robots on: an index, built once a map."""

    def __init__(self, area: Area) -> None:
        self.area = area
        self.points = {point.name: point for point in area.points}
        self.chargers = frozenset(p.name for p in area.points if p.kind is PointKind.CHARGING)
        self._leaving: dict[PointName, Path] = {}
        for path in area.paths:
            self._leaving.setdefault(path.start, path)
        first = sorted(area.points, key=lambda p: _ORDER[p.kind])
        self._first = [point for point in first if point.name in self._leaving]

    def places(self) -> Iterator[Place]:
        """Give the points from which a robot can drive on, the best first, else in map order."""
        return (self.place(point) for point in self._first)

    def place(self, point: Point) -> Place:
        """Stand as the map demands it, or else ready to drive out."""
        heading = point.heading_rad
        if heading is None:
            heading = self._heading(point)
        return Place(
            area=self.area,
            point=point.name,
            x_m=point.x_m,
            y_m=point.y_m,
            heading_rad=heading,
        )

    def _heading(self, point: Point) -> float:
        path = self._leaving.get(point.name)
        end = self.points.get(path.end) if path is not None else None
        if path is None or end is None:
            return 0.0
        for x, y in (*path.controls, (end.x_m, end.y_m)):
            if hypot(x - point.x_m, y - point.y_m) > 1e-6:
                heading = atan2(y - point.y_m, x - point.x_m)
                return heading - pi if path.backward else heading
        return 0.0


def radius_m(group: Group) -> float:
    """Give the circle round the reference point that holds the footprint at any heading."""
    return max((hypot(x, y) for x, y in group.footprint), default=0.0)


def taken(robot: SimRobot, near: XY = (0.0, 0.0), within_m: float = inf) -> Iterator[XY]:
    """Give where a robot stands, and points along the way that it may still drive; of a part that
    is no nearer than that at any point, its end only.
    """
    if not robot.legs or _comes_near(robot.legs[0], near, within_m):
        x, y, _, _ = place(robot)
        yield x, y
    for leg in robot.legs:
        yield leg.piece.curve[-1]
        if leg.track is not None and _comes_near(leg, near, within_m):
            yield from leg.track.spots_m


def _comes_near(leg: Leg, near: XY, within_m: float) -> bool:
    """Tell whether it may: nothing of it is further from its end than it is long; who has not set
    out stands up to a gap between two pieces before it.
    """
    if leg.track is None:
        return True
    return dist(leg.piece.curve[-1], near) <= within_m + leg.track.length_m + JOIN_M


def free_place(
    grounds: Iterable[Ground],
    radius_m: float,
    others: Iterable[SimRobot],
    preferred: PointName | None = None,
) -> Place | None:
    """Choose the first place whose disc is clear of all others' discs; none if there is no room.

    Of several grounds that with the fewest robots for its size goes first: each floor gets some.
    """
    obstacles = _Obstacles()
    robots: Counter[int] = Counter()
    for robot in others:
        robots[robot.body.area] += 1
        obstacles.add(robot, robot.body.radius_m + radius_m + CLEARANCE_M)
    known = list(grounds)
    if preferred is not None:
        for ground in known:
            point = ground.points.get(preferred)
            if point is not None and obstacles.leave_clear(ground.place(point)):
                return ground.place(point)
    known.sort(key=lambda ground: robots[ground.area.id] / max(len(ground.points), 1))
    for ground in known:
        for candidate in ground.places():
            if obstacles.leave_clear(candidate):
                return candidate
    return None


class _Obstacles:
    """Discs to keep clear of, in squares: a thousand robots are placed in seconds, not minutes."""

    def __init__(self) -> None:
        self._in: dict[tuple[int, int, int], list[tuple[float, float, float]]] = {}

    def add(self, robot: SimRobot, reach_m: float) -> None:
        """Keep so far from where a robot is, or may still drive to."""
        for x, y in taken(robot):
            disc = (x, y, reach_m)
            for i in range(int((x - reach_m) // SQUARE_M), int((x + reach_m) // SQUARE_M) + 1):
                low, high = int((y - reach_m) // SQUARE_M), int((y + reach_m) // SQUARE_M)
                for j in range(low, high + 1):
                    self._in.setdefault((robot.body.area, i, j), []).append(disc)

    def leave_clear(self, place: Place) -> bool:
        """Is this place out of reach of them all."""
        square = place.area.id, int(place.x_m // SQUARE_M), int(place.y_m // SQUARE_M)
        return all(
            hypot(x - place.x_m, y - place.y_m) >= reach_m
            for x, y, reach_m in self._in.get(square, ())
        )
