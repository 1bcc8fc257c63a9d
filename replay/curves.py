"""Curves of paths as points that can be drawn; the map's Bezier control points are exact."""

from collections.abc import Sequence
from itertools import pairwise

from ledger.ids import PathKey, PointName
from ledger.scene import XY, Area

PARTS = 12  # straight pieces that stand for a curve; a straight path has one


def _along(controls: Sequence[XY], part: float) -> XY:
    points = list(controls)
    while len(points) > 1:  # de Casteljau
        points = [
            (a[0] + (b[0] - a[0]) * part, a[1] + (b[1] - a[1]) * part) for a, b in pairwise(points)
        ]
    return points[0]


def polyline(controls: Sequence[XY]) -> list[XY]:
    """Points along a Bezier curve, both ends included."""
    if len(controls) <= 2:
        return list(controls)
    return [_along(controls, n / PARTS) for n in range(PARTS + 1)]


def lines_of(area: Area) -> dict[PathKey, list[XY]]:
    """Give every path of an area as a line; paths to points that are not there are left out."""
    places: dict[PointName, XY] = {p.name: (p.x_m, p.y_m) for p in area.points}
    return {
        path.key: polyline((places[path.start], *path.controls, places[path.end]))
        for path in area.paths
        if path.start in places and path.end in places
    }
