"""Scene files go in and out unchanged, and a bad one is refused by the name of what is wrong."""

from typing import Any

import msgspec
import pytest

from commands.imports.scene_json import digest, read_any, read_scene, write_scene
from ledger.errors import Refused
from ledger.ids import BinName, PointName, RobotName
from ledger.scene import (
    Area,
    Bin,
    BinTask,
    Group,
    Kinematics,
    Path,
    Point,
    RobotConfig,
    SceneFile,
)

A, B = PointName("A"), PointName("B")
AREA = Area(
    id=0,
    name="Floor",
    map_name="floor",
    map_digest="d",
    points=(Point(name=A, x_m=0.0, y_m=0.0), Point(name=B, x_m=2.0, y_m=0.0)),
    paths=(Path(start=A, end=B), Path(start=B, end=A)),
    bins=(Bin(name=BinName("S-1"), point=B, tasks=(BinTask(name="Load", operation="JackLoad"),)),),
)
SCENE = SceneFile(
    name="Hall", areas=(AREA,), robots=(RobotConfig(name=RobotName("AMB-01"), simulated=True),)
)
change = msgspec.structs.replace


def with_area(**fields: Any) -> SceneFile:
    return change(SCENE, areas=(change(AREA, **fields),))


def test_a_scene_file_reads_back_as_it_was_written() -> None:
    assert read_scene(write_scene(SCENE)) == SCENE
    assert digest(read_scene(write_scene(SCENE))) == digest(SCENE)


def test_another_content_has_another_digest() -> None:
    assert digest(change(SCENE, name="Hall 2")) != digest(SCENE)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (change(SCENE, name=" "), "name"),
        (change(SCENE, areas=()), "areas"),
        (change(SCENE, areas=(AREA, change(AREA, id=1))), "areas: name 'Floor' is there twice"),
        (
            change(SCENE, areas=(AREA, change(AREA, id=1, name="Upstairs"))),
            "areas[].points: name 'A' is there",
        ),
        (with_area(points=()), "areas[0].points"),
        (with_area(points=(*AREA.points, AREA.points[0])), "name 'A' is there twice"),
        (with_area(points=(Point(name=A, x_m=1e9, y_m=0.0),)), "areas[0].points[0]"),
        (
            with_area(paths=(Path(start=A, end=PointName("C")),)),
            "areas[0].paths[0].end: no point is named 'C' (A->C)",
        ),
        (with_area(paths=(Path(start=A, end=A),)), "A->A ends where it starts"),
        (with_area(paths=(AREA.paths[0], AREA.paths[0])), "A->B is there twice"),
        (with_area(paths=(Path(start=A, end=B, speed_mps_max=0.0),)), "speed_mps_max"),
        (with_area(bins=(Bin(name=BinName("X"), point=PointName("C")),)), "areas[0].bins[0].point"),
        (
            with_area(
                bins=(
                    Bin(
                        name=BinName("X"),
                        point=A,
                        tasks=(BinTask(name="T", operation="O", arguments="[]"),),
                    ),
                )
            ),
            "areas[0].bins[0].tasks[0].arguments",
        ),
        (change(SCENE, robots=(*SCENE.robots, *SCENE.robots)), "'AMB-01' is there twice"),
        (change(SCENE, robots=(change(SCENE.robots[0], group=7),)), "robots[0].group"),
        (change(SCENE, robots=(change(SCENE.robots[0], name=RobotName("a/b")),)), "robots[0].name"),
        (change(SCENE, groups=(Group(id=0, name="g", footprint=()),)), "groups[0].footprint"),
        (
            change(SCENE, groups=(Group(id=0, name="g", footprint_loaded=((0.0, 1.0),)),)),
            "groups[0].footprint_loaded",
        ),
        (
            change(
                SCENE, groups=(Group(id=0, name="g", kinematics=Kinematics(turn_radps_max=0.0)),)
            ),
            "groups[0].kinematics.turn_radps_max",
        ),
    ],
)
def test_what_is_wrong_is_named(scene: SceneFile, words: str) -> None:
    with pytest.raises(Refused) as refused:
        read_scene(write_scene(scene))
    assert refused.value.code == "BadSceneFile"
    assert words in refused.value.message


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (b"no", "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b"[]", "Expected `object`"),
        (b'{"name": "x", "areas": [{"id": "0"}]}', "$.areas[0].id"),
        (b"{" * 100_000, "not JSON"),
        (b'{"name":' * 100_000, ""),
    ],
)
def test_what_is_no_scene_file_is_refused(raw: bytes, words: str) -> None:
    with pytest.raises(Refused) as refused:
        read_scene(raw)
    assert words in refused.value.message


def test_name_robots_and_groups_can_be_given() -> None:
    groups = (Group(id=4, name="fork"),)
    scene = read_any("x.JSON", write_scene(SCENE), name="Mine", robots=2, groups=groups)
    assert scene.name == "Mine"
    assert [(r.name, r.group, r.simulated) for r in scene.robots] == [
        ("AMB-01", 4, True),
        ("AMB-02", 4, True),
    ]


def test_an_unknown_suffix_is_refused() -> None:
    with pytest.raises(Refused, match=r"\.dwg"):
        read_any("hall.dwg", b"")


def test_a_file_holds_no_secret() -> None:
    raw = write_scene(SCENE).replace(b'"robots":[', b'"robots":[{"name":"G","gateway_secret":"s"},')
    with pytest.raises(Refused, match=r"robots\[0\]\.gateway_secret") as refused:
        read_scene(raw)
    assert refused.value.code == "BadSceneFile"
    read_scene(raw.replace(b'"s"', b"null"))
