"""Settings of TP1 that have to do with deadlocks: what each of them changes on a floor."""

import math

import msgspec
import pytest

from ledger.ids import PointName, RobotName
from ledger.scene import Group
from ledger.scene_config import SceneConfig
from scheduler.goal import Goal
from scheduler.traffic.pibt import propose
from scheduler.traffic.world import may_be_pushed
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.stuck import RING, drawn, roads, world_on
from tests.scheduler.traffic.test_safe import GOALS, STANDS, TRAP

GROUPS = (Group(id=0, name="g"),)


def floor(area, at, goals, config, heading=0.0):
    made = Floor(area, GROUPS, {name: (p, heading) for name, p in at.items()}, [], service_s=1.0)
    made.idle = set(made.robots)
    made.traffic.tune(config)
    for k, (name, point) in enumerate(goals.items()):
        made.goals[RobotName(name)] = Goal(point=PointName(point), rank=(0, k, name))
    return made


def test_with_prevention_a_loop_keeps_turning_and_without_it_it_fills_up():
    done = {}
    first = {"G": "c", **{name: goal for name, goal in GOALS.items() if name != "G"}}
    for prevent in (True, False):
        made = floor(TRAP, STANDS, first, SceneConfig(deadlock_prevention=prevent))
        for _ in range(1_500):
            made.tick()
        made.judge()
        done[prevent] = sum(made.done.values())
    assert done[True] >= 4
    assert done[False] == 0


def pushing(push_m_min, push_m_max):
    """Somebody on the other's goal, on a ring with stops each 2 m."""
    world = world_on(roads(RING), {"A": "a", "B": "b"}, {"A": "b"})
    world.push_m_min, world.push_m_max = push_m_min, push_m_max
    return world


def test_nobody_is_pushed_further_than_the_largest_distance():
    assert {name for name, _ in propose(pushing(0.0, 2.5))} == {"A", "B"}
    assert "B" not in {name for name, _ in propose(pushing(0.0, 1.0))}


def test_who_is_pushed_drives_at_least_the_smallest_distance():
    world = pushing(3.0, 50.0)
    pushed = dict(propose(world))["B"]
    assert len(pushed) == 2
    assert may_be_pushed(world, pushed)
    assert not may_be_pushed(world, pushed[:1])


def blind_lane():
    """A lane that ends at d, where no robot can turn; the robot there has driven in."""
    area = drawn({"a": (0, 0), "b": (2, 0), "c": (4, 0), "d": (6, 0), "s": (2, 2)}, "ab bc cd bs")
    points = tuple(
        msgspec.structs.replace(p, turning=p.name not in ("c", "d")) for p in area.points
    )
    return msgspec.structs.replace(area, points=points)


def test_in_reverse_a_robot_gets_out_of_where_it_cannot_turn():
    there = {}
    for reverse in (True, False):
        config = SceneConfig(reverse_out_of_deadlock=reverse)
        made = floor(blind_lane(), {"A": "d"}, {"A": "a"}, config)
        for _ in range(600):
            made.tick()
            made.judge()
        there[reverse] = sum(made.done.values())
    assert there == {True: 1, False: 0}


def test_reversing_can_be_switched_off_again():
    made = floor(blind_lane(), {"A": "d"}, {}, SceneConfig())
    made.tick()
    robot, point = RobotName("A"), PointName("a")
    assert made.traffic.cost_s(robot, point) == math.inf
    made.traffic.tune(SceneConfig(reverse_out_of_deadlock=True))
    assert made.traffic.cost_s(robot, point) < math.inf
    made.traffic.tune(SceneConfig())
    assert made.traffic.cost_s(robot, point) == math.inf


@pytest.mark.parametrize(("ahead", "heading_rad"), [(True, math.pi / 2), (False, 0.0)])
def test_who_turns_ahead_faces_the_way_on_while_it_waits(ahead, heading_rad):
    """A works round the corner, where B is to go on."""
    corner = drawn({"a": (0, 0), "b": (2, 0), "c": (2, 2), "d": (2, 4)}, "ab bc cd")
    config = SceneConfig(turn_ahead=ahead)
    made = floor(corner, {"A": "c", "B": "a"}, {"A": "c", "B": "d"}, config)
    made.busy[RobotName("A")] = made.now_ms + 60_000
    for _ in range(200):
        made.tick()
        made.judge()
    waiting = made.robots[RobotName("B")]
    assert (waiting.x, waiting.y) == pytest.approx((2.0, 0.0), abs=0.01)
    assert waiting.heading == pytest.approx(heading_rad, abs=0.01)
