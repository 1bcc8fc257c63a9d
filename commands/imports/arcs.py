"""Circle arcs as Bezier controls, for formats that have arcs: one curve whatever the angle."""

from math import atan2, cos, hypot, pi, sin, tan

import numpy as np

from ledger.scene import XY

CUBIC_RAD_MAX = pi / 2  # up to here a cubic is off by less than 0.03 % of the radius
DEGREE = 7  # beyond: off by less than 0.1 % of the radius up to three quarters of a circle
SAMPLES = 64
FLAT = 1e-6  # a bend less than this share of the chord is a straight line


def arc_controls(start: XY, through: XY, end: XY) -> tuple[XY, ...]:
    """Give the controls between the ends of the circle arc through three points.

    None if they are in one line: a straight path has none.
    """
    circle = _circle(start, through, end)
    if circle is None:
        return ()
    centre, radius_m, first_rad, swept_rad = circle
    if abs(swept_rad) <= CUBIC_RAD_MAX:
        reach_m = 4.0 / 3.0 * tan(swept_rad / 4.0) * radius_m
        last_rad = first_rad + swept_rad
        return (
            (start[0] - reach_m * sin(first_rad), start[1] + reach_m * cos(first_rad)),
            (end[0] + reach_m * sin(last_rad), end[1] - reach_m * cos(last_rad)),
        )
    return _fitted(start, end, centre, radius_m, first_rad, swept_rad)


def _circle(a: XY, b: XY, c: XY) -> tuple[XY, float, float, float] | None:
    """Centre, radius, direction of `a` from the centre, and the signed angle from `a` to `c`."""
    bx, by, cx, cy = b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]
    twice_area = bx * cy - by * cx
    if abs(twice_area) <= FLAT * (hypot(cx, cy) ** 2 + hypot(bx, by) ** 2):
        return None
    b2, c2 = bx * bx + by * by, cx * cx + cy * cy
    x = (cy * b2 - by * c2) / (2.0 * twice_area)
    y = (bx * c2 - cx * b2) / (2.0 * twice_area)
    first_rad = atan2(-y, -x)
    swept_rad = (atan2(cy - y, cx - x) - first_rad) % (2.0 * pi)
    if twice_area < 0.0:  # clockwise
        swept_rad -= 2.0 * pi
    return (a[0] + x, a[1] + y), hypot(x, y), first_rad, swept_rad


def _fitted(
    start: XY, end: XY, centre: XY, radius_m: float, first_rad: float, swept_rad: float
) -> tuple[XY, ...]:
    """Least squares over samples of the arc, both ends fixed."""
    t = np.linspace(0.0, 1.0, SAMPLES)[1:-1]
    angles = first_rad + swept_rad * t
    arc = np.stack([centre[0] + radius_m * np.cos(angles), centre[1] + radius_m * np.sin(angles)])
    choose = [1, 7, 21, 35, 35, 21, 7, 1]
    basis = np.stack(
        [choose[k] * t**k * (1.0 - t) ** (DEGREE - k) for k in range(DEGREE + 1)]
    )  # (DEGREE + 1, samples)
    known = np.outer(start, basis[0]) + np.outer(end, basis[-1])
    inner, *_ = np.linalg.lstsq(basis[1:-1].T, (arc - known).T, rcond=None)
    return tuple((float(x), float(y)) for x, y in inner)
