"""Curves, footprints and the ground they sweep, in plain arrays and shapely polygons."""

import math
from collections.abc import Sequence
from typing import TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt
import shapely

from ledger.scene import XY

Floats: TypeAlias = npt.NDArray[np.float64]
Polygons: TypeAlias = npt.NDArray[np.object_]

PIECE_M = 0.5  # longest piece of a path whose sweep is one cell
# Steps between poses in a curved piece, by how far the heading turns in it at most (radians): one
# pose each 5 cm, and never a step of more than about 0.05 rad.
SAMPLES = ((10, 0.5), (40, 2.0), (160, math.inf))
# Every footprint is widened by this. It covers pose error, heading steps below SMOOTH_RAD, and
# what sampling leaves out between poses: step² · curvature / 8 = 0.3 mm at a radius of 1 m.
MARGIN_M = 0.05
SMOOTH_RAD = 0.05  # a smaller change of heading is driven through without a turn in place
LENGTH_M_MIN = 1e-3  # shorter paths lead nowhere and are left out
_GRID = 256  # chords by which the length of a curve is measured
_DISC_SIDES = 24


def wrap(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def turn_rad(start_rad: float, end_rad: float) -> float:
    """How far to turn, the shorter way; 0 where it is driven through without a turn in place."""
    angle = abs(wrap(end_rad - start_rad))
    return angle if angle > SMOOTH_RAD else 0.0


def bezier(controls: Floats, t: Floats) -> tuple[Floats, Floats]:
    """Positions and derivatives of one curve of any degree by de Casteljau; (n, 2) each."""
    level = np.repeat(controls[None, :, :], len(t), axis=0)  # (n, k, 2)
    share = t[:, None, None]
    while level.shape[1] > 2:
        level = level[:, :-1] * (1 - share) + level[:, 1:] * share
    step = (level[:, 1] - level[:, 0]) * (controls.shape[0] - 1)
    return level[:, 0] * (1 - t[:, None]) + level[:, 1] * t[:, None], step


def headings_along(xy: Floats, steps: Floats) -> Floats:
    """Tangents; where the derivative vanishes, the chord between the neighbours."""
    chords = np.empty_like(xy)
    chords[1:-1] = xy[2:] - xy[:-2]
    chords[0] = xy[1] - xy[0]
    chords[-1] = xy[-1] - xy[-2]
    flat = np.hypot(steps[:, 0], steps[:, 1]) < 1e-6
    steps = np.where(flat[:, None], chords, steps)
    angles: Floats = np.arctan2(steps[:, 1], steps[:, 0])
    return angles


def poses_along(controls: Sequence[XY], count: int, backward: bool) -> tuple[float, Floats]:
    """Length in metres, and `count` poses at equal distances, both ends included: (count, 3)."""
    ends = np.asarray(controls, dtype=np.float64)
    grid, along = _chords(ends)
    t = np.interp(np.linspace(0.0, along[-1], count), along, grid)
    xy, steps = bezier(ends, t)
    poses = np.column_stack((xy, headings_along(xy, steps) + (math.pi if backward else 0.0)))
    return float(along[-1]), poses


def is_straight(controls: Sequence[XY]) -> bool:
    """True if the curve does not leave its chord by 1 mm."""
    (x0, y0), (x1, y1) = controls[0], controls[-1]
    length = math.hypot(x1 - x0, y1 - y0)
    if length < LENGTH_M_MIN:
        return False
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    last = 0.0
    for x, y in controls[1:-1]:
        along, aside = (x - x0) * ux + (y - y0) * uy, (y - y0) * ux - (x - x0) * uy
        if abs(aside) > 1e-3 or along < last - 1e-9 or along > length:
            return False
        last = along
    return True


def cut_front(controls: Sequence[XY], along_m: float) -> tuple[XY, ...]:
    """Control points of what is left of a curve behind its first `along_m` metres."""
    ends = np.asarray(controls, dtype=np.float64)
    grid, along = _chords(ends)
    return _split(ends, float(np.interp(along_m, along, grid)))[1]


def cut(controls: Sequence[XY], count: int, straight: bool) -> list[tuple[XY, ...]]:
    """Control points of `count` parts of a curve of equal length."""
    ends = np.asarray(controls, dtype=np.float64)
    if straight:
        at = [tuple(xy) for xy in np.linspace(ends[0], ends[-1], count + 1).tolist()]
        return [(at[k], at[k + 1]) for k in range(count)]
    grid, along = _chords(ends)
    cuts = np.interp(np.linspace(0.0, along[-1], count + 1)[1:-1], along, grid).tolist()
    found, before = [], 0.0
    for t in cuts:
        front, rest = _split(ends, (t - before) / (1 - before))
        found.append(front)
        ends, before = np.asarray(rest), t
    return [*found, tuple((x, y) for x, y in ends.tolist())]


def _chords(ends: Floats) -> tuple[Floats, Floats]:
    """Parameters of a curve, and how far along it they are in metres."""
    grid = np.linspace(0.0, 1.0, _GRID + 1)
    xy, _ = bezier(ends, grid)
    return grid, np.concatenate(([0.0], np.cumsum(np.hypot(*(xy[1:] - xy[:-1]).T))))


def _split(ends: Floats, t: float) -> tuple[tuple[XY, ...], tuple[XY, ...]]:
    """Control points before and behind a parameter, by de Casteljau."""
    front, rest, level = [ends[0]], [ends[-1]], ends
    while len(level) > 1:
        level = level[:-1] * (1 - t) + level[1:] * t
        front.append(level[0])
        rest.append(level[-1])
    return _corners(front), _corners(rest[::-1])


def _corners(points: Sequence[Floats]) -> tuple[XY, ...]:
    return tuple((float(x), float(y)) for x, y in points)


class Traces(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All paths of an area as poses, cut into pieces of equal length."""

    curves: list[tuple[XY, ...]]  # control points, both ends included
    length_m: list[float]
    first: list[int]  # paths + 1: pieces of path p are first[p] .. first[p + 1]
    heading_start: list[float]  # of the body: tangent, turned by pi on backward paths
    heading_end: list[float]
    # Piece numbers and their poses (n, samples, 3), for each number of samples
    batches: list[tuple[npt.NDArray[np.int64], Floats]]


def trace(
    curves: Sequence[tuple[XY, ...]],
    backward: Sequence[bool],
    straight: Sequence[bool] | None = None,
) -> Traces:
    """Sample every path; straight pieces need their two end poses only, for a hull is exact.

    `straight`: what `is_straight` says of each, where that is known.
    """
    plain = np.array([is_straight(c) for c in curves] if straight is None else straight, dtype=bool)
    ends = np.array([(curve[0], curve[-1]) for curve in curves]).reshape(-1, 2, 2)
    flip = np.where(np.asarray(backward, dtype=bool), math.pi, 0.0)
    along = ends[:, 1] - ends[:, 0]
    lengths = np.hypot(along[:, 0], along[:, 1])
    angles = np.arctan2(along[:, 1], along[:, 0]) + flip
    headings = np.column_stack((angles, angles))
    curved: dict[int, Floats] = {}
    for k in np.flatnonzero(~plain).tolist():
        length, _ = poses_along(curves[k], 2, backward[k])
        lengths[k], poses = _close_poses(curves[k], _pieces(length), backward[k])
        curved[k] = poses
        headings[k] = poses[0, 2], poses[-1, 2]
    counts = np.maximum(1, np.ceil(lengths / PIECE_M - 1e-9)).astype(np.int64)
    first = np.concatenate(([0], np.cumsum(counts)))
    batches: dict[int, tuple[list[npt.NDArray[np.int64]], list[Floats]]] = {}
    if plain.any():
        owner = np.repeat(np.arange(len(counts)), np.where(plain, counts, 0))
        number = np.flatnonzero(np.repeat(plain, counts))
        share = ((number - first[owner])[:, None] + np.array([0, 1])) / counts[owner, None]
        xy = ends[owner, None, 0] + along[owner, None] * share[:, :, None]
        heading = np.repeat(angles[owner], 2).reshape(-1, 2, 1)
        batches[1] = [number], [np.concatenate((xy, heading), axis=2)]
    for k, poses in curved.items():
        count = int(counts[k])
        step = (len(poses) - 1) // count
        numbers, kept = batches.setdefault(step, ([], []))
        numbers.append(np.arange(first[k], first[k + 1]))
        kept.append(np.stack([poses[n * step : (n + 1) * step + 1] for n in range(count)]))
    headings = (headings + math.pi) % (2 * math.pi) - math.pi
    return Traces(
        curves=list(curves),
        length_m=lengths.tolist(),
        first=first.tolist(),
        heading_start=headings[:, 0].tolist(),
        heading_end=headings[:, 1].tolist(),
        batches=[
            (np.concatenate(numbers), np.concatenate(kept))
            for _, (numbers, kept) in sorted(batches.items())
        ],
    )


def _pieces(length_m: float) -> int:
    return max(1, math.ceil(length_m / PIECE_M - 1e-9))


def _close_poses(controls: Sequence[XY], pieces: int, backward: bool) -> tuple[float, Floats]:
    """Poses so close that the hull of neighbours holds all between them, in sharp bends too."""
    for steps, turning_max in SAMPLES:
        length, poses = poses_along(controls, pieces * steps + 1, backward)
        turns = np.abs((np.diff(poses[:, 2]) + math.pi) % (2 * math.pi) - math.pi)
        if turns.reshape(pieces, steps).sum(axis=1).max() <= turning_max:
            break
    return length, poses


def widened(footprint: Sequence[XY], margin_m: float = MARGIN_M) -> Floats:
    """Corners of the footprint's convex hull, moved outwards by a margin; (n, 2), metres."""
    hull = shapely.convex_hull(shapely.multipoints(np.asarray(footprint, dtype=np.float64)))
    wide = shapely.buffer(hull, margin_m, join_style="mitre", mitre_limit=2.0)
    corners: Floats = shapely.get_coordinates(wide)[:-1]
    return corners


def placed(corners: Floats, poses: Floats) -> Floats:
    """Corners of a body at each pose: (n, 3) -> (n, corners, 2)."""
    cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x, y = corners[None, :, 0], corners[None, :, 1]
    return np.stack(
        (poses[:, 0, None] + cos * x - sin * y, poses[:, 1, None] + sin * x + cos * y), axis=-1
    )


def body_at(corners: Floats, x_m: float, y_m: float, heading_rad: float) -> shapely.Polygon:
    """The polygon of a body at one pose."""
    return shapely.Polygon(placed(corners, np.array([[x_m, y_m, heading_rad]]))[0])


def sweeps(traces: Traces, corners: Floats) -> Polygons:
    """One polygon per piece: the convex hull of the body at all its poses.

    While the reference point is inside the piece, the body is inside this polygon.
    """
    cells = np.empty(traces.first[-1], dtype=object)
    for numbers, poses in traces.batches:
        corner_xy = placed(corners, poses.reshape(-1, 3)).reshape(len(poses), -1, 2)
        # Rounded to 1 um, so that both ways of a straight lane give the same corners.
        cells[numbers] = shapely.convex_hull(shapely.linestrings(np.round(corner_xy, 6)))
    return cells


def discs(corners: Floats, xy: Floats) -> Polygons:
    """The ground swept by a turn in place at each point: a polygon around the circle."""
    radius = float(np.hypot(corners[:, 0], corners[:, 1]).max()) / math.cos(math.pi / _DISC_SIDES)
    angles = np.arange(_DISC_SIDES) * (2 * math.pi / _DISC_SIDES)
    ring = radius * np.column_stack((np.cos(angles), np.sin(angles)))
    polygons: Polygons = shapely.polygons(xy[:, None, :] + ring[None, :, :])
    return polygons


def hull_at(corners: Floats, xy: XY, headings: Sequence[float]) -> shapely.Polygon:
    """Hull of a body on one point under several headings."""
    poses = np.array([[xy[0], xy[1], heading] for heading in headings])
    return shapely.convex_hull(shapely.multipoints(placed(corners, poses).reshape(-1, 2)))
