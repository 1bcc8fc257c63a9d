"""Of robots that stand between stops and find no way to one, a person is told."""

from ledger.ids import RobotName
from scheduler.traffic.ladder import WORKING_MS
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.test_single_file import GROUP, lane

A, B = RobotName("A"), RobotName("B")


def test_two_face_to_face_in_mid_lane_are_told_of_until_one_is_taken_away():
    floor = Floor(lane(), (GROUP,), {"A": ("P1", 0.0), "B": ("P2", 3.14159)}, [])
    floor.robots[A].x, floor.robots[B].x = 4.0, 5.4
    floor.idle = {A, B}
    floor.run(WORKING_MS / 1000 - 5)
    assert floor.traffic.stuck(floor.now_ms) == {}
    floor.run(10)
    told = floor.traffic.stuck(floor.now_ms)
    assert len(told) == 1, "the other has a way, and waits for it"
    ((name, stuck),) = told.items()
    (other,) = {A, B} - {name}
    assert stuck.robots == (other,)
    assert other in stuck.text
    (alarmed,) = [plan for plan in floor.traffic.plans(floor.now_ms) if plan.stuck]
    assert (alarmed.robot, alarmed.stuck.message) == (name, stuck.text)
    floor.robots[name].x = 12.0  # somebody carries it to the end of the lane
    floor.run(20)
    assert floor.traffic.stuck(floor.now_ms) == {}
    assert {floor.traffic.trouble(A), floor.traffic.trouble(B)} == {None}


def test_one_that_no_way_begins_at_is_told_of():
    floor = Floor(lane(), (GROUP,), {"A": ("P1", 0.0)}, [])
    floor.robots[A].y = 5.0
    floor.idle = {A}
    floor.run(WORKING_MS / 1000 + 5)
    assert "no way to a stop" in floor.traffic.stuck(floor.now_ms)[A].text
    floor.robots[A].y = 0.0
    floor.run(3)
    assert floor.traffic.stuck(floor.now_ms) == {}
