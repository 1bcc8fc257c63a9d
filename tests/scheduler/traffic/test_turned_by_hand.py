"""People turn a robot on the stop where it rests."""

import math

import pytest

from ledger.ids import PointName, RobotName
from ledger.scene import Group
from scheduler.goal import Goal
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice

R0 = RobotName("R0")


def drive(floor, point):
    """With the judge looking on: a body that sticks out of its own ground is seen."""
    floor.goals[R0] = Goal(point=PointName(point), rank=(0, 0, R0))
    for _ in range(300):
        floor.tick()
        floor.judge()
        if R0 not in floor.goals:
            return
    raise AssertionError(floor.traffic.plans(floor.now_ms))


@pytest.mark.parametrize("driven", [(), ("P1-0",), ("P1-0", "P0-0")])
@pytest.mark.parametrize("heading", [math.pi / 2, -math.pi / 2, math.pi, 0.3, 0.0])
def test_it_turns_back_on_its_own_ground_before_it_drives(driven, heading):
    """Found by faults with a restart a minute: its next route began without a turn."""
    floor = Floor(lattice(3, 2), (Group(id=0, name="g"),), {"R0": ("P0-0", 0.0)}, [])
    floor.idle = {R0}
    floor.run(1.0)
    for point in driven:
        drive(floor, point)
    floor.robots[R0].heading = heading
    floor.run(1.0)
    drive(floor, "P2-0")
