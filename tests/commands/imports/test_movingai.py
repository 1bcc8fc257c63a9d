"""Grid maps of the MovingAI collection."""

from pathlib import Path

import pytest

from commands.imports.movingai import read_movingai
from ledger.errors import Refused
from ledger.scene import PointKind

SMALL = b"""type octile
height 3
width 4
map
..E.
.@..
...@
"""
MAPS = Path(__file__).parents[3] / "../shared/data/movingai"


def test_cells_become_points_and_neighbours_are_joined() -> None:
    area = read_movingai(SMALL, name="g", robots=0, pitch_m=2.0).areas[0]
    points = {p.name: p for p in area.points}
    assert len(points) == 10
    assert (points["C0-2"].x_m, points["C0-2"].y_m) == (4.0, 4.0)
    assert points["C0-2"].kind is PointKind.ACTION
    keys = {p.key for p in area.paths}
    assert {"C0-0->C0-1", "C0-1->C0-0", "C1-2->C2-2"} <= keys
    assert not any("C1-1" in key or "C2-3" in key for key in keys)
    assert len(keys) == 22


def test_parking_is_where_others_can_pass() -> None:
    area = read_movingai(SMALL, name="g", robots=2).areas[0]
    parked = [p.name for p in area.points if p.kind is PointKind.PARKING]
    assert parked == ["C1-2"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"height 3\n", b"", "height"),
        (b"width 4", b"width x", "width"),
        (b"map\n", b"", "line 4"),
        (b"..E.", b"..E", "line 5: 3 cells"),
        (b"height 3", b"height 9", "3 rows"),
        (b"height 3", b"height 999999999", "cells"),
        (b".@..", b".\xff..", "ASCII"),
    ],
)
def test_what_is_wrong_is_named(old: bytes, new: bytes, words: str) -> None:
    with pytest.raises(Refused) as refused:
        read_movingai(SMALL.replace(old, new), name=None, robots=0)
    assert words in refused.value.message


@pytest.mark.parametrize(
    ("file", "points"),
    [("random-64-64-10.map", 3687), ("warehouse_long_corridor_large.map", 38643)],
)
def test_the_real_maps_import(file: str, points: int) -> None:
    path = MAPS / file
    if not path.exists():
        pytest.skip(f"needs {file} in ../shared/data/movingai")
    scene = read_movingai(path.read_bytes(), name=None, robots=20)
    kinds = [p.kind for p in scene.areas[0].points]
    assert len(kinds) == points
    assert kinds.count(PointKind.PARKING) == 22
