"""Robots and what traffic granted them, as Foxglove's protobuf messages, put together by hand.

`foxglove.FrameTransforms`: every robot is a frame named SCENE/ROBOT in the frame SCENE/AREA.
`foxglove.SceneUpdate`: a line from each robot through the middles of the ground that it holds;
amber where it waits for somebody. One message holds many robots: a message, and a channel, of its
own for each robot cost ten times the CPU time and a hundred bytes of index a second.
"""

from collections.abc import Iterable
from functools import lru_cache
from math import cos, sin
from struct import Struct

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from ledger.link import Plan, Report

POSES, GRANTS = FrameTransforms, SceneUpdate
STRINGS_CACHED = 8192
LINE_M = 0.15  # thickness of the line
# Coordinates in steps of a power of two (1 mm) and turns in steps of 0.2 mrad: then the low bytes
# of a double are zeros, which pack to nothing.
FINE, FINE_TURN = 1024.0, 4096.0

# Keys of protobuf fields: number * 8 + wire type (0 = varint, 1 = double, 2 = length before it).
_TRANSFORM = Struct("<BBBdBdBBBdBd")  # translation {x, y}, rotation {z, w}
_POINT = Struct("<BBBdBd")  # {x, y}, its own key before it
_DOUBLE = Struct("<Bd")


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _field(number: int, body: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(body)) + body


@lru_cache(maxsize=STRINGS_CACHED)
def _text(number: int, value: str) -> bytes:
    return _field(number, value.encode())


@lru_cache(maxsize=64)
def _time(at_ms: int) -> bytes:
    seconds, ms = divmod(at_ms, 1000)
    return _field(1, b"\x08" + _varint(seconds) + b"\x10" + _varint(ms * 1_000_000))


def _fine(value_m: float) -> float:
    return round(value_m * FINE) / FINE


def poses(reports: Iterable[Report]) -> bytes:
    """Give FrameTransforms."""
    transforms = []
    for report in reports:
        half_rad = report.heading_rad / 2
        body = (
            _time(report.at_ms)
            + _text(2, f"{report.scene}/{report.area}")
            + _text(3, f"{report.scene}/{report.robot}")
            + _TRANSFORM.pack(
                *(0x22, 18, 0x09, _fine(report.x_m), 0x11, _fine(report.y_m)),
                *(0x2A, 18, 0x19, round(sin(half_rad) * FINE_TURN) / FINE_TURN),
                *(0x21, round(cos(half_rad) * FINE_TURN) / FINE_TURN),
            )
        )
        transforms.append(_field(1, body))
    return b"".join(transforms)


def _colour(red: float, green: float, blue: float) -> bytes:
    values = enumerate((red, green, blue, 1.0), start=1)
    return _field(6, b"".join(_DOUBLE.pack(n << 3 | 1, value) for n, value in values))


_UNMOVED = _field(2, _field(2, _DOUBLE.pack(0x21, 1.0)))  # pose {orientation {w: 1}}
_LINE = _UNMOVED + _DOUBLE.pack(0x19, LINE_M)
_GRANTED, _WAITING = _colour(0.125, 0.75, 0.375), _colour(1.0, 0.625, 0.0)


def grants(plans: Iterable[tuple[Plan, Report]]) -> bytes:
    """Give a SceneUpdate of plans, each with where its robot is."""
    entities = []
    for plan, report in plans:
        points = [_POINT.pack(0x2A, 18, 0x09, _fine(report.x_m), 0x11, _fine(report.y_m))]
        for space in plan.spaces:
            if not (ring := space.points):
                continue
            (x1, y1), (x2, y2) = ring[0], ring[len(ring) // 2]  # opposite, of cells and circles
            middle = (0x09, _fine((x1 + x2) / 2), 0x11, _fine((y1 + y2) / 2))
            points.append(_POINT.pack(0x2A, 18, *middle))
        colour = _WAITING if plan.blocked_by else _GRANTED
        body = (
            _time(plan.at_ms)
            + _text(2, f"{plan.scene}/{report.area}")
            + _text(3, plan.robot)
            + _field(11, _LINE + b"".join(points) + colour)
        )
        entities.append(_field(2, body))
    return b"".join(entities)
