"""The ground that an external reservation means, as polygons (spec/m4.md, MapResourceUnit)."""

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

from ledger.ids import UnitId
from ledger.scene import XY, Area, Path, Point, Value
from ledger.state import MapUnit

AROUND_M = 0.05  # reserved on each side of a point (a square) and of a path
SAMPLES = 65  # positions on a curved path
OVERLAP_M2 = 1e-9  # polygons that only touch share less than this
AREA_M2_MIN = 1e-6
REMEMBERED_MAX = 10_000
AREAS_REMEMBERED_MAX = 64

Polygons: TypeAlias = npt.NDArray[Any]  # of shapely polygons

_remembered: dict[UnitId, tuple[MapUnit, Area, Polygons]] = {}


def fault_of(ring: tuple[XY, ...]) -> str | None:
    """Say what keeps these vertices from being the outline of a piece of ground; None = nothing."""
    polygon = shapely.Polygon(ring)
    if polygon.convex_hull.area < AREA_M2_MIN:
        return "it has no area"
    if not polygon.is_valid:
        return f"its outline is not simple ({shapely.is_valid_reason(polygon)})"
    return None


class Names(Value, frozen=True, kw_only=True):
    """Points and paths of an area by what clients call them."""

    points: dict[str, Point]
    paths: dict[str, Path]


_indexed: dict[int, tuple[Area, Names]] = {}


def names_of(area: Area) -> Names:
    """Index an area, once for as long as it stays the same."""
    known = _indexed.get(id(area))
    if known is not None and known[0] is area:
        return known[1]
    points: dict[str, Point] = {point.name: point for point in area.points}
    paths: dict[str, Path] = {path.key: path for path in area.paths}
    while len(_indexed) >= AREAS_REMEMBERED_MAX:
        _indexed.pop(next(iter(_indexed)), None)
    _indexed[id(area)] = (area, Names(points=points, paths=paths))
    return _indexed[id(area)][1]


def ground_of(area: Area, unit: MapUnit) -> Polygons:
    """Give the polygons of a unit; names that a newer map has not any more stand for no ground.

    Remembered by identity: what is held is compared with all that is asked for.
    """
    known = _remembered.get(unit.id)
    if known is not None and known[0] is unit and known[1] is area:
        return known[2]
    names = names_of(area)
    at, lanes = names.points, names.paths
    found = [_square(at[name]) for name in unit.points if name in at]
    found += [_lane(at, lanes[key]) for key in unit.paths if key in lanes]
    found += [shapely.Polygon(ring) for ring in unit.zones]
    polygons = np.array(found, dtype=object)
    while len(_remembered) >= REMEMBERED_MAX:
        _remembered.pop(next(iter(_remembered)), None)
    _remembered[unit.id] = (unit, area, polygons)
    return polygons


def overlap(new: Polygons, held: Polygons) -> int | None:
    """Give the index of the first held polygon that shares ground with a new one."""
    if not len(new) or not len(held):
        return None
    wanted, others = shapely.STRtree(held).query(new, predicate="intersects")
    shared = shapely.area(shapely.intersection(new[wanted], held[others])) > OVERLAP_M2
    return int(others[shared].min()) if shared.any() else None


def _square(point: Point) -> shapely.Polygon:
    x, y = point.x_m, point.y_m
    return shapely.box(x - AROUND_M, y - AROUND_M, x + AROUND_M, y + AROUND_M)


def _lane(at: dict[str, Point], path: Path) -> shapely.Polygon:
    first, last = at[path.start], at[path.end]
    controls = ((first.x_m, first.y_m), *path.controls, (last.x_m, last.y_m))
    samples = SAMPLES if path.controls else 2
    level = np.repeat(np.array(controls)[None], samples, axis=0)
    share = np.linspace(0.0, 1.0, samples)[:, None, None]
    while level.shape[1] > 1:
        level = level[:, :-1] * (1 - share) + level[:, 1:] * share
    outline = shapely.LineString(level[:, 0]).buffer(AROUND_M)
    return shapely.Polygon(outline.exterior)
