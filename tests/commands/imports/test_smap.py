"""SEER maps: the real ones where they are at hand, and small ones for each rule."""

import hashlib
import json
from itertools import pairwise
from math import cos, hypot, pi, sin
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from commands.imports.arcs import arc_controls
from commands.imports.scene_json import check_references
from commands.imports.smap import read_smap
from ledger.errors import Refused
from ledger.ids import PointName
from ledger.scene import XY, PointKind, SceneFile

MAPS = Path(__file__).parents[3] / "../shared/data/smap"


def mark(kind: str, name: str, x: float = 0.0, y: float = 0.0, **more: Any) -> dict[str, Any]:
    pos = {key: value for key, value in (("x", x), ("y", y)) if value != 0.0}  # as proto3 writes
    return {"className": kind, "instanceName": name, "pos": pos, **more}


def curve(kind: str, start: str, end: str, **more: Any) -> dict[str, Any]:
    return {
        "className": kind,
        "instanceName": f"{start}-{end}",
        "startPos": {"instanceName": start},
        "endPos": {"instanceName": end},
        **more,
    }


def flag(key: str, value: bool) -> dict[str, Any]:
    return {"key": key, "type": "bool", "boolValue": value}


def read(**parts: Any) -> SceneFile:
    points = [mark("LocationMark", "LM1"), mark("ActionPoint", "AP2", 2.0)]
    smap = {"header": {"mapName": "M"}, "advancedPointList": points, **parts}
    return read_smap(json.dumps(smap).encode(), name=None, robots=1)


CONTROLS = {"controlPos1": {"x": 0.5, "y": 1.0}, "controlPos2": {"x": 1.5}}


def test_zeros_that_were_left_out_are_zeros() -> None:
    point = read().areas[0].points[0]
    assert (point.x_m, point.y_m) == (0.0, 0.0)


def test_the_digest_is_the_md5_of_the_file() -> None:
    raw = json.dumps({"header": {}, "advancedPointList": [mark("LandMark", "LM1")]}).encode()
    assert read_smap(raw, name="x", robots=0).areas[0].map_digest == hashlib.md5(raw).hexdigest()


def test_both_directions_may_share_a_name() -> None:
    there = curve("BezierPath", "LM1", "AP2", **CONTROLS)
    back = curve("BezierPath", "AP2", "LM1", **CONTROLS) | {"instanceName": "LM1-AP2"}
    paths = read(advancedCurveList=[there, back, there]).areas[0].paths
    assert [p.key for p in paths] == ["LM1->AP2", "AP2->LM1"]


@pytest.mark.parametrize(
    ("kind", "controls"),
    [
        ("BezierPath", ((0.5, 1.0), (1.5, 0.0))),
        ("DegenerateBezier", ((0.5, 1.0), (0.5, 1.0), (1.5, 0.0), (1.5, 0.0))),
        ("StraightPath", ()),
    ],
)
def test_shapes_become_bezier_controls(kind: str, controls: tuple[XY, ...]) -> None:
    area = read(advancedCurveList=[curve(kind, "LM1", "AP2", **CONTROLS)]).areas[0]
    assert area.paths[0].controls == controls


def test_curve_properties_become_limits_and_direction() -> None:
    properties = [
        {"key": "direction", "type": "int", "value": "MQ=="},  # base64 of 1, as old files have it
        {"key": "maxspeed", "type": "double", "doubleValue": 0.4},
        {"key": "maxacc", "type": "double"},  # 0, left out: no limit of its own
    ]
    path = read(advancedCurveList=[curve("StraightPath", "LM1", "AP2", property=properties)])
    got = path.areas[0].paths[0]
    assert (got.backward, got.speed_mps_max, got.acceleration_mps2_max) == (True, 0.4, None)


def test_only_forbidden_rotation_stops_turning() -> None:
    points = [
        mark("LocationMark", "LM1", property=[flag("allowrotate", False), flag("spin", False)]),
        mark("LocationMark", "LM2", 3.0, property=[flag("spin", False)]),
    ]
    area = read(advancedPointList=points).areas[0]
    assert [p.turning for p in area.points] == [False, True]


def test_a_heading_is_demanded_only_where_work_is_done() -> None:
    points = [
        mark("ActionPoint", "AP1", dir=1.5),
        mark("ActionPoint", "AP2", 2.0, dir=1.5, ignoreDir=True),
        mark("LocationMark", "LM3", 4.0, dir=1.5),
        mark("ChargePoint", "CP4", 6.0),
    ]
    area = read(advancedPointList=points).areas[0]
    assert [p.heading_rad for p in area.points] == [1.5, None, None, 0.0]


def test_points_without_a_name_get_a_free_one() -> None:
    points = [mark("LocationMark", "LM2"), mark("LandMark", "", 1.0), mark("ParkPoint", "", 2.0)]
    names = [p.name for p in read(advancedPointList=points).areas[0].points]
    assert names == ["LM2", "LM5", "PP3"]


def test_a_curve_without_names_ends_at_the_points_that_are_there() -> None:
    bare = {"className": "StraightPath", "startPos": {"pos": {}}, "endPos": {"pos": {"x": 2.01}}}
    assert read(advancedCurveList=[bare]).areas[0].paths[0].key == "LM1->AP2"


def test_bin_tasks_keep_their_names_and_arguments() -> None:
    tasks = [{"load": {"operation": "ForkLoad", "end_height": 0.5}}, {"wait": {}}]
    storage = mark("GeneralLocation", "S-1", pointName="LM1") | {
        "property": [{"key": "binTask", "type": "json", "stringValue": json.dumps(tasks)}]
    }
    area = read(binLocationsList=[{"binLocationList": [storage]}]).areas[0]
    assert [(t.name, t.operation, t.arguments) for t in area.bins[0].tasks] == [
        ("load", "ForkLoad", '{"end_height":0.5}'),
        ("wait", "wait", "{}"),
    ]
    assert area.points[0].kind is PointKind.ACTION  # work is done where a bin is


BAD_TASK = {"key": "binTask", "stringValue": "[1]"}


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"header": 1}, "$.header"),
        ({"advancedPointList": []}, "advancedPointList"),
        ({"advancedPointList": [mark("LandMark", "A"), mark("LandMark", "A")]}, "[1].instanceName"),
        ({"advancedCurveList": [curve("StraightPath", "LM1", "XX")]}, "[0].endPos"),
        ({"advancedCurveList": [curve("BezierPath", "LM1", "AP2", controlPos1={})]}, "controlPos2"),
        ({"advancedCurveList": [curve("Spiral", "LM1", "AP2")]}, "'Spiral'"),
        (
            {"binLocationsList": [{"binLocationList": [mark("G", "S", pointName="XX")]}]},
            "binLocationList[0].pointName",
        ),
        (
            {
                "binLocationsList": [
                    {"binLocationList": [mark("G", "S", pointName="LM1", property=[BAD_TASK])]}
                ]
            },
            "binTask of S",
        ),
    ],
)
def test_what_is_wrong_is_named(parts: dict[str, Any], words: str) -> None:
    with pytest.raises(Refused) as refused:
        read(**parts)
    assert words in refused.value.message


@given(raw=st.binary(max_size=200))
def test_garbage_is_refused(raw: bytes) -> None:
    with pytest.raises(Refused):
        read_smap(raw, name=None, robots=0)


@given(
    radius_m=st.floats(0.2, 20.0),
    first_rad=st.floats(-pi, pi),
    swept_rad=st.one_of(st.floats(0.1, 4.7), st.floats(-4.7, -0.1)),
)
def test_an_arc_stays_on_its_circle(radius_m: float, first_rad: float, swept_rad: float) -> None:
    def on(part: float) -> XY:
        angle = first_rad + part * swept_rad
        return (3.0 + radius_m * cos(angle), -2.0 + radius_m * sin(angle))

    controls = arc_controls(on(0.0), on(0.5), on(1.0))
    points = [on(0.0), *controls, on(1.0)]
    for step in range(1, 20):
        level = points
        while len(level) > 1:
            level = [
                (a[0] + (b[0] - a[0]) * step / 20, a[1] + (b[1] - a[1]) * step / 20)
                for a, b in pairwise(level)
            ]
        off = hypot(level[0][0] - 3.0, level[0][1] + 2.0) - radius_m
        assert abs(off) < 2e-3 * radius_m


def test_an_arc_through_points_in_a_line_is_straight() -> None:
    arc = curve("ArcPath", "LM1", "AP2", controlPos1={"x": 1.0})
    assert read(advancedCurveList=[arc]).areas[0].paths[0].controls == ()


@pytest.mark.parametrize(
    ("file", "points", "paths", "bins", "backward"),
    [
        ("seer_sample_3.smap", 41, 81, 0, 11),
        ("ws_ps_bins.smap", 38, 80, 8, 0),
        ("degenerate_20250908.smap", 3, 6, 0, 2),
    ],
)
def test_the_real_maps_import(file: str, points: int, paths: int, bins: int, backward: int) -> None:
    path = MAPS / file
    if not path.exists():
        pytest.skip(f"needs {file} in ../shared/data/smap")
    raw = path.read_bytes()
    scene = read_smap(raw, name=None, robots=3)
    check_references(scene)
    area = scene.areas[0]
    assert (len(area.points), len(area.paths), len(area.bins)) == (points, paths, bins)
    assert sum(p.backward for p in area.paths) == backward
    written = {p["instanceName"] for p in json.loads(raw)["advancedPointList"]}
    assert {PointName(name) for name in written} == {p.name for p in area.points}
    assert all(spot.tasks for spot in area.bins)
    assert [r.name for r in scene.robots] == ["AMB-01", "AMB-02", "AMB-03"]
