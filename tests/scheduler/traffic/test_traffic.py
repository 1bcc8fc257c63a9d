import math
from itertools import pairwise

import msgspec
import pytest

from ledger.ids import PointName, RobotName
from ledger.link import Drive, Mark, TellRoute
from ledger.scene import Group, Kinematics, Point
from ledger.scene_config import SceneConfig
from scheduler.goal import Goal
from scheduler.traffic.traffic import Traffic
from tests.scheduler.traffic.floor import SCENE, Floor
from tests.scheduler.traffic.maps import area_of, both, lattice, warehouse

GROUPS = (Group(id=0, name="g"),)
R0, R1 = RobotName("R0"), RobotName("R1")


def floor(area, starts, goals=(), **given):
    made = Floor(area, given.pop("groups", GROUPS), starts, list(goals), **given)
    made.idle = set(made.robots)
    return made


def send(made, robot, point, since_ms=0):
    made.goals[RobotName(robot)] = Goal(point=PointName(point), rank=(0, since_ms, robot))


def until(made, robot, point, limit_s=120):
    for _ in range(limit_s * 10):
        made.tick()
        made.judge()
        if made.traffic.stands_at(RobotName(robot), PointName(point)):
            return
    raise AssertionError(f"{robot} never got to {point}: {made.traffic.plans(0)}")


def test_a_robot_drives_to_its_goal_and_stands_there():
    made = floor(lattice(4, 4), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P3-3")
    until(made, "R0", "P3-3")
    assert not made.traffic.stands_at(R0, PointName("P0-0"))
    assert made.traffic.cost_s(R0, PointName("P3-3")) == 0.0


def test_a_robot_that_is_where_it_should_be_has_arrived():
    made = floor(lattice(2, 2), {"R0": ("P0-0", 0.0)})
    made.tick()
    assert made.traffic.stands_at(R0, PointName("P0-0"))


def test_robots_do_not_stop_at_every_point():
    made = floor(lattice(8, 1), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P7-0")
    speeds = []
    while not made.traffic.stands_at(R0, PointName("P7-0")):
        made.tick()
        speeds.append(made.robots[R0].speed)
    assert min(speeds[30:-30]) > 1.0


def test_two_robots_swap_where_one_can_evade():
    made = floor(lattice(4, 2), {"R0": ("P0-0", 0.0), "R1": ("P3-0", math.pi)})
    send(made, "R0", "P3-0", 1)
    send(made, "R1", "P0-0", 2)
    for _ in range(900):
        made.tick()
        made.judge()
    assert made.done == {R0: 1, R1: 1}


def test_an_idle_robot_on_a_goal_is_pushed_away():
    made = floor(lattice(3, 1), {"R0": ("P0-0", 0.0), "R1": ("P1-0", 0.0)})
    send(made, "R0", "P1-0")
    until(made, "R0", "P1-0")


def test_an_idle_robot_in_a_dead_end_is_sent_out_of_it():
    area = warehouse(3, 4, 0, blind=(1,))
    made = floor(area, {"R0": ("S0", 0.0), "R1": ("B1-0", math.pi / 2)})
    send(made, "R0", "B1-3")
    until(made, "R0", "B1-3")


def test_a_busy_robot_neither_moves_nor_is_pushed():
    made = floor(lattice(3, 1), {"R0": ("P0-0", 0.0), "R1": ("P1-0", 0.0)})
    made.tick()
    made.busy[R1] = 10**12
    send(made, "R1", "P1-0")
    send(made, "R0", "P2-0")
    for _ in range(300):
        made.tick()
        made.judge()
    assert made.traffic.stands_at(R1, PointName("P1-0"))
    assert made.traffic.stands_at(R0, PointName("P0-0"))


def test_a_demanded_heading_is_part_of_arriving():
    area = lattice(3, 3)
    points = tuple(
        msgspec.structs.replace(p, heading_rad=math.pi / 2) if p.name == "P2-0" else p
        for p in area.points
    )
    made = floor(msgspec.structs.replace(area, points=points), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P2-0")
    until(made, "R0", "P2-0")
    assert made.robots[R0].heading == pytest.approx(math.pi / 2, abs=0.01)


def test_a_heading_demanded_where_the_robot_already_stands_is_turned_to():
    area = lattice(2, 2)
    points = tuple(msgspec.structs.replace(p, heading_rad=2.0) for p in area.points)
    made = floor(msgspec.structs.replace(area, points=points), {"R0": ("P0-0", 0.0)})
    made.tick()
    assert not made.traffic.stands_at(R0, PointName("P0-0"))
    send(made, "R0", "P0-0")
    until(made, "R0", "P0-0", 10)


def test_groups_of_different_size_share_the_floor():
    big = Group(id=1, name="big", footprint=((0.8, 0.5), (-0.8, 0.5), (-0.8, -0.5), (0.8, -0.5)))
    quick = msgspec.structs.replace(GROUPS[0], kinematics=Kinematics(speed_mps_max=2.0))
    area = lattice(5, 5, 2.5)
    starts = {f"R{k}": (f"P{k}-{k}", 0.0) for k in range(5)}
    made = Floor(
        area,
        (quick, big),
        starts,
        [p.name for p in area.points],
        seed=4,
        group_of={name: k % 2 for k, name in enumerate(starts)},
    )
    made.run(120)
    assert min(made.done.values()) >= 2


# -- nothing is known yet, or not any more


def test_nobody_moves_before_every_robot_has_been_heard():
    traffic = Traffic(SCENE, lattice(3, 3), GROUPS)
    made = floor(lattice(3, 3), {"R0": ("P0-0", 0.0), "R1": ("P2-2", 0.0)})
    for name in (R0, R1):
        traffic.add(name, 0)
    goals = {R0: Goal(point=PointName("P2-0"), rank=(0, 0, "R0"))}
    traffic.observe(made.robots[R0].report(1, 0))
    assert not traffic.ready
    assert traffic.trouble(R1) == "RobotNotHeard"
    assert traffic.step(1, goals, set()) == []
    traffic.lost(R1)
    assert traffic.ready
    assert [type(m) for m in traffic.step(2, goals, set())] == [Drive]


def test_how_far_off_a_point_or_a_path_a_robot_may_be_is_a_setting():
    for x, y, point_m, path_m, trouble in (
        (-0.2, 0.0, 0.3, 0.1, None),  # beside the corner of the map
        (-0.2, 0.0, 0.1, 0.1, "RobotOffMap"),
        (1.0, 0.2, 0.1, 0.1, "RobotOffMap"),
        (1.0, 0.2, 0.1, 0.3, "RobotNotAtStop"),
    ):
        made = floor(lattice(3, 3), {"R0": ("P0-0", 0.0)})
        made.robots[R0].x, made.robots[R0].y = x, y
        traffic = Traffic(SCENE, lattice(3, 3), GROUPS)
        traffic.tune(SceneConfig(point_distance_m=point_m, path_distance_m=path_m))
        traffic.add(R0, 0)
        traffic.observe(made.robots[R0].report(1, 0))
        assert traffic.trouble(R0) == trouble, (x, y, point_m, path_m)


def test_the_interval_of_planning_bounds_the_time_between_two_plannings(monkeypatch):
    traffic = Traffic(SCENE, lattice(3, 3), GROUPS)
    planned = []
    plan = traffic._plan
    monkeypatch.setattr(traffic, "_plan", lambda now_ms: (planned.append(now_ms), plan(now_ms)))
    for interval_ms in (2_000, 300):
        traffic.tune(SceneConfig(traffic_plan_interval_ms=interval_ms))
        planned.clear()
        for now_ms in range(10_000, 20_001, 100):
            traffic.step(now_ms + interval_ms, {}, set())
        gaps = {after - before for before, after in pairwise(planned)}
        assert gaps == {interval_ms}


def test_a_robot_off_the_map_is_an_obstacle_until_it_is_put_on_it():
    made = floor(lattice(3, 3), {"R0": ("P0-0", 0.0), "R1": ("P2-2", 0.0)})
    made.robots[R1].x, made.robots[R1].y = 1.0, 1.0
    made.tick()
    assert made.traffic.trouble(R1) == "RobotOffMap"
    assert made.traffic.ready
    assert not made.traffic.plans(0)[1].ready
    send(made, "R0", "P2-0")
    until(made, "R0", "P2-0")
    made.robots[R1].x, made.robots[R1].y = 4.0, 4.0
    made.tick()
    assert made.traffic.trouble(R1) is None
    assert made.traffic.stands_at(R1, PointName("P2-2"))


def test_a_robot_found_on_the_way_drives_on_to_the_next_free_stop():
    made = floor(lattice(4, 1), {"R0": ("P0-0", 0.0), "R1": ("P2-0", 0.0)})
    made.robots[R0].x = 0.9
    for _ in range(100):
        made.tick()
        made.judge()
    assert made.traffic.stands_at(R0, PointName("P1-0"))


def test_a_robot_found_on_a_point_that_is_no_stop_drives_to_one():
    points = [
        Point(name=PointName(n), x_m=x, y_m=0.0)
        for n, x in (("A", 0.0), ("M", 0.6), ("B", 3.0), ("C", 6.0))
    ]
    area = area_of(points, both("A", "M") + both("M", "B") + both("B", "C"))
    made = floor(area, {"R0": ("M", 0.0)})
    made.tick()
    send(made, "R0", "C")
    until(made, "R0", "C")


def test_a_lost_robot_keeps_its_ground_and_others_go_round_it():
    made = floor(lattice(4, 3), {"R0": ("P0-1", 0.0), "R1": ("P1-1", 0.0)})
    send(made, "R1", "P3-1")
    for _ in range(15):
        made.tick()
    made.traffic.lost(R1)
    gone = made.robots.pop(R1)
    send(made, "R0", "P3-1")
    made.goals.pop(R1)
    for _ in range(600):
        made.now_ms += 100
        gone.step(0.1, made.chance, 0.0)
        robot = made.robots[R0]
        robot.step(0.1, made.chance, 0.0)
        made.traffic.observe(robot.report(made.now_ms, 0))
        for message in made.traffic.step(made.now_ms, made.goals, set()):
            assert message.robot == R0
            robot.tell(message)
        made.robots[R1] = gone
        made.judge()
        del made.robots[R1]
    held = next(plan for plan in made.traffic.plans(0) if plan.robot == R1)
    assert held.spaces and not held.ready


def test_a_robot_that_forgets_its_route_is_placed_where_it_stands():
    made = floor(lattice(4, 1), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P3-0")
    until(made, "R0", "P3-0")
    robot = made.robots[R0]
    robot.session, robot.pieces = "", {}
    robot.progress = robot.authority = Mark()
    robot.x, robot.number = 0.0, 0
    made.now_ms += 5_000
    made.goals.clear()
    made.busy.clear()
    made.tick()
    assert made.traffic.stands_at(R0, PointName("P0-0"))
    send(made, "R0", "P3-0")
    until(made, "R0", "P3-0")


def test_a_restarted_scheduler_asks_for_the_route_and_goes_on_in_its_session():
    made = floor(lattice(6, 1), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P5-0")
    for _ in range(40):
        made.tick()
    session = made.robots[R0].session
    made.restart()
    made.tick()
    assert made.traffic.trouble(R0) == "RobotRouteUnknown"
    until(made, "R0", "P5-0")
    assert made.robots[R0].session == session


def test_the_question_for_the_route_is_repeated_but_not_at_once():
    made = floor(lattice(6, 1), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P5-0")
    for _ in range(40):
        made.tick()
    traffic = made.fresh_traffic()
    traffic.observe(made.robots[R0].report(1, 0))
    asked = [traffic.step(at_ms, {}, set()) for at_ms in (0, 100, 900, 1000)]
    assert [len(messages) for messages in asked] == [1, 0, 0, 1]
    assert isinstance(asked[0][0], TellRoute)


def test_a_route_of_another_map_is_driven_to_its_authority_first():
    made = floor(lattice(6, 1), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P5-0")
    for _ in range(40):
        made.tick()
    points = tuple(
        msgspec.structs.replace(p, turning=False) if p.name == "P5-0" else p
        for p in made.area.points
    )
    made.area = msgspec.structs.replace(made.area, points=points)
    before = made.robots[R0].session
    made.goals.clear()
    made.restart()
    made.tick()
    made.tick()
    assert made.traffic.trouble(R0) == "RobotOnOldRoute"
    send(made, "R0", "P0-0")
    until(made, "R0", "P0-0")
    assert made.robots[R0].session != before


def test_a_message_that_was_lost_is_sent_again():
    made = floor(lattice(3, 1), {"R0": ("P0-0", 0.0)})
    made.tick()
    goals = {R0: Goal(point=PointName("P2-0"), rank=(0, 0, "R0"))}
    (lost,) = made.traffic.step(made.now_ms, goals, set())
    again = []
    for _ in range(20):
        made.now_ms += 100
        made.traffic.observe(made.robots[R0].report(made.now_ms, 0))
        again += made.traffic.step(made.now_ms, goals, set())
    told = {piece for message in again for piece in message.pieces}
    assert told.issuperset(lost.pieces)
    assert len(again) <= 4


def test_a_removed_robot_leaves_its_ground_free():
    made = floor(lattice(3, 1), {"R0": ("P0-0", 0.0), "R1": ("P1-0", 0.0)})
    made.tick()
    made.traffic.remove(R1)
    del made.robots[R1]
    send(made, "R0", "P2-0")
    until(made, "R0", "P2-0")


def test_what_cannot_be_reached_costs_infinitely_much():
    made = floor(lattice(2, 2), {"R0": ("P0-0", 0.0)})
    made.tick()
    assert made.traffic.cost_s(R0, PointName("nowhere")) == math.inf
    assert made.traffic.cost_s(RobotName("nobody"), PointName("P0-0")) == math.inf


def test_a_plan_shows_ground_target_and_who_is_waited_for():
    made = floor(lattice(6, 1), {"R0": ("P0-0", 0.0), "R1": ("P1-0", 0.0)})
    send(made, "R0", "P5-0", 1)
    made.tick()
    made.tick()
    first, second = made.traffic.plans(made.now_ms)
    assert first.target == "P5-0" and first.ready and first.spaces
    assert first.blocked_by == (R1,)
    assert first.untravelled[0] == "P0-0->P1-0"
    assert second.moving and second.target is None
