"""The usable paths of an area: long ones cut into parts, and out of dead ends in reverse too.

On a two-way path of 21 m (a real map) there could be only one robot at a time; at points of our own
inside it robots may stop, let others catch up, and turn back if they are pushed.
"""

import math
from collections.abc import Sequence

import msgspec

from ledger.ids import PathKey, PointName, path_key
from ledger.scene import XY, Area, Path, Point
from scheduler.traffic.geometry import LENGTH_M_MIN, cut, is_straight, poses_along

_SAME_M = 1e-3  # the way back of a lane is the same curve within this


class Part(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A path, or a part of one."""

    path: Path
    key: PathKey  # of the path of the area
    start: int  # point numbers
    end: int
    curve: tuple[XY, ...]  # control points, both ends included
    straight: bool
    retreat: bool = False  # the map has it, but not in reverse


def parts(area: Area, points: list[Point], part_m: float = math.inf) -> list[Part]:
    """All paths with two known ends and some length; new points are appended to `points`.

    Paths of at least twice `part_m` are cut into equal parts of that length or more; both ways of a
    lane at the same points.
    """
    number = {point.name: k for k, point in enumerate(points)}
    found: list[Part] = []
    long: dict[PathKey, tuple[Part, list[Part]]] = {}
    for path in area.paths:
        if path.start not in number or path.end not in number:
            continue
        a, b = number[path.start], number[path.end]
        curve = ((points[a].x_m, points[a].y_m), *path.controls, (points[b].x_m, points[b].y_m))
        straight = is_straight(curve)
        if not straight and _span_m(curve) <= LENGTH_M_MIN:
            continue
        one = Part(path=path, key=path.key, start=a, end=b, curve=curve, straight=straight)
        length = math.dist(curve[0], curve[-1]) if straight else poses_along(curve, 2, False)[0]
        if length < 2 * part_m:
            found.append(one)
            continue
        way_back = long.get(path_key(path.end, path.start))
        if way_back is not None and _same(one.curve, way_back[0].curve[::-1]):
            made = [_back(one, part) for part in reversed(way_back[1])]
        else:
            made = _cut(one, int(length / part_m), points)
        long[path.key] = one, made
        found += made
    return found + _retreats(found)


def _retreats(found: Sequence[Part]) -> list[Part]:
    """Ways out of dead ends in reverse: the way out that the map has, over the ground of the way
    in, so that nothing is driven against a one-way path.
    """
    near: dict[int, set[int]] = {}
    for part in found:
        near.setdefault(part.start, set()).add(part.end)
        near.setdefault(part.end, set()).add(part.start)
    leaves = [point for point, others in near.items() if len(others) == 1]
    ways: dict[tuple[int, int], list[Part]] = {}
    for part in found if leaves else ():
        ways.setdefault((part.start, part.end), []).append(part)
    made = []
    while leaves:
        inner = leaves.pop()
        for mouth in near.pop(inner, ()):
            for way in ways.get((inner, mouth), ()):
                into = ways.get((mouth, inner), ())
                if any(
                    _same(way.curve, other.curve[::-1]) and way.path.backward == other.path.backward
                    for other in into
                ):
                    path = msgspec.structs.replace(way.path, backward=not way.path.backward)
                    made.append(msgspec.structs.replace(way, path=path, retreat=True))
            near[mouth].discard(inner)
            if len(near[mouth]) == 1:
                leaves.append(mouth)
    return sorted(made, key=lambda part: (part.key, part.start))


def _cut(one: Part, count: int, points: list[Point]) -> list[Part]:
    turning = points[one.start].turning and points[one.end].turning
    curves = cut(one.curve, count, one.straight)
    at = [one.start]
    for k, curve in enumerate(curves[1:], 1):
        x, y = curve[0]
        at.append(len(points))
        points.append(Point(name=PointName(f"{one.key}@{k}"), x_m=x, y_m=y, turning=turning))
    at.append(one.end)
    return [
        msgspec.structs.replace(one, start=at[k], end=at[k + 1], curve=curve)
        for k, curve in enumerate(curves)
    ]


def _back(one: Part, part: Part) -> Part:
    return msgspec.structs.replace(one, start=part.end, end=part.start, curve=part.curve[::-1])


def _same(a: Sequence[XY], b: Sequence[XY]) -> bool:
    return len(a) == len(b) and all(
        math.hypot(p[0] - q[0], p[1] - q[1]) <= _SAME_M for p, q in zip(a, b, strict=True)
    )


def _span_m(curve: Sequence[XY]) -> float:
    """Diagonal of the box around the control points: the length, if it is straight."""
    xs, ys = [xy[0] for xy in curve], [xy[1] for xy in curve]
    return math.hypot(max(xs) - min(xs), max(ys) - min(ys))
