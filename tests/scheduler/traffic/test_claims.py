import math

import pytest
import shapely

from ledger.ids import PointName
from ledger.link import Mark
from tests.scheduler.traffic.maps import lattice, warehouse
from tests.scheduler.traffic.test_traffic import R0, R1, floor, send, until

WMS = "external:WMS"


def square(made, point, half_m=0.05):
    at = made.points[PointName(point)]
    ring = shapely.get_coordinates(
        shapely.box(at.x_m - half_m, at.y_m - half_m, at.x_m + half_m, at.y_m + half_m)
    )
    return tuple((x, y) for x, y in ring[:-1].tolist())


def run(made, seconds, grounds=()):
    """Let time pass; nobody may be on these grounds."""
    for _ in range(round(seconds * 10)):
        made.tick()
        made.judge()
        for name, body in made.bodies().items():
            for ring in grounds:
                assert body.disjoint(shapely.Polygon(ring)), name


def plan(made, robot):
    return next(p for p in made.traffic.plans(made.now_ms) if p.robot == robot)


def test_free_ground_is_had_at_the_next_step():
    made = floor(lattice(3, 1), {"R0": ("P0-0", 0.0)})
    made.tick()
    made.traffic.claim("u", "WMS", [square(made, "P2-0")])
    assert not made.traffic.claimed("u")
    made.tick()
    assert made.traffic.claimed("u")
    assert not made.traffic.claimed("v")


def test_nobody_has_ground_before_all_robots_have_spoken():
    made = floor(lattice(3, 1), {"R0": ("P0-0", 0.0), "R1": ("P2-0", 0.0)})
    made.traffic.claim("u", "WMS", [square(made, "P1-0")])
    report = made.robots[R0].report(made.now_ms, 0)
    made.traffic.observe(report)
    made.traffic.step(made.now_ms, {}, set())
    assert not made.traffic.claimed("u")
    made.tick()
    assert made.traffic.claimed("u")


def test_robots_go_round_reserved_ground():
    made = floor(lattice(3, 2), {"R0": ("P0-0", 0.0)})
    made.tick()
    direct_s = made.traffic.cost_s(R0, PointName("P2-0"))
    made.traffic.claim("u", "WMS", [square(made, "P1-0")])
    send(made, "R0", "P2-0")
    round_s = made.traffic.cost_s(R0, PointName("P2-0"))
    assert direct_s < round_s < math.inf
    assert made.traffic.reserved(R0, PointName("P2-0")) == ()
    run(made, 40, [square(made, "P1-0")])
    assert made.traffic.stands_at(R0, PointName("P2-0"))
    made.traffic.unclaim("u")
    made.tick()
    assert made.traffic.cost_s(R0, PointName("P0-0")) == pytest.approx(direct_s, abs=5)


def test_where_there_is_no_other_way_a_robot_waits_where_it_is_and_says_for_whom():
    made = floor(lattice(6, 1), {"R0": ("P0-0", 0.0)})
    made.tick()
    made.traffic.claim("u", "WMS", [square(made, "P3-0")])
    send(made, "R0", "P5-0")
    run(made, 20, [square(made, "P3-0")])
    assert plan(made, "R0").blocked_by == (WMS,)
    assert not plan(made, "R0").moving
    assert made.traffic.cost_s(R0, PointName("P5-0")) == math.inf
    assert made.traffic.reserved(R0, PointName("P5-0")) == ("WMS",)
    assert made.traffic.reserved(R0, PointName("P1-0")) == ()
    made.traffic.unclaim("u")
    until(made, "R0", "P5-0")
    assert plan(made, "R0").blocked_by == ()


def test_the_claim_in_the_way_is_named_and_not_another():
    made = floor(lattice(6, 2), {"R0": ("P0-0", 0.0)})
    made.tick()
    made.traffic.claim("u", "aside", [square(made, "P1-1")])
    made.traffic.claim("v", "there", [square(made, "P4-0")])
    assert made.traffic.reserved(R0, PointName("P4-0")) == ("there",)


def test_a_robot_that_waits_for_reserved_ground_makes_way_for_others():
    made = floor(lattice(6, 1), {"R0": ("P1-0", 0.0), "R1": ("P0-0", 0.0)})
    made.tick()
    made.traffic.claim("u", "WMS", [square(made, "P4-0")])
    send(made, "R0", "P5-0", 1)
    send(made, "R1", "P1-0", 2)
    until(made, "R1", "P1-0")
    assert not made.traffic.stands_at(R0, PointName("P1-0"))


def test_the_robot_that_is_named_as_owner_may_go_there():
    made = floor(lattice(6, 1), {"R0": ("P0-0", 0.0), "R1": ("P5-0", 0.0)})
    made.tick()
    made.traffic.claim("u", "R0", [square(made, "P2-0"), square(made, "P3-0")])
    send(made, "R0", "P3-0")
    until(made, "R0", "P3-0")
    assert made.traffic.claimed("u")
    assert made.traffic.reserved(R1, PointName("P2-0")) == ("R0",)
    run(made, 10)  # its work there is done
    send(made, "R0", "P1-0")
    until(made, "R0", "P1-0")


def test_its_own_ground_is_not_asked_for_by_driving_off_it():
    made = floor(lattice(4, 1), {"R0": ("P1-0", 0.0)})
    made.tick()
    made.traffic.claim("u", "R0", [square(made, "P1-0")])
    run(made, 5)
    assert made.traffic.claimed("u")
    assert made.traffic.stands_at(R0, PointName("P1-0"))


def test_an_idle_robot_leaves_ground_that_is_asked_for():
    made = floor(lattice(4, 2), {"R0": ("P1-0", 0.0), "R1": ("P2-0", 0.0)})
    made.tick()
    ground = shapely.box(1.5, -0.5, 4.5, 0.5)
    ring = tuple((x, y) for x, y in shapely.get_coordinates(ground)[:-1].tolist())
    made.traffic.claim("u", "WMS", [ring])
    run(made, 30)
    assert made.traffic.claimed("u")
    assert all(body.disjoint(ground) for body in made.bodies().values())


def test_a_robot_at_work_stays_and_the_ground_is_had_when_it_is_done():
    made = floor(lattice(4, 1), {"R0": ("P1-0", 0.0)})
    send(made, "R0", "P1-0")
    made.busy[R0] = made.now_ms + 20_000
    made.tick()
    made.traffic.claim("u", "WMS", [square(made, "P1-0")])
    run(made, 15)
    assert made.traffic.stands_at(R0, PointName("P1-0"))
    assert not made.traffic.claimed("u")
    run(made, 20)
    assert made.traffic.claimed("u")


def test_a_robot_that_answers_no_more_keeps_the_ground_from_being_had():
    made = floor(lattice(4, 1), {"R0": ("P1-0", 0.0)})
    made.tick()
    made.traffic.lost(R0)
    made.traffic.claim("u", "WMS", [square(made, "P1-0")])
    for _ in range(50):
        made.traffic.step(made.now_ms, {}, set())
        made.now_ms += 100
    assert not made.traffic.claimed("u")


def test_who_is_on_its_way_through_goes_through_first():
    made = floor(lattice(8, 1), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P7-0")
    while made.robots[R0].x < 3.0:
        made.tick()
    made.traffic.claim("u", "WMS", [square(made, "P2-0"), square(made, "P3-0")])
    had_at_m = None
    for _ in range(300):
        made.tick()
        made.judge()
        if had_at_m is None and made.traffic.claimed("u"):
            had_at_m = made.robots[R0].x
    assert had_at_m is not None
    assert had_at_m > 6.4
    assert made.robots[R0].x == pytest.approx(14.0)


def test_nobody_stops_on_the_way_for_reserved_ground():
    """What is committed is driven to its end: a robot waits on a stop, with nothing promised."""
    made = floor(lattice(8, 1), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P7-0")
    while made.robots[R0].x < 1.0:
        made.tick()
    made.traffic.claim("u", "WMS", [square(made, "P5-0")])
    run(made, 30, [square(made, "P5-0")])
    track = made.traffic._tracks[R0]
    assert not track.promised
    assert not plan(made, "R0").moving
    assert made.robots[R0].progress == track.end != Mark()


def test_nobody_turns_into_reserved_ground():
    made = floor(lattice(3, 3), {"R0": ("P1-1", 0.0)})
    made.tick()
    # its corner swings through here, and nothing that drives straight does
    ring = ((2.42, 2.42), (2.44, 2.42), (2.44, 2.44), (2.42, 2.44))
    made.traffic.claim("u", "WMS", [ring])
    run(made, 1)
    assert made.traffic.claimed("u")
    send(made, "R0", "P1-2")
    run(made, 60, [ring])
    assert made.traffic.stands_at(R0, PointName("P1-2"))


def test_a_dead_end_that_a_claim_makes_is_treated_as_one():
    area = warehouse(3, 6, 0)
    made = floor(area, {"R0": ("B1-0", math.pi / 2), "R1": ("S0", 0.0)})
    made.tick()
    made.traffic.claim("u", "WMS", [square(made, "B1-4")])
    send(made, "R1", "B1-2")  # R0 is idle between it and its goal, and has no way out behind
    until(made, "R1", "B1-2", limit_s=240)


def test_what_was_granted_before_a_restart_is_kept_from_the_first_moment():
    made = floor(lattice(6, 1), {"R0": ("P0-0", 0.0)})
    made.tick()
    made.traffic.claim("u", "WMS", [square(made, "P3-0")])
    send(made, "R0", "P5-0")
    run(made, 3)
    made.restart()
    made.traffic.claim("u", "WMS", [square(made, "P3-0")], owned=True)
    assert made.traffic.claimed("u")
    run(made, 30, [square(made, "P3-0")])
    assert plan(made, "R0").blocked_by == (WMS,)


def test_a_route_from_before_a_restart_is_driven_through_asked_for_ground():
    made = floor(lattice(8, 1), {"R0": ("P0-0", 0.0)})
    send(made, "R0", "P7-0")
    while made.robots[R0].x < 3.0:
        made.tick()
    made.restart()
    made.traffic.claim("u", "WMS", [square(made, "P2-0")])
    until(made, "R0", "P7-0")
    assert made.traffic.claimed("u")


def test_a_robot_found_between_stops_enters_by_a_way_off_reserved_ground():
    made = floor(lattice(4, 2), {"R0": ("P1-0", 0.0)})
    made.robots[R0].x = 2.6
    ring = square(made, "P2-0", 0.3)
    made.traffic.claim("u", "WMS", [ring], owned=True)
    run(made, 20, [ring])


def test_a_robot_found_on_ground_that_is_asked_for_leaves_it():
    made = floor(lattice(4, 2), {"R0": ("P1-0", 0.0)})
    made.robots[R0].x = 3.0
    ground = shapely.box(2.5, -0.2, 3.5, 0.2)
    ring = tuple((x, y) for x, y in shapely.get_coordinates(ground)[:-1].tolist())
    made.traffic.claim("u", "WMS", [ring])
    run(made, 40)
    assert made.traffic.claimed("u")


def test_claims_that_touch_do_not_hinder_each_other():
    made = floor(lattice(4, 1), {"R0": ("P0-0", 0.0)})
    made.traffic.claim("u", "WMS", [((3, -1), (5, -1), (5, 1), (3, 1))])
    made.traffic.claim("v", "MES", [((5, -1), (6, -1), (6, 1), (5, 1))])
    made.tick()
    made.tick()
    assert made.traffic.claimed("u") and made.traffic.claimed("v")
    made.traffic.unclaim("u")
    made.traffic.unclaim("u")
    assert made.traffic.claimed("v")
    made.traffic.unclaim("v")
    assert not made.traffic.grants.shapes()
    send(made, "R0", "P3-0")
    until(made, "R0", "P3-0")


def test_two_robots_swap_round_reserved_ground():
    made = floor(lattice(4, 3), {"R0": ("P0-0", 0.0), "R1": ("P3-0", math.pi)})
    made.tick()
    made.traffic.claim("u", "WMS", [square(made, "P1-1"), square(made, "P2-1")])
    send(made, "R0", "P3-0", 1)
    send(made, "R1", "P0-0", 2)
    for _ in range(1500):
        made.tick()
        made.judge()
    assert made.done == {R0: 1, R1: 1}


def test_the_same_calls_give_the_same_answers():
    def story():
        made = floor(lattice(4, 3), {"R0": ("P0-0", 0.0), "R1": ("P3-0", math.pi)})
        made.tick()
        made.traffic.claim("u", "WMS", [square(made, "P1-0")])
        made.traffic.claim("v", "R1", [square(made, "P2-2")])
        send(made, "R0", "P3-2", 1)
        run(made, 20)
        return made.traffic.plans(0), [robot.x for robot in made.robots.values()]

    assert story() == story()


def test_nobody_sets_out_over_ground_that_a_lost_robot_holds():
    """It may go as far as it has been granted: who set out after it would wait in its lane."""
    made = floor(lattice(7, 2), {"R1": ("P0-0", 0.0), "R0": ("P0-1", 0.0)})
    send(made, "R1", "P6-0")
    while made.robots[R1].x < 3.0:
        made.tick()
    lost = made.robots[R1]
    lost.speed, lost.frozen_s = 0.0, 1e9
    made.traffic.lost(R1)
    lost.report_news = lambda *_: None  # nobody hears it any more
    held = shapely.union_all([shapely.Polygon(s.points) for s in plan(made, R1).spaces])
    at = next(p for p in made.points.values() if p.y_m == 0.0 and held.contains(at_point(p)))
    send(made, "R0", at.name)
    for _ in range(200):
        made.tick()
        assert not made.traffic._tracks[R0].promised
    send(made, "R0", "P6-1")
    until(made, "R0", "P6-1")


def test_others_go_round_a_robot_that_stands_off_its_points():
    """It stands between two lanes, on both, and does not move."""
    made = floor(lattice(5, 4), {"R1": ("P0-3", 0.0), "R0": ("P0-0", 0.0)})
    made.robots[R1].x, made.robots[R1].y = 4.0, 0.5
    made.busy[R1] = made.now_ms + 10**9
    send(made, "R0", "P4-0")
    highest_m = 0.0
    for _ in range(900):
        made.tick()
        made.judge()
        highest_m = max(highest_m, made.robots[R0].y)
        if made.traffic.stands_at(R0, PointName("P4-0")):
            break
    assert made.traffic.stands_at(R0, PointName("P4-0"))
    assert highest_m >= 2.0


def at_point(point):
    return shapely.Point(point.x_m, point.y_m)
