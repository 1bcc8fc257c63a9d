"""An area as numbered points and paths: the form that everything below the names works on."""

import heapq
import math

import msgspec

from ledger.ids import PointName
from ledger.scene import Area, Path, Point, PointKind
from scheduler.traffic.geometry import SMOOTH_RAD, Traces, trace, wrap
from scheduler.traffic.parts import parts

GOAL_KINDS = frozenset({PointKind.ACTION, PointKind.PARKING, PointKind.CHARGING})


class Network(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Points and usable paths of one area in the order of the file."""

    points: list[Point]  # of the area, and behind them those inside its long paths
    named: int  # how many are points of the area
    number: dict[PointName, int]  # of these
    paths: list[Path]  # which each one is, or is a part of
    retreat: list[bool]  # driven in reverse out of a dead end, which the map does not have
    start: list[int]
    end: list[int]
    out: list[list[int]]  # point -> paths that begin there
    traces: Traces
    headings: list[list[float]]  # per point: of bodies arriving, leaving, or as demanded
    neighbours: list[set[int]]  # either direction
    goals: frozenset[int]  # points where something is done: by kind, or because a bin is there


def network(area: Area, part_m: float = math.inf) -> Network:
    """Number an area; paths with an unknown end or no length are left out (see `check`), and those
    of twice `part_m` and more are cut.
    """
    points = list(area.points)
    named, number = len(points), {point.name: k for k, point in enumerate(points)}
    found = parts(area, points, part_m)
    paths = [part.path for part in found]
    start, end = [part.start for part in found], [part.end for part in found]
    traces = trace(
        [part.curve for part in found],
        [path.backward for path in paths],
        [part.straight for part in found],
    )
    out: list[list[int]] = [[] for _ in points]
    neighbours: list[set[int]] = [set() for _ in points]
    headings: list[list[float]] = [[] for _ in points]
    for k, (a, b) in enumerate(zip(start, end, strict=True)):
        out[a].append(k)
        neighbours[a].add(b)
        neighbours[b].add(a)
        _note(headings[a], traces.heading_start[k])
        _note(headings[b], traces.heading_end[k])
    for k, point in enumerate(points):
        if point.heading_rad is not None and point.turning:
            _note(headings[k], point.heading_rad)
    binned = {bin.point for bin in area.bins}
    goals = frozenset(
        k
        for k, point in enumerate(points[:named])
        if point.kind in GOAL_KINDS or point.name in binned
    )
    return Network(
        points=points,
        named=named,
        number=number,
        paths=paths,
        retreat=[part.retreat for part in found],
        start=start,
        end=end,
        out=out,
        traces=traces,
        headings=headings,
        neighbours=neighbours,
        goals=goals,
    )


def _note(known: list[float], heading: float) -> None:
    if heading in known:
        return
    if all(abs(wrap(heading - other)) > SMOOTH_RAD / 10 for other in known):
        known.append(heading)


def junction_distances(net: Network) -> tuple[set[int], list[float]]:
    """Points with three neighbours or more, and each point's way to the nearest of them, metres."""
    junctions = {k for k, near in enumerate(net.neighbours) if len(near) > 2}
    around: list[dict[int, float]] = [{} for _ in net.points]
    for k, length in enumerate(net.traces.length_m):
        a, b = net.start[k], net.end[k]
        for here, there in ((a, b), (b, a)):
            around[here][there] = min(length, around[here].get(there, length))
    far = [float("inf")] * len(net.points)
    heap = [(0.0, k) for k in sorted(junctions)]
    while heap:
        way, point = heapq.heappop(heap)
        if way < far[point]:
            far[point] = way
            for other, length in around[point].items():
                if way + length < far[other]:
                    heapq.heappush(heap, (way + length, other))
    return junctions, far
