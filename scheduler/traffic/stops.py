"""Which points are stops: places where robots may rest and turn without hindering each other.

Two points conflict if the body resting on one meets the other's resting body *or its rotation
disc*: robots that rest legally but cannot turn round would hold each other for ever (measured:
20 robots in single-lane aisles, 0.54 of free flow instead of 0.63, and one starved for 570 s).
"""

import msgspec
import shapely

from ledger.scene import XY, Point, PointKind
from scheduler.traffic.cells import Cells
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.network import Network, junction_distances

# Up to this many, all points that are left over may be ends of orders; beyond it only points of
# kind action, parking or charging and points of bins, for each one adds moves from all around.
GOAL_ONLY_MAX = 400


class Places(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Points where a move may end: first the stops, then the goal-only stops."""

    point: list[int]
    stops: int  # how many of them are stops
    conflict: list[int]  # per place: bits of the places that cannot be taken at the same time
    resting: dict[int, int]  # cell -> bits of the places whose resting body it is
    turning: list[int]  # per place: bits of the other places whose resting body meets its disc


def passable(net: Network, point: int) -> bool:
    """Can every robot that arrives here also leave? Where turning is forbidden that takes an
    outgoing path with the heading of each incoming one.
    """
    out = [k for k in net.out[point] if not net.retreat[k]]
    if net.points[point].turning or not out:
        return True
    leaving = [net.traces.heading_start[k] for k in out]
    arriving = [net.traces.heading_end[k] for k, end in enumerate(net.end) if end == point]
    return all(any(turn_rad(a, b) == 0.0 for b in leaving) for a in arriving)


def clashes(net: Network, cells: Cells, footprint: int) -> list[set[int]]:
    """Per point: the points it conflicts with."""
    resting: dict[int, list[int]] = {}
    turning: dict[int, list[int]] = {}
    for point in range(len(net.points)):
        resting.setdefault(cells.rest(footprint, point), []).append(point)
        turning.setdefault(cells.disc(footprint, point), []).append(point)
    found: list[set[int]] = [set() for _ in net.points]
    for cell, points in resting.items():
        row = cells.indices[cells.indptr[cell] : cells.indptr[cell + 1]].tolist()
        others = {q for c in (cell, *row) for q in (*resting.get(c, ()), *turning.get(c, ()))}
        for p in points:
            for q in others:
                if p != q:
                    found[p].add(q)
                    found[q].add(p)
    return found


def _apart(net: Network, cells: Cells, footprint: int, apart_m: float) -> list[set[int]]:
    """The same for bodies that are to be so far from each other's rotation discs."""
    points = range(len(net.points))
    bodies = [cells.polygon(cells.rest(footprint, point)) for point in points]
    tree = shapely.STRtree([cells.polygon(cells.disc(footprint, point)) for point in points])
    found: list[set[int]] = [set() for _ in points]
    for p, q in tree.query(bodies, predicate="dwithin", distance=apart_m).T.tolist():
        if p != q:
            found[p].add(q)
            found[q].add(p)
    return found


def _candidates(net: Network, cells: Cells, footprint: int) -> list[int]:
    """Points in the order in which they may become stops; all other lane points are left out."""
    junctions, far = junction_distances(net)
    wide = {cells.disc(footprint, k) for k in junctions}

    def clear(point: int) -> bool:
        rest = cells.rest(footprint, point)
        row = cells.indices[cells.indptr[rest] : cells.indptr[rest + 1]].tolist()
        return rest not in wide and not any(c in wide for c in row)

    kept = (PointKind.CHARGING, PointKind.PARKING)
    first = [k for k, point in enumerate(net.points) if point.kind in kept]
    lanes = [k for k in range(len(net.points)) if k not in junctions and clear(k)]
    lanes.sort(key=lambda k: (k not in net.goals, k >= net.named, far[k], net.points[k].name))
    # Row by row: on an open grid that packs them regularly, in straight lines.
    crossings = sorted(junctions, key=lambda k: (*_row(net.points[k]), net.points[k].name))
    order = dict.fromkeys((*first, *lanes, *crossings))
    return [k for k in order if net.neighbours[k] and passable(net, k)]


def _row(point: Point) -> XY:
    return round(point.y_m, 1), round(point.x_m, 1)


def choose(net: Network, cells: Cells, footprint: int, apart_m: float = 0.0) -> Places:
    """Take greedily, in the order above, what is still clear, by `apart_m` more than it must be;
    what is left may be a goal only.
    """
    found = clashes(net, cells, footprint)
    wide = _apart(net, cells, footprint, apart_m) if apart_m else found
    chosen: list[int] = []
    barred: set[int] = set()
    for point in _candidates(net, cells, footprint):
        if point not in barred:
            chosen.append(point)
            barred.add(point)
            barred |= wide[point]
    taken = set(chosen)
    left = [k for k in range(net.named) if k not in taken and net.neighbours[k]]
    if len(left) > GOAL_ONLY_MAX:
        left = [k for k in left if k in net.goals]
    points = chosen + left
    place = {point: k for k, point in enumerate(points)}
    resting: dict[int, int] = {}
    for k, point in enumerate(points):
        cell = cells.rest(footprint, point)
        resting[cell] = resting.get(cell, 0) | 1 << k
    turning = []
    for k, point in enumerate(points):
        turning.append(met(cells, resting, cells.disc(footprint, point)) & ~(1 << k))
    return Places(
        point=points,
        stops=len(chosen),
        conflict=[sum(1 << place[q] for q in found[p] if q in place) for p in points],
        resting=resting,
        turning=turning,
    )


def met(cells: Cells, resting: dict[int, int], cell: int) -> int:
    """Bits of the places whose resting body meets a cell."""
    bits = resting.get(cell, 0)
    for other in cells.indices[cells.indptr[cell] : cells.indptr[cell + 1]].tolist():
        bits |= resting.get(other, 0)
    return bits
