"""Robots found one behind the other in mid-lane drive off one after the other."""

from itertools import pairwise

import pytest

from ledger.ids import PointName, RobotName
from ledger.link import Mark
from ledger.scene import Group, Path, Point
from scheduler.goal import Goal
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import area_of

GROUP = Group(id=0, name="g")
FRONT, REAR = RobotName("A"), RobotName("B")
GAP_M = 1.4


def lane():
    names = [PointName(f"P{k}") for k in range(5)]
    points = [Point(name=name, x_m=3.0 * k, y_m=0.0) for k, name in enumerate(names)]
    return area_of(points, [Path(start=a, end=b) for p in pairwise(names) for a, b in (p, p[::-1])])


@pytest.mark.parametrize("off_m", [-1e-9, 0.0, 1e-9, 0.0004])
def test_who_stands_at_the_end_of_a_cell_does_not_wait_for_who_is_behind(off_m):
    floor = Floor(lane(), (GROUP,), {"A": ("P1", 0.0), "B": ("P0", 0.0)}, [])
    roadmap = floor.traffic.roadmap
    path = next(
        k for k, p in enumerate(roadmap.net.paths) if (p.start, p.end) == (PointName("P1"), "P2")
    )
    ends = [end for _, end in roadmap.path_cells(0, path)]
    front, rear = floor.robots[FRONT], floor.robots[REAR]
    front.x = 3.0 + ends[1] - off_m
    rear.x = front.x - GAP_M
    floor.idle = {FRONT, REAR}
    for name, goal in ((FRONT, "P4"), (REAR, "P3")):
        floor.goals[name] = Goal(point=PointName(goal), rank=(0, 0, name))
    floor.run(40.0)
    assert floor.done == {FRONT: 1, REAR: 1}


def test_who_was_stopped_just_before_the_end_has_driven_and_not_arrived():
    floor = Floor(lane(), (GROUP,), {"A": ("P1", 0.0)}, [])
    floor.goals[FRONT], floor.idle = Goal(point=PointName("P2"), rank=(0, 0, FRONT)), {FRONT}
    floor.run(20.0)
    track = floor.traffic._tracks[FRONT]
    assert track.arrived
    track.progress = Mark(piece=track.end.piece, along_m=track.end.along_m - 0.015)
    assert track.driven
    assert not track.arrived
    assert not floor.traffic.stands_at(FRONT, PointName("P2"))
