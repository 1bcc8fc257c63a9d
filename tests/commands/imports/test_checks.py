"""Doors, lifts and areas in scene files: whole again when read, refused by what is wrong."""

from typing import Any

import msgspec
import pytest

from commands.imports.scene_json import digest, read_scene, write_scene
from ledger.errors import Refused
from ledger.ids import PointName, path_key
from ledger.scene import Area, Door, Lift, LiftFloor, Path, Point, SceneFile

change = msgspec.structs.replace


def floor(id_: int) -> Area:
    a, b = PointName(f"A{id_}"), PointName(f"B{id_}")
    return Area(
        id=id_,
        name=f"Floor {id_}",
        map_name=f"floor-{id_}",
        map_digest="d",
        points=(Point(name=a, x_m=0.0, y_m=0.0), Point(name=b, x_m=2.0, y_m=0.0)),
        paths=(Path(start=a, end=b), Path(start=b, end=a)),
    )


KEYS = (path_key(PointName("A1"), PointName("B1")), path_key(PointName("B1"), PointName("A1")))
DOOR = Door(id=1, name="Gate", area=1, paths=KEYS, simulated=True)
LIFT = Lift(
    id=1,
    name="Lift",
    floors=(LiftFloor(name="G", area=1, point=PointName("B1")), LiftFloor(name="1", area=2)),
)
SCENE = SceneFile(name="House", areas=(floor(1), floor(2)), doors=(DOOR,), lifts=(LIFT,))


def test_doors_and_lifts_read_back_as_they_were_written() -> None:
    assert read_scene(write_scene(SCENE)) == SCENE
    assert digest(SCENE) != digest(change(SCENE, doors=()))
    assert digest(SCENE) != digest(change(SCENE, lifts=()))


def door(**fields: Any) -> SceneFile:
    return change(SCENE, doors=(change(DOOR, **fields),))


def lift(**fields: Any) -> SceneFile:
    return change(SCENE, lifts=(change(LIFT, **fields),))


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (door(area=7), "doors[0].area: no area has the id 7"),
        (door(paths=()), "doors[0]: Gate has neither paths nor points"),
        (door(points=(PointName("A1"),)), "doors[0]: Gate has both paths and points"),
        (door(paths=("A2->B2",)), "doors[0].paths: area Floor 1 has no path 'A2->B2'"),
        (door(paths=(KEYS[0], KEYS[0])), "is there twice"),
        (
            door(paths=(), points=(PointName("A2"),)),
            "doors[0].points: area Floor 1 has no point 'A2'",
        ),
        (door(open_ahead_m=-1.0), "doors[0].open_ahead_m"),
        (door(width_m=0.0), "doors[0].width_m"),
        (door(x_m=1e9), "doors[0]"),
        (door(id=-1), "doors[0].id"),
        (change(SCENE, doors=(DOOR, change(DOOR, name="Other"))), "doors: id 1 is there twice"),
        (change(SCENE, doors=(DOOR, change(DOOR, id=2))), "doors: name 'Gate' is there twice"),
        (lift(floors=()), "lifts[0].floors: Lift has no floor"),
        (lift(floors=(LiftFloor(name="G", area=9),)), "no area has the id 9"),
        (
            lift(floors=(LiftFloor(name="G", area=1, point=PointName("A2")),)),
            "area 1 has no point 'A2'",
        ),
        (lift(floors=(LiftFloor(name="G", area=1), LiftFloor(name="G", area=2))), "name 'G'"),
        (lift(floors=(LiftFloor(name="G", area=1), LiftFloor(name="H", area=1))), "area 1 is"),
        (lift(door_s=0.0), "lifts[0].door_s"),
        (change(SCENE, lifts=(LIFT, change(LIFT, name="Other"))), "lifts: id 1 is there twice"),
        (change(SCENE, areas=(floor(1), change(floor(2), name="Floor 1"))), "areas: name"),
        (change(SCENE, areas=(floor(1), change(floor(2), id=1))), "areas: id 1 is there twice"),
    ],
)
def test_a_device_that_means_nothing_is_refused(scene: SceneFile, words: str) -> None:
    with pytest.raises(Refused) as no:
        read_scene(write_scene(scene))
    assert words in no.value.message
