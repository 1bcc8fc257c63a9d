"""Cells, the units of ground that are granted, and which of them exclude each other."""

from collections.abc import Sequence

import msgspec
import numpy as np
import numpy.typing as npt
import shapely

from scheduler.traffic.geometry import (
    SMOOTH_RAD,
    Floats,
    Polygons,
    Traces,
    discs,
    hull_at,
    sweeps,
    wrap,
)
from scheduler.traffic.overlap import overlaps, prism

Ints = npt.NDArray[np.int32]

# Above this number of pairs FCL checks every n-th only: 5 us each would dominate the compile.
VERDICTS_MAX = 100_000
TOUCH_M2 = 1e-4  # an overlap smaller than this may be struck out by FCL's verdict


class Cells(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All cells of one area for all footprints, equal polygons being one cell.

    A *place in the layout* is `footprint * size + local`, with local = piece of a path, then one
    rotation disc per point, then one rest polygon per point; `cell` maps it to the cell.
    """

    pieces: int
    points: int
    cell: Ints  # layout -> cell
    corners: Floats  # (n, 2) of all polygons, one after another, counter-clockwise
    offsets: Ints  # cells + 1
    indptr: Ints  # conflicts of cell c: indices[indptr[c]:indptr[c + 1]], without c itself
    indices: Ints
    checked: int  # pairs that FCL looked at
    disagreed: int  # pairs on which FCL and shapely differ by more than a touch

    @property
    def size(self) -> int:
        """Places in the layout per footprint."""
        return self.pieces + 2 * self.points

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.offsets) - 1

    def disc(self, footprint: int, point: int) -> int:
        """Cell of a turn in place."""
        return int(self.cell[footprint * self.size + self.pieces + point])

    def rest(self, footprint: int, point: int) -> int:
        """Cell of a body that rests on a point under one of the point's own headings."""
        return int(self.cell[footprint * self.size + self.pieces + self.points + point])

    def polygon(self, cell: int) -> shapely.Polygon:
        """One cell as a shapely polygon."""
        return shapely.Polygon(self.corners[self.offsets[cell] : self.offsets[cell + 1]])

    def polygons(self) -> Polygons:
        """All cells as shapely polygons."""
        rings = self.offsets.astype(np.int64)
        closed = np.insert(self.corners, rings[1:], self.corners[rings[:-1]], axis=0)
        ends = rings + np.arange(len(rings))
        polygons: Polygons = shapely.from_ragged_array(
            shapely.GeometryType.POLYGON, closed, (ends, np.arange(len(rings)))
        )
        return polygons


def rests(
    corners: Floats, xy: Floats, headings: Sequence[Sequence[float]], turning: Polygons
) -> Polygons:
    """Per point: the body under all its headings if these are parallel, else its rotation disc."""
    found = np.empty(len(xy), dtype=object)
    for point, angles in enumerate(headings):
        if angles and all(_parallel(angles[0], angle) for angle in angles):
            found[point] = hull_at(corners, tuple(xy[point]), angles)
        else:
            found[point] = turning[point]
    return found


def _parallel(a_rad: float, b_rad: float) -> bool:
    off = abs(wrap(a_rad - b_rad))
    return min(off, np.pi - off) <= SMOOTH_RAD


def lay_out(
    traces: Traces,
    footprints: Sequence[Floats],
    xy: Floats,
    headings: Sequence[Sequence[float]],
) -> Cells:
    """Make all cells for all footprints and their one conflict table."""
    parts: list[Polygons] = []
    for corners in footprints:
        turning = discs(corners, xy)
        parts += [sweeps(traces, corners), turning, rests(corners, xy, headings, turning)]
    polygons = shapely.orient_polygons(np.concatenate(parts))
    cell, chosen = _merge(polygons)
    unique = polygons[chosen]
    corners_all, offsets = _open_rings(unique)
    pairs, checked, disagreed = _conflicts(unique, corners_all, offsets)
    indptr, indices = _rows(pairs, len(unique))
    return Cells(
        pieces=traces.first[-1],
        points=len(xy),
        cell=cell,
        corners=corners_all,
        offsets=offsets.astype(np.int32),
        indptr=indptr,
        indices=indices,
        checked=checked,
        disagreed=disagreed,
    )


def _open_rings(polygons: Polygons) -> tuple[Floats, npt.NDArray[np.int64]]:
    """Corners of all polygons without the closing one, and where each polygon begins."""
    xy, owner = shapely.get_coordinates(polygons, return_index=True)
    last = np.append(owner[1:] != owner[:-1], True)[: len(owner)]
    counts = np.bincount(owner, minlength=len(polygons)) - 1
    return xy[~last], np.concatenate(([0], np.cumsum(counts)))


def _merge(polygons: Polygons) -> tuple[Ints, npt.NDArray[np.int64]]:
    """Number equal polygons once: both ways of a straight lane sweep the same ground."""
    xy, offsets = _open_rings(polygons)
    owner = np.repeat(np.arange(len(polygons)), np.diff(offsets))
    grid = np.rint(xy * 1e5).astype(np.int64)  # equal to 10 um
    grid = grid[np.lexsort((grid[:, 1], grid[:, 0], owner))]
    numbers: dict[bytes, int] = {}
    chosen: list[int] = []
    cell = np.empty(len(polygons), dtype=np.int32)
    bounds = offsets.tolist()
    for k in range(len(polygons)):
        number = numbers.setdefault(grid[bounds[k] : bounds[k + 1]].tobytes(), len(chosen))
        if number == len(chosen):
            chosen.append(k)
        cell[k] = number
    return cell, np.asarray(chosen, dtype=np.int64)


def _conflicts(
    polygons: Polygons, corners: Floats, offsets: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], int, int]:
    """Pairs (2, n) of cells that overlap: candidates by shapely, the verdict on them by FCL.

    Only a touch can be struck out: where the two differ by more, the pair stays and is counted.
    """
    tree = shapely.STRtree(polygons)
    left, right = tree.query(polygons, predicate="intersects")
    once = left < right
    left, right = left[once], right[once]
    step = 1 if len(left) <= VERDICTS_MAX else -(-len(left) // VERDICTS_MAX)
    prisms: dict[int, object] = {}
    free: list[int] = []
    for k in range(0, len(left), step):
        pair = []
        for cell in (int(left[k]), int(right[k])):
            if cell not in prisms:
                prisms[cell] = prism(corners[offsets[cell] : offsets[cell + 1]])
            pair.append(prisms[cell])
        if not overlaps(pair[0], pair[1]):
            free.append(k)
    shared = shapely.area(shapely.intersection(polygons[left[free]], polygons[right[free]]))
    touching = np.asarray(free, dtype=np.int64)[shared < TOUCH_M2]
    kept = np.ones(len(left), dtype=bool)
    kept[touching] = False
    checked = len(range(0, len(left), step))
    return np.vstack((left[kept], right[kept])), checked, len(free) - len(touching)


def _rows(pairs: npt.NDArray[np.int64], count: int) -> tuple[Ints, Ints]:
    """The symmetric table of the pairs as CSR, each row ascending."""
    both = np.hstack((pairs, pairs[::-1]))
    order = np.lexsort((both[1], both[0]))
    indptr = np.concatenate(([0], np.cumsum(np.bincount(both[0], minlength=count))))
    return indptr.astype(np.int32), both[1][order].astype(np.int32)
