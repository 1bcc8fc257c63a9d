"""Where a robot is when traffic first hears of it, and how it gets from there to a stop."""

import heapq
import math

import msgspec
import numpy as np

from ledger.link import Report
from scheduler.traffic.geometry import Floats, turn_rad, wrap
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.routes import Leg
from scheduler.traffic.stops import met

ON_PATH_RAD = 0.35  # a robot is on a path if its heading differs by no more than this
ENTRIES_MAX = 40  # nearest stops tried from where it was found
_EXPANDED_MAX = 5_000


class Entry(msgspec.Struct, frozen=True, kw_only=True):
    """A way from where a robot was found to a place."""

    place: int
    legs: tuple[Leg, ...]
    point: int | None  # where the robot stands; None = on the way along the first path
    need: int  # bits of the places that must be empty


def nearest_point(roadmap: Roadmap, report: Report, within_m: float) -> int | None:
    """The point that the robot stands on; its own word first, if it is not far off."""
    found: tuple[float, int] | None = None
    for k, point in enumerate(roadmap.net.points):
        off = math.hypot(point.x_m - report.x_m, point.y_m - report.y_m)
        if point.name == report.point and off <= within_m:
            return k
        if off <= within_m and (found is None or off < found[0]):
            found = (off, k)
    return None if found is None else found[1]


def _segments(roadmap: Roadmap) -> tuple[list[int], Floats, Floats, list[float]]:
    """Paths as chords of at most 0.5 m: their path, start and end poses, and way before them."""
    traces = roadmap.net.traces
    owner = np.repeat(np.arange(len(traces.length_m)), np.diff(traces.first))
    piece_m = np.asarray(traces.length_m) / np.maximum(np.diff(traces.first), 1)
    paths, starts, ends, before = [], [], [], []
    for numbers, poses in traces.batches:
        steps = poses.shape[1] - 1
        for step in range(steps):
            path = owner[numbers]
            paths.append(path)
            starts.append(poses[:, step])
            ends.append(poses[:, step + 1])
            piece = numbers - np.asarray(traces.first)[path]
            before.append(piece_m[path] * (piece + step / steps))
    if not paths:
        return [], np.empty((0, 3)), np.empty((0, 3)), []
    return (
        np.concatenate(paths).tolist(),
        np.concatenate(starts),
        np.concatenate(ends),
        np.concatenate(before).tolist(),
    )


def on_paths(roadmap: Roadmap, report: Report, within_m: float) -> list[Leg]:
    """Paths that the robot is on with the right heading, nearest first, from where it is on."""
    paths, starts, ends, before = _segments(roadmap)
    if not paths:
        return []
    chord = ends[:, :2] - starts[:, :2]
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)
    at = np.array([report.x_m, report.y_m]) - starts[:, :2]
    along = np.clip((at * chord).sum(axis=1) / length, 0.0, length)
    off = np.hypot(*(at - chord * (along / length)[:, None]).T)
    best: dict[int, tuple[float, float]] = {}
    for k in np.flatnonzero(off <= within_m).tolist():
        if abs(wrap(report.heading_rad - float(starts[k, 2]))) <= ON_PATH_RAD:
            found = (round(float(off[k]), 6), before[k] + float(along[k]))
            best[paths[k]] = min(found, best.get(paths[k], found))
    ranked = sorted((off_m, path, at_m) for path, (off_m, at_m) in best.items())
    lengths, retreat = roadmap.net.traces.length_m, roadmap.net.retreat
    return [
        Leg(path=path, from_m=max(at_m, 1e-6))
        for _, path, at_m in ranked
        if at_m < lengths[path] - 1e-3 and not retreat[path]
    ]


def entries(
    roadmap: Roadmap, footprint: int, point: int | None, heading_rad: float, legs: list[Leg]
) -> list[Entry]:
    """Ways to places, nearest first: from a point, with a turn where it is allowed, or along one
    of the paths that the robot is on.
    """
    net = roadmap.net
    heap: list[tuple[float, tuple[Leg, ...]]] = []
    if point is not None:
        for path in _out(roadmap, point):
            angle = turn_rad(heading_rad, net.traces.heading_start[path])
            if not angle or net.points[point].turning:
                heap.append((net.traces.length_m[path] + angle, (Leg(path=path),)))
    else:
        heap = [(net.traces.length_m[leg.path] - leg.from_m, (leg,)) for leg in legs]
    heap.sort(key=_by_cost)
    found: list[Entry] = []
    ended: set[int] = set()
    done: set[int] = set()
    tie = len(heap)
    queue = [(cost, k, way) for k, (cost, way) in enumerate(heap)]
    while queue and len(found) < ENTRIES_MAX and len(done) < _EXPANDED_MAX:
        cost, _, way = heapq.heappop(queue)
        path = way[-1].path
        if path in done:
            continue
        done.add(path)
        end = net.end[path]
        place = roadmap.place_at.get(end)
        # On through a stop, too: it may be taken, and the one behind it free.
        if place is not None and place < roadmap.places.stops and place not in ended:
            ended.add(place)
            found.append(_entry(roadmap, footprint, place, way, point, heading_rad))
        for after in _out(roadmap, end):
            angle = turn_rad(net.traces.heading_end[path], net.traces.heading_start[after])
            if after not in done and (not angle or net.points[end].turning):
                tie += 1
                further = cost + net.traces.length_m[after] + angle
                heapq.heappush(queue, (further, tie, (*way, Leg(path=after))))
    return found


def _out(roadmap: Roadmap, point: int) -> list[int]:
    net = roadmap.net
    return [path for path in net.out[point] if not net.retreat[path]]


def _by_cost(way: tuple[float, tuple[Leg, ...]]) -> tuple[float, int]:
    return way[0], way[1][0].path


def _entry(
    roadmap: Roadmap,
    footprint: int,
    place: int,
    legs: tuple[Leg, ...],
    point: int | None,
    heading_rad: float,
) -> Entry:
    net = roadmap.net
    cells: list[int] = []
    heading: float | None = heading_rad if point is not None else None
    for leg in legs:
        if heading is not None and turn_rad(heading, net.traces.heading_start[leg.path]):
            cells.append(roadmap.disc(footprint, net.start[leg.path]))
        for cell, end in roadmap.path_cells(footprint, leg.path):
            if end > leg.from_m:
                cells.append(cell)
        heading = net.traces.heading_end[leg.path]
    need = roadmap.places.conflict[place] | 1 << place
    for cell in cells:
        need |= met(roadmap.cells, roadmap.places.resting, cell)
    return Entry(place=place, legs=legs, point=point, need=need)
