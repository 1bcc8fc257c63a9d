"""What strikes simulated robots: each fault does what it says, and ends."""

import random
from math import hypot

import pytest

from fleetledger.config import Faults
from ledger.ids import robot_key
from ledger.link import DISPATCHER, Report
from ledger.scene import Scene
from sim.faults import JUMP_M_MAX, MIXES, NONE, STANDARD, FaultMix
from sim.people import BY_HAND, NEAR_M, Hand, too_near
from sim.placement import Ground
from sim.robot import SimRobot
from sim.warehouses import generate
from sim.world import World
from tests.sim.fleets import SCENE, configs, drive_on, least_gap_m, leaving, scene_of

SMALL: Scene = scene_of(generate(aisles=3, bays=3, robots=4, seed=1))
AREA = SMALL.areas[0]
OFTEN = 3600.0  # each robot every second


def world_of(robots: int, mix: FaultMix, seed: int = 1) -> World:
    world = World(random.Random(seed), mix)
    for config in configs(robots):
        assert world.add(SMALL, config, at_ms=1_000)
    return world


def where(world: World) -> list[tuple[float, float, float]]:
    return [(robot.x, robot.y, robot.heading) for robot in world.robots()]


def test_all_named_mixes_can_be_asked_for_on_the_command_line() -> None:
    assert {str(name) for name in Faults} == MIXES.keys()
    assert not NONE.strikes
    assert STANDARD.times(2).hand_per_h == 2 * STANDARD.hand_per_h
    assert STANDARD.times(2).lost_ratio == STANDARD.lost_ratio


def test_a_frozen_robot_stands_and_goes_on_later() -> None:
    world = world_of(1, FaultMix(frozen_per_h=OFTEN, frozen_mean_s=20.0))
    for _ in range(50):
        world.step(0.2)
    assert set(world.troubles.values()) == {"frozen"}
    report = world.reports(2_000)[0]
    world.tell(SCENE, drive_on(AREA, report, leaving(AREA, report)[0], 1))
    before = where(world)
    world.step(1.0)
    assert where(world) == before
    world.calm()
    for _ in range(200):
        world.step(0.2)
    assert where(world) != before


def test_a_robot_is_pushed_at_most_half_a_metre_and_put_back_on_a_point() -> None:
    world = world_of(1, FaultMix(jump_per_h=OFTEN, jump_mean_s=5.0))
    before = where(world)[0]
    while not world.troubles:
        world.step(0.2)
    after = where(world)[0]
    assert 0.0 < hypot(after[0] - before[0], after[1] - before[1]) <= JUMP_M_MAX
    report = world.reports(2_000)[0]
    assert (report.x_m, report.y_m, report.point) == (*after[:2], None)
    world.calm()
    for _ in range(300):
        world.step(0.2)
    report = world.reports(90_000)[0]
    assert world.troubles == {}
    assert (report.controller, report.point is not None) == (DISPATCHER, True)


def test_a_robot_whose_link_is_cut_is_not_heard_until_it_is_mended() -> None:
    world = world_of(2, FaultMix(cut_per_h=OFTEN, cut_mean_s=1e6))
    for _ in range(100):
        world.step(0.2)
    assert world.reports(2_000) == []
    world.calm()
    world.step(0.2)
    assert len(world.reports(3_000)) == 2


@pytest.mark.parametrize("seed", range(4))
def test_robots_driven_by_hand_keep_clear_of_each_other_and_end_on_points(seed: int) -> None:
    world = world_of(4, FaultMix(hand_per_h=OFTEN, hand_mean_s=20.0), seed)
    sessions = {report.session for report in world.reports(1_500)}
    moved = False
    for tick in range(300):
        world.step(0.2)
        reports = world.reports(2_000 + 200 * tick)
        assert least_gap_m(reports) > 2 * 0.61
        moved |= any(r.controller == BY_HAND and r.speed_mps > 0.0 for r in reports)
    assert moved
    world.calm()
    for _ in range(600):
        world.step(0.2)
    reports = world.reports(500_000)
    assert {r.controller for r in reports} == {DISPATCHER}
    assert all(r.point is not None for r in reports)
    assert sessions.isdisjoint(r.session for r in reports if r.session not in sessions)


def heard(world: World, rounds: int) -> list[Report]:
    said: list[Report] = []
    for tick in range(rounds):
        world.step(0.1)
        said += world.reports(2_000 + 100 * tick)
    return said


def test_reports_are_lost_repeated_and_late_as_often_as_asked_for() -> None:
    said = heard(world_of(1, FaultMix(lost_ratio=0.2)), 1000)
    assert 700 < len(said) < 900
    said = heard(world_of(1, FaultMix(repeated_ratio=0.2)), 1000)
    numbers = [report.number for report in said]
    assert 1100 < len(numbers) < 1300
    assert len(set(numbers)) == 1000
    said = heard(world_of(1, FaultMix(reordered_ratio=0.2)), 1000)
    numbers = [report.number for report in said]
    assert len(numbers) == len(set(numbers)) > 990
    assert numbers != sorted(numbers)


def test_a_restarted_simulator_lets_go_of_who_was_driven_by_hand() -> None:
    world = world_of(1, FaultMix(hand_per_h=OFTEN, hand_mean_s=1e6))
    while world.reports(2_000)[0].controller != BY_HAND:
        world.step(0.2)
    again = World(random.Random(1), NONE)
    again.load(world.save())
    assert again.add(SMALL, configs(1)[0], at_ms=0)
    assert again.reports(3_000)[0].controller == DISPATCHER
    assert again.remembers(robot_key(SCENE, configs(1)[0].name)) is False


def test_who_cannot_be_put_back_for_a_crowd_is_carried_to_where_there_is_room() -> None:
    """Found by eight hours of faults: the crowd waited for the robot, and people for the crowd."""
    (robot,) = world_of(1, NONE).robots()
    crowd = [
        SimRobot(robot.body, "s", (point.x_m, point.y_m, 0.0))
        for point in AREA.points
        if hypot(point.x_m - robot.x, point.y_m - robot.y) <= NEAR_M
    ]
    hand, chance, ground = Hand(robot, "s"), random.Random(1), Ground(AREA)
    passed_s = 0.0
    while not hand.step(0.2, chance, ground, crowd, home=True):
        passed_s += 0.2
        assert passed_s < 120.0
    assert robot.controller == DISPATCHER
    assert robot.point is not None
    assert not too_near(robot, robot.x, robot.y, crowd)


def test_who_backs_off_from_one_robot_comes_no_nearer_to_another() -> None:
    """Found by hours of faults: the other was just then told to drive on, over granted ground."""
    (robot,) = world_of(1, NONE).robots()
    x, y, reach_m = robot.x, robot.y, 2 * robot.body.radius_m
    others = [SimRobot(robot.body, "s", (x + dx, y, 0.0)) for dx in (-reach_m, reach_m + 0.5)]
    hand = Hand(robot, "s")
    hand._back_off(0.2, others[:1])
    assert robot.x > x
    at_m = robot.x
    hand._back_off(0.2, others)
    assert robot.x == at_m


def test_the_same_seed_has_the_same_faults() -> None:
    def story(seed: int) -> list[tuple[float, float, float]]:
        world = world_of(4, STANDARD.times(600), seed)
        for _ in range(300):
            world.step(0.2)
            world.reports(2_000)
        return where(world)

    assert story(3) == story(3) != story(4)
