"""Where along a Bezier path a robot is: position and heading by arc length, tabled once a curve."""

from bisect import bisect_right
from functools import lru_cache
from itertools import pairwise
from math import atan2, ceil, hypot, pi, remainder

from ledger.scene import XY, Value

SAMPLE_M = 0.025  # between two entries; a chord misses a curve of radius 1 m by 0.1 mm
SAMPLES_MAX = 2000
SPOT_M = 0.25
CURVES_MAX = 4096  # tables kept


class Track(Value, frozen=True, kw_only=True):
    """A curve by arc length; entries in between are interpolated."""

    length_m: float
    distances_m: tuple[float, ...]  # from the start, ascending
    xs_m: tuple[float, ...]
    ys_m: tuple[float, ...]
    headings_rad: tuple[float, ...]  # of the tangent, without jumps of a full turn
    curvature_max: float  # 1/m
    spots_m: tuple[XY, ...]  # some of the points, SPOT_M apart: to see who is near


def wrapped(angle_rad: float) -> float:
    """Bring an angle into [-pi, pi]."""
    return remainder(angle_rad, 2 * pi)


def _at(curve: tuple[XY, ...], t: float) -> tuple[XY, XY]:
    """Point and tangent by de Casteljau, for any degree; the tangent has no particular length."""
    points = list(curve)
    tangent = (0.0, 0.0)
    while len(points) > 1:
        if len(points) == 2:
            tangent = (points[1][0] - points[0][0], points[1][1] - points[0][1])
        points = [(a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t) for a, b in pairwise(points)]
    return points[0], tangent


def _headings(points: list[XY], tangents: list[XY]) -> list[float]:
    """Directions of the tangents; where controls coincide there is none, so take the chord's."""
    headings: list[float] = []
    last = len(points) - 1
    for i, (dx, dy) in enumerate(tangents):
        if hypot(dx, dy) < 1e-9:
            a, b = points[max(0, i - 1)], points[min(last, i + 1)]
            dx, dy = b[0] - a[0], b[1] - a[1]
        heading = atan2(dy, dx)
        if headings:
            heading = headings[-1] + wrapped(heading - headings[-1])
        headings.append(heading)
    return headings


@lru_cache(maxsize=CURVES_MAX)
def track(curve: tuple[XY, ...]) -> Track:
    """Table a curve, given by all its Bezier control points, ends included."""
    hull_m = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(curve))
    straight = len(curve) == 2
    count = 1 if straight else max(8, min(SAMPLES_MAX, ceil(hull_m / SAMPLE_M)))
    sampled = [_at(curve, i / count) for i in range(count + 1)]
    points = [point for point, _ in sampled]
    distances = [0.0]
    for a, b in pairwise(points):
        distances.append(distances[-1] + hypot(b[0] - a[0], b[1] - a[1]))
    headings = _headings(points, [tangent for _, tangent in sampled])
    curvature = 0.0
    for i in range(count):
        span_m = distances[i + 1] - distances[i]
        if span_m > SAMPLE_M / 10:
            curvature = max(curvature, abs(headings[i + 1] - headings[i]) / span_m)
    return Track(
        length_m=distances[-1],
        distances_m=tuple(distances),
        xs_m=tuple(x for x, _ in points),
        ys_m=tuple(y for _, y in points),
        headings_rad=tuple(headings),
        curvature_max=curvature,
        spots_m=_spots(points, distances),
    )


def _spots(points: list[XY], distances_m: list[float]) -> tuple[XY, ...]:
    spots = []
    reached_m = -SPOT_M
    for at_m, point in zip(distances_m, points, strict=True):
        if at_m - reached_m >= SPOT_M:
            reached_m = at_m
            spots.append(point)
    return tuple(spots)


def pose(track: Track, along_m: float) -> tuple[float, float, float, float]:
    """Position, tangent's direction and signed curvature, `along_m` from the start."""
    distances = track.distances_m
    i = min(max(bisect_right(distances, along_m) - 1, 0), len(distances) - 2)
    span_m = distances[i + 1] - distances[i]
    part = min(max((along_m - distances[i]) / span_m, 0.0), 1.0) if span_m > 0.0 else 0.0
    xs, ys, headings = track.xs_m, track.ys_m, track.headings_rad
    bend = headings[i + 1] - headings[i]
    return (
        xs[i] + (xs[i + 1] - xs[i]) * part,
        ys[i] + (ys[i + 1] - ys[i]) * part,
        headings[i] + bend * part,
        bend / span_m if span_m > 0.0 else 0.0,
    )
