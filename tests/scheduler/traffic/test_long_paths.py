"""Paths longer than a robot needs to stop: driven in parts, with robots on the way within them."""

import math

from ledger.ids import PointName
from ledger.scene import Point
from tests.scheduler.traffic.maps import area_of, both
from tests.scheduler.traffic.test_traffic import R0, R1, floor, send, until


def long_lane():
    """A loop at either end of 20 m."""
    at = {"A": (0, 0), "B": (20, 0), "C": (-3, 2), "D": (-3, -2), "E": (23, 2), "F": (23, -2)}
    points = [Point(name=PointName(n), x_m=x, y_m=y) for n, (x, y) in at.items()]
    ways = ("AB", "AC", "AD", "CD", "BE", "BF", "EF")
    return area_of(points, [path for a, b in ways for path in both(a, b)])


def test_robots_follow_each_other_along_one_path():
    made = floor(long_lane(), {"R0": ("A", 0.0), "R1": ("C", 0.0)})
    send(made, "R0", "E", 1)
    send(made, "R1", "F", 2)
    between = 0
    for _ in range(900):
        made.tick()
        made.judge()
        between = max(between, sum(1 < robot.x < 19 for robot in made.robots.values()))
    assert made.done == {R0: 1, R1: 1}
    assert between == 2


def test_a_robot_is_pushed_back_from_within_a_path():
    made = floor(long_lane(), {"R0": ("A", 0.0), "R1": ("B", math.pi)})
    send(made, "R1", "C", 9)
    for _ in range(50):
        made.tick()
    assert made.robots[R1].x < 19
    send(made, "R0", "E", 1)
    until(made, "R0", "E")
    until(made, "R1", "C")


def test_a_restarted_scheduler_takes_over_routes_that_end_within_a_path():
    made = floor(long_lane(), {"R0": ("A", 0.0)})
    send(made, "R0", "E")
    inside = False
    for _ in range(8):
        for _ in range(20):
            made.tick()
            made.judge()
        robot = made.robots[R0]
        last = max(robot.pieces)
        inside = inside or (robot.pieces[last].inside and robot.progress.piece <= last)
        session = robot.session
        made.restart()
        for _ in range(3):
            made.tick()
        assert made.traffic.trouble(R0) is None
        assert made.robots[R0].session == session
    assert inside
    until(made, "R0", "E")


def test_a_path_that_is_driven_in_parts_is_shown_once():
    made = floor(long_lane(), {"R0": ("A", 0.0)})
    send(made, "R0", "E")
    for _ in range(60):
        made.tick()
        (plan,) = made.traffic.plans(made.now_ms)
        assert len(set(plan.untravelled)) == len(plan.untravelled)
        assert set(plan.untravelled) <= {"A->B", "B->E"}
