"""Where a robot is when traffic first hears of it, and how it gets from there to a stop."""

import heapq
import math

import msgspec
import numpy as np
import numpy.typing as npt

from ledger.link import Report
from scheduler.traffic.geometry import Floats, turn_rad, wrap
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.routes import Leg, left
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
    cells: tuple[int, ...]  # on the way, without the place's own


class Locator:
    """Where on a map a robot is; the map does not change, so its paths are cut up once."""

    def __init__(self, roadmap: Roadmap) -> None:
        """Cut the paths into chords of at most 0.5 m."""
        self._net = roadmap.net
        self._points_m = np.array([(p.x_m, p.y_m) for p in self._net.points]).reshape(-1, 2)
        traces = self._net.traces
        first, length_m = np.asarray(traces.first), np.asarray(traces.length_m)
        owner = np.repeat(np.arange(len(length_m)), np.diff(first))
        piece_m = length_m / np.maximum(np.diff(first), 1)
        paths, starts, ends, before = [np.empty(0, dtype=int)], [np.empty((0, 3))], [], []
        for numbers, poses in traces.batches:
            steps = poses.shape[1] - 1
            path = owner[numbers]
            for step in range(steps):
                paths.append(path)
                starts.append(poses[:, step])
                ends.append(poses[:, step + 1, :2])
                before.append(piece_m[path] * (numbers - first[path] + step / steps))
        self._paths, self._starts = np.concatenate(paths), np.concatenate(starts)
        self._before_m = np.concatenate([np.empty(0), *before])
        self._chords = np.concatenate([np.empty((0, 2)), *ends]) - self._starts[:, :2]
        self._lengths = np.maximum(np.hypot(self._chords[:, 0], self._chords[:, 1]), 1e-9)
        self._longest_m = float(self._lengths.max(initial=0.0))

    def nearest_point(self, report: Report, within_m: float) -> int | None:
        """The point that the robot stands on; its own word first, if it is not far off."""
        found: tuple[float, int] | None = None
        k: int
        for k in _round(self._points_m, report, within_m).tolist():
            point = self._net.points[k]
            off = math.hypot(point.x_m - report.x_m, point.y_m - report.y_m)
            if point.name == report.point and off <= within_m:
                return k
            if off <= within_m and (found is None or off < found[0]):
                found = (off, k)
        return None if found is None else found[1]

    def on_paths(self, report: Report, within_m: float) -> list[Leg]:
        """Paths that the robot is on with the right heading, nearest first, from where it is on."""
        near = _round(self._starts, report, within_m + self._longest_m)
        starts, chords, lengths = self._starts[near], self._chords[near], self._lengths[near]
        at = np.array([report.x_m, report.y_m]) - starts[:, :2]
        along = np.clip((at * chords).sum(axis=1) / lengths, 0.0, lengths)
        off = np.hypot(*(at - chords * (along / lengths)[:, None]).T)
        best: dict[int, tuple[float, float]] = {}
        for k in np.flatnonzero(off <= within_m).tolist():
            if abs(wrap(report.heading_rad - float(starts[k, 2]))) <= ON_PATH_RAD:
                path = int(self._paths[near[k]])
                found = (round(float(off[k]), 6), float(self._before_m[near[k]]) + float(along[k]))
                best[path] = min(found, best.get(path, found))
        ranked = sorted((off_m, path, at_m) for path, (off_m, at_m) in best.items())
        lengths_m, retreat = self._net.traces.length_m, self._net.retreat
        return [
            Leg(path=path, from_m=max(at_m, 1e-6))
            for _, path, at_m in ranked
            if at_m < lengths_m[path] - 1e-3 and not retreat[path]
        ]


def _round(at_m: Floats, report: Report, within_m: float) -> npt.NDArray[np.intp]:
    """Numbers of all that is no further off, and of some more."""
    x_off, y_off = np.abs(at_m[:, 0] - report.x_m), np.abs(at_m[:, 1] - report.y_m)
    return np.flatnonzero(np.maximum(x_off, y_off) <= within_m + 1e-6)


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
        cells += [cell for cell, _ in left(roadmap, footprint, leg)]
        heading = net.traces.heading_end[leg.path]
    need = roadmap.places.conflict[place] | 1 << place
    for cell in cells:
        need |= met(roadmap.cells, roadmap.places.resting, cell)
    return Entry(place=place, legs=legs, point=point, need=need, cells=tuple(cells))
