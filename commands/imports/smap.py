"""SEER .smap maps (spec/protocols.md §4): JSON by proto3, so zeros and false are left out."""

import hashlib
import json
from math import hypot, isfinite

import msgspec
import structlog

from commands.imports.arcs import arc_controls
from commands.imports.checks import BAD_SCENE, checked, simulated
from commands.imports.smap_wire import Curve, PointMark, Position, Smap, Storage
from ledger.errors import Refused
from ledger.ids import BinName, PointName
from ledger.scene import (
    XY,
    Area,
    Bin,
    BinTask,
    Group,
    Path,
    Point,
    PointKind,
    SceneFile,
)

log = structlog.get_logger()

SMAP_BYTES_MAX = 256 * 1024 * 1024
SAME_PLACE_M = 0.05  # a curve's end without a name is the point that lies this near
DRAWN_LINES = frozenset({"FeatureLine", "ForbiddenLine"})

# 2019 maps say LandMark for LocationMark; classes not named here are only driven over
KINDS = {
    "ActionPoint": PointKind.ACTION,
    "ParkPoint": PointKind.PARKING,
    "ChargePoint": PointKind.CHARGING,
}
PREFIXES = {
    PointKind.WAYPOINT: "LM",
    PointKind.ACTION: "AP",
    PointKind.PARKING: "PP",
    PointKind.CHARGING: "CP",
}


def read_smap(
    raw: bytes,
    *,
    name: str | None,
    robots: int,
    groups: tuple[Group, ...] | None = None,
) -> SceneFile:
    """Read one map as a scene of one area. Raises Refused, naming the entry that is wrong.

    Names survive; points without one are called after their class and place in the file.
    """
    if len(raw) > SMAP_BYTES_MAX:
        raise Refused(BAD_SCENE, f"a map has at most {SMAP_BYTES_MAX} bytes", len(raw))
    try:
        smap = msgspec.json.decode(raw, type=Smap)
    except msgspec.ValidationError as error:
        raise Refused(BAD_SCENE, f"smap: {error}") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Refused(BAD_SCENE, f"smap is not JSON: {error}") from error
    if not smap.points:
        raise Refused(BAD_SCENE, "advancedPointList: the map has no point")
    named = _named(smap.points)
    bins = _bins(smap, named)
    worked_at = {spot.point for spot in bins}
    kinds = groups or (Group(id=0, name="default"),)
    map_name = smap.header.map_name or name or "map"
    area = Area(
        id=0,
        name=map_name,
        map_name=map_name,
        map_digest=hashlib.md5(raw, usedforsecurity=False).hexdigest(),
        points=tuple(_point(n, mark, n in worked_at) for n, mark in named.items()),
        paths=_paths(smap.curves, named),
        bins=bins,
        walls=_walls(smap),
    )
    return checked(
        SceneFile(
            name=name or map_name,
            areas=(area,),
            groups=kinds,
            robots=simulated(robots, kinds),
        )
    )


def _named(marks: list[PointMark]) -> dict[PointName, PointMark]:
    taken = {mark.name for mark in marks}
    named: dict[PointName, PointMark] = {}
    for i, mark in enumerate(marks):
        given = mark.name
        if not given:
            prefix = PREFIXES[KINDS.get(mark.kind, PointKind.WAYPOINT)]
            number = i + 1
            while f"{prefix}{number}" in taken:
                number += len(marks)
            given = f"{prefix}{number}"
            taken.add(given)
        if given in named:
            where = f"advancedPointList[{i}].instanceName"
            raise Refused(BAD_SCENE, f"{where}: {given!r} is there twice", given)
        named[PointName(given)] = mark
    return named


def _point(name: PointName, mark: PointMark, worked_at: bool) -> Point:
    kind = KINDS.get(mark.kind, PointKind.WAYPOINT)
    if kind is PointKind.WAYPOINT and worked_at:
        kind = PointKind.ACTION
    # Every point has the direction in which it was recorded. Only where the robot works does it
    # matter, and not there if ignoreDir says so (a missing one is false, a missing dir is 0).
    heading = None
    if KINDS.get(mark.kind) in (PointKind.ACTION, PointKind.CHARGING) and not mark.ignore_dir:
        heading = mark.dir
    return Point(
        name=name,
        x_m=mark.pos.x,
        y_m=mark.pos.y,
        kind=kind,
        heading_rad=heading,
        # `spin` is about the lifting plate, which turns along or not; the robot turns either way
        turning=mark.flag("allowrotate", default=True),
    )


def _paths(curves: list[Curve], named: dict[PointName, PointMark]) -> tuple[Path, ...]:
    """Translate curves, keyed on their ends: 2019 maps give both directions the same name."""
    paths: dict[tuple[str, str], Path] = {}
    for i, curve in enumerate(curves):
        where = f"advancedCurveList[{i}]"
        start = _end(f"{where}.startPos", curve.start.name, curve.start.pos, named)
        end = _end(f"{where}.endPos", curve.end.name, curve.end.pos, named)
        if start == end or (start, end) in paths:
            why = "ends where it starts" if start == end else "is there twice; the first counts"
            log.warning("a path is left out", path=f"{start}->{end}", curve=curve.name, reason=why)
            continue
        paths[start, end] = Path(
            start=start,
            end=end,
            controls=_controls(where, curve, named[start].pos.xy, named[end].pos.xy),
            backward=curve.number(where, "direction") == 1,
            speed_mps_max=_limit(curve.number(where, "maxspeed")),
            acceleration_mps2_max=_limit(curve.number(where, "maxacc")),
        )
    return tuple(paths.values())


def _end(
    where: str, given: str, pos: Position | None, named: dict[PointName, PointMark]
) -> PointName:
    if given in named:
        return PointName(given)
    if pos is not None:
        near = [
            (hypot(mark.pos.x - pos.x, mark.pos.y - pos.y), name) for name, mark in named.items()
        ]
        gap_m, name = min(near)
        if gap_m <= SAME_PLACE_M and not given:
            return name
    raise Refused(BAD_SCENE, f"{where}.instanceName: no point is named {given!r}", given)


def _controls(where: str, curve: Curve, start: XY, end: XY) -> tuple[XY, ...]:
    """Give the Bezier controls between the ends, by the shape's class (spec/protocols.md §4)."""
    one, two = curve.control1, curve.control2
    match curve.kind:
        case "StraightPath":
            return ()
        case "ArcPath":
            return () if one is None else arc_controls(start, one.xy, end)
        case "BezierPath" | "" if one is None and two is None:
            return ()
        case "BezierPath" | "DegenerateBezier" | "":
            if one is None or two is None:
                missing = "controlPos1" if one is None else "controlPos2"
                raise Refused(BAD_SCENE, f"{where}.{missing}: missing in a {curve.kind}", where)
            if curve.kind == "DegenerateBezier":
                return (one.xy, one.xy, two.xy, two.xy)
            return (one.xy, two.xy)
        case unknown:
            raise Refused(BAD_SCENE, f"{where}.className: unknown shape {unknown!r}", unknown)


def _limit(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) and value > 0.0 else None


def _bins(smap: Smap, named: dict[PointName, PointMark]) -> tuple[Bin, ...]:
    bins: dict[str, Bin] = {}
    for i, row in enumerate(smap.bin_rows):
        for k, storage in enumerate(row.bins):
            where = f"binLocationsList[{i}].binLocationList[{k}]"
            given = storage.name or f"BIN-{i + 1}-{k + 1}"
            if not storage.point:
                log.warning("a bin is left out", bin=given, reason="it has no pointName")
                continue
            if storage.point not in named:
                what = f"{where}.pointName: no point is named {storage.point!r} (bin {given})"
                raise Refused(BAD_SCENE, what, storage.point)
            if given in bins:
                raise Refused(BAD_SCENE, f"{where}.instanceName: {given!r} is there twice", given)
            bins[given] = Bin(
                name=BinName(given),
                point=PointName(storage.point),
                tasks=_tasks(f"{where}.property.binTask", storage),
            )
    return tuple(bins.values())


def _tasks(where: str, storage: Storage) -> tuple[BinTask, ...]:
    """Read `[{taskName: {operation, …}}, …]`; what is beside the operation is its arguments."""
    text = storage.text("binTask")
    if not text:
        return ()
    try:
        entries = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Refused(BAD_SCENE, f"{where} of {storage.name}: {error}", storage.name) from error
    tasks: dict[str, BinTask] = {}
    for entry in entries if isinstance(entries, list) else [entries]:
        for task, told in entry.items() if isinstance(entry, dict) else [("", None)]:
            if not isinstance(told, dict):
                what = f"{where} of {storage.name}: not a list of {{task: {{operation, …}}}}"
                raise Refused(BAD_SCENE, what, storage.name)
            arguments = {key: value for key, value in told.items() if key != "operation"}
            tasks.setdefault(
                task,
                BinTask(
                    name=task,
                    operation=str(told.get("operation", task)),
                    arguments=json.dumps(arguments, ensure_ascii=False, separators=(",", ":")),
                ),
            )
    return tuple(tasks.values())


def _walls(smap: Smap) -> tuple[tuple[XY, XY], ...]:
    """Take lines only: the tens of thousands of scanned points are of no use in a drawing."""
    drawn = [line.line for line in smap.named_lines if line.kind in DRAWN_LINES]
    return tuple((line.start.xy, line.end.xy) for line in [*smap.lines, *drawn])
