"""How far a robot has to drive: shortest ways over the paths of one area, in metres.

Only lengths count here. What a way costs in time, with turns and traffic, the scheduler knows.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from ledger.ids import PointName
from ledger.scene import XY, Area, Path

CHORDS = 64  # by which a curve is measured; off by 0.1 mm on a quarter circle of radius 1 m
LENGTH_M_MIN = 1e-6  # so that two points in one place are still joined
CLOSE_M = 1e-3  # nearest paths that are so nearly as near as the nearest count as well


class Network:
    """The open paths of an area, as a graph of its points."""

    def __init__(self, area: Area, closed: Collection[str] = ()) -> None:
        """Take the area, and points that nobody enters and paths that nobody drives."""
        self.index = {point.name: n for n, point in enumerate(area.points)}
        self._xy = {point.name: (point.x_m, point.y_m) for point in area.points}
        self._paths = [
            path for path in area.paths if path.key not in closed and path.end not in closed
        ]
        self._curves = [_chain(self._ends(path)) for path in self._paths]
        corners = [(chain.min(axis=0), chain.max(axis=0)) for chain in self._curves]
        self._boxes = np.array(corners).reshape(-1, 2, 2)  # path, low or high, x or y
        lengths_m = [max(_lengths_m(chain)[-1], LENGTH_M_MIN) for chain in self._curves]
        starts = [self.index[path.start] for path in self._paths]
        ends = [self.index[path.end] for path in self._paths]
        size = len(area.points)
        self._graph = csr_array((lengths_m, (starts, ends)), shape=(size, size))

    def _ends(self, path: Path) -> tuple[XY, ...]:
        return (self._xy[path.start], *path.controls, self._xy[path.end])

    def starts(self, x_m: float, y_m: float, reach_m: float) -> dict[PointName, float]:
        """Give the points that a robot between points comes to next, and how far they are.

        It is on the path that is nearest, if that is within reach, or on both of a two-way lane.
        """
        found: list[tuple[float, PointName, float]] = []
        place = np.array([x_m, y_m])
        lows, highs = self._boxes[:, 0] - reach_m, self._boxes[:, 1] + reach_m
        for number in np.flatnonzero(((lows <= place) & (place <= highs)).all(axis=1)):
            off_m, left_m = _projected(self._curves[number], place)
            if off_m <= reach_m:
                found.append((off_m, self._paths[number].end, left_m))
        nearest_m = min((off_m for off_m, _, _ in found), default=0.0)
        starts: dict[PointName, float] = {}
        for off_m, point, left_m in found:
            if off_m <= nearest_m + CLOSE_M:
                starts[point] = min(left_m, starts.get(point, left_m))
        return starts

    def distances_m(
        self, starts: Mapping[PointName, float], targets: Sequence[PointName]
    ) -> list[float | None]:
        """Give the length of the shortest way to each target; None = there is none."""
        known = [(self.index[point], m) for point, m in starts.items() if point in self.index]
        if not known:
            return [None] * len(targets)
        reached = dijkstra(self._graph, indices=[index for index, _ in known])
        whole = reached + np.array([[m] for _, m in known])
        best = whole.min(axis=0)
        return [self._found(best, target) for target in targets]

    def _found(self, best: npt.NDArray[np.float64], target: PointName) -> float | None:
        index = self.index.get(target)
        if index is None or not np.isfinite(best[index]):
            return None
        return float(best[index])


def _chain(controls: tuple[XY, ...]) -> npt.NDArray[np.float64]:
    """Corners of a path: its ends, and points on it in between where it is bent; (n, 2)."""
    points = np.asarray(controls, dtype=np.float64)
    if len(points) == 2:
        return points
    share = np.linspace(0.0, 1.0, CHORDS + 1)[:, None, None]
    level = np.repeat(points[None], CHORDS + 1, axis=0)  # (n, control points, 2)
    while level.shape[1] > 1:  # de Casteljau
        level = level[:, :-1] * (1 - share) + level[:, 1:] * share
    corners: npt.NDArray[np.float64] = level[:, 0]
    return corners


def _lengths_m(chain: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    steps = np.diff(chain, axis=0)
    return np.concatenate(([0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))))


def _projected(
    chain: npt.NDArray[np.float64], place: npt.NDArray[np.float64]
) -> tuple[float, float]:
    """Give how far off the path a place is, and how far it is from there to the path's end."""
    steps = np.diff(chain, axis=0)
    squares = np.maximum((steps**2).sum(axis=1), LENGTH_M_MIN**2)
    there = place - chain[:-1]
    share = np.clip((there * steps).sum(axis=1) / squares, 0.0, 1.0)
    off = there - share[:, None] * steps
    offs_m = np.hypot(off[:, 0], off[:, 1])
    piece = int(offs_m.argmin())
    along_m = _lengths_m(chain)
    done_m = along_m[piece] + share[piece] * (along_m[piece + 1] - along_m[piece])
    return float(offs_m[piece]), float(along_m[-1] - done_m)
