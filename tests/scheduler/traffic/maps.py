"""Small maps for tests of traffic."""

import json
import math
from itertools import pairwise
from pathlib import Path as FilePath

import pytest

from ledger.ids import BinName, PointName
from ledger.scene import Area, Bin, Path, Point, PointKind

SMAPS = FilePath(__file__).parents[3] / "../shared/data/smap"
KINDS = {
    "ParkPoint": PointKind.PARKING,
    "ChargePoint": PointKind.CHARGING,
    "ActionPoint": PointKind.ACTION,
}


def area_of(points: list[Point], paths: list[Path], bins: list[Bin] | None = None) -> Area:
    return Area(
        id=0,
        name="floor",
        map_name="floor",
        map_digest="",
        points=tuple(points),
        paths=tuple(paths),
        bins=tuple(bins or ()),
    )


def both(a: str, b: str) -> list[Path]:
    return [
        Path(start=PointName(a), end=PointName(b)),
        Path(start=PointName(b), end=PointName(a)),
    ]


def lattice(columns: int, rows: int, pitch_m: float = 2.0) -> Area:
    points, paths = [], []
    for i in range(columns):
        for j in range(rows):
            points.append(Point(name=PointName(f"P{i}-{j}"), x_m=i * pitch_m, y_m=j * pitch_m))
            if i + 1 < columns:
                paths += both(f"P{i}-{j}", f"P{i + 1}-{j}")
            if j + 1 < rows:
                paths += both(f"P{i}-{j}", f"P{i}-{j + 1}")
    return area_of(points, paths)


def warehouse(aisles: int, bays: int, stubs: int, blind: tuple[int, ...] = ()) -> Area:
    """Two-way single-lane aisles with a bin each metre between two cross lanes, and parking stubs
    off the lower one; the aisles of these numbers are dead ends.
    """
    points: list[Point] = []
    paths: list[Path] = []
    bins: list[Bin] = []

    def point(name: str, x: float, y: float, kind: PointKind = PointKind.WAYPOINT) -> str:
        points.append(Point(name=PointName(name), x_m=x, y_m=y, kind=kind))
        return name

    for a in range(aisles):
        x = a * 3.0
        line = [point(f"S{a}", x, 0.0)]
        for k in range(bays):
            name = point(f"B{a}-{k}", x, 2.0 + k, PointKind.ACTION)
            bins.append(Bin(name=BinName(name), point=PointName(name)))
            line.append(name)
        end = point(f"N{a}", x, bays + 3.0)
        if a not in blind:
            line.append(end)
        for first, second in pairwise(line):
            paths.extend(both(first, second))
        if a:
            paths.extend(both(f"S{a - 1}", f"S{a}"))
            paths.extend(both(f"N{a - 1}", f"N{a}"))
    for k in range(stubs):
        paths.extend(both(point(f"K{k}", k * 3.0, -2.5, PointKind.PARKING), f"S{k}"))
    return area_of(points, paths, bins)


def smap(name: str) -> Area:
    file = SMAPS / f"{name}.smap"
    if not file.exists():
        pytest.skip(f"{file.name} is not beside this repository")
    content = json.loads(file.read_text())
    points = [
        Point(
            name=PointName(entry["instanceName"]),
            x_m=entry["pos"].get("x", 0.0),
            y_m=entry["pos"].get("y", 0.0),
            kind=KINDS.get(entry["className"], PointKind.WAYPOINT),
        )
        for entry in content["advancedPointList"]
    ]
    paths = []
    for entry in content["advancedCurveList"]:
        known = {item["key"]: item for item in entry.get("property", ())}
        controls = [entry[key] for key in ("controlPos1", "controlPos2")]
        paths.append(
            Path(
                start=PointName(entry["startPos"]["instanceName"]),
                end=PointName(entry["endPos"]["instanceName"]),
                controls=tuple((c.get("x", 0.0), c.get("y", 0.0)) for c in controls),
                backward=known.get("direction", {}).get("int32Value", 0) == 1,
                speed_mps_max=known.get("maxspeed", {}).get("doubleValue"),
            )
        )
    return area_of(points, paths)


def spread(area: Area, names: list[PointName], robots: int) -> dict[str, tuple[str, float]]:
    """Robots on every n-th of these points, heading east."""
    step = len(names) / robots
    return {f"R{k:02d}": (names[math.floor(k * step)], 0.0) for k in range(robots)}
