"""All robots together: places, memory, chance, battery."""

import random

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.ids import robot_key
from ledger.link import Act, ActionPhase, Cancel, Drive, Report, TellRoute
from ledger.scene import PointKind, Scene
from sim.faults import NONE, FaultMix
from sim.warehouses import generate
from sim.world import World
from tests.sim.fleets import (
    SCENE,
    configs,
    drive_on,
    encoded,
    least_gap_m,
    leaving,
    random_drives,
    scene_of,
)

SMALL: Scene = scene_of(generate(aisles=3, bays=3, robots=4, seed=1))
AREA = SMALL.areas[0]


def world_of(robots: int, seed: int = 1, faults: FaultMix = NONE) -> World:
    world = World(random.Random(seed), faults)
    for config in configs(robots):
        assert world.add(SMALL, config, at_ms=1_000)
    return world


def run(world: World, rng: random.Random, ticks: int, at_ms: int) -> list[bytes]:
    """Let the robots wander; give what they reported."""
    said = []
    for tick in range(ticks):
        reports = world.reports(at_ms + 100 * tick)
        said.append(encoded(reports))
        for drive in random_drives(AREA, reports, rng):
            world.tell(SCENE, drive)
        world.step(0.1)
    return said


def one(world: World, at_ms: int = 2_000) -> Report:
    return world.reports(at_ms)[0]


def until(world: World, seconds: float) -> None:
    world.step(seconds)


def test_robots_begin_on_parking_places_clear_of_each_other() -> None:
    reports = world_of(6).reports(0)
    kinds = {p.name: p.kind for p in AREA.points}
    assert {kinds[r.point] for r in reports if r.point} == {PointKind.PARKING}
    assert least_gap_m(reports) > 2 * 0.61


def test_the_robot_for_which_there_is_no_room_stays_away() -> None:
    world = World(random.Random(1))
    added = [world.add(SMALL, config, at_ms=0) for config in configs(len(AREA.points) + 1)]
    assert True in added
    assert added[-1] is False
    assert least_gap_m(world.reports(0)) > 2 * 0.61


def test_the_road_ahead_of_a_robot_is_no_place_for_another() -> None:
    world = world_of(1)
    report = one(world)
    way = leaving(AREA, report)[0]
    world.tell(SCENE, drive_on(AREA, report, way, 1, part=0.0))
    for config in configs(len(AREA.points))[1:]:
        world.add(SMALL, config, at_ms=0)
    target = next(p for p in AREA.points if p.name == way.end)
    others = world.reports(0)[1:]
    assert len(others) > 3
    assert all(abs(r.x_m - target.x_m) + abs(r.y_m - target.y_m) > 1.2 for r in others)


@given(seed=st.integers(0, 9), chance=st.sampled_from([0.0, 0.3]))
@settings(max_examples=5, deadline=None)
def test_the_same_seed_says_the_same_bytes(seed: int, chance: float) -> None:
    faults = FaultMix(late_ratio=chance, late_mean_s=3.0)
    runs = []
    for _ in range(2):
        world = world_of(3, seed, faults)
        runs.append(run(world, random.Random(seed), 200, 2_000))
    assert runs[0] == runs[1]


@given(seed=st.integers(0, 9), ticks=st.integers(0, 150), chance=st.sampled_from([0.0, 0.3]))
@settings(max_examples=10, deadline=None)
def test_a_loaded_world_goes_on_as_the_saved_one(seed: int, ticks: int, chance: float) -> None:
    faults = FaultMix(late_ratio=chance, late_mean_s=3.0)
    world = world_of(3, seed, faults)
    rng = random.Random(seed)
    run(world, rng, ticks, 2_000)
    world.tell(SCENE, Act(robot=configs(1)[0].name, id="a", name="Load"))
    again = World(random.Random(99), faults)
    again.load(world.save())
    assert again.remembers(robot_key(SCENE, configs(1)[0].name))
    for config in configs(3):
        assert again.add(SMALL, config, at_ms=50_000)
    assert again.save() == world.save()
    at_ms = 2_000 + 100 * ticks
    other = random.Random()
    other.setstate(rng.getstate())
    assert run(again, other, 100, at_ms) == run(world, rng, 100, at_ms)


def test_robots_that_are_not_back_yet_stay_in_memory() -> None:
    world = world_of(2)
    again = World(random.Random(1))
    again.load(world.save())
    again.add(SMALL, configs(1)[0], at_ms=0)
    third = World(random.Random(1))
    third.load(again.save())
    assert all(third.remembers(robot_key(SCENE, c.name)) for c in configs(2))


@pytest.mark.parametrize("raw", [b"", b"\x00", msgspec.msgpack.encode({"version": 1})])
def test_garbage_is_no_memory(raw: bytes) -> None:
    with pytest.raises((ValueError, msgspec.DecodeError)):
        World(random.Random(1)).load(raw)


def test_a_changed_map_makes_a_robot_forget_its_route_but_not_its_place() -> None:
    world = world_of(2)
    before = world.reports(1_000)
    changed = msgspec.structs.replace(
        SMALL, areas=(msgspec.structs.replace(AREA, map_digest="new"),)
    )
    for config in configs(2):
        assert world.remap(changed, config, at_ms=9_000)
    after = world.reports(10_000)
    assert [r.point for r in before] == [r.point for r in after]
    assert [r.map_digest for r in after] == ["new", "new"]
    assert all(a.session != b.session for a, b in zip(before, after, strict=True))


def test_the_route_is_told_once_when_asked_for() -> None:
    world = world_of(1)
    report = one(world)
    drive = drive_on(AREA, report, leaving(AREA, report)[0], 1, part=0.5)
    world.tell(SCENE, drive)
    until(world, 30.0)
    world.tell(SCENE, TellRoute(robot=report.robot))
    told = one(world, 40_000)
    assert told.route == drive.pieces
    assert told.progress == told.authority == drive.authority
    assert told.point is None
    assert one(world, 41_000).route is None


def test_a_robot_rests_on_the_point_where_its_path_ends() -> None:
    world = world_of(1)
    report = one(world)
    way = leaving(AREA, report)[0]
    world.tell(SCENE, drive_on(AREA, report, way, 1))
    until(world, 30.0)
    assert one(world).point == way.end


def test_report_numbers_grow() -> None:
    world = world_of(1)
    numbers = [one(world, at_ms).number for at_ms in (5_000, 5_000, 4_000, 6_000)]
    assert numbers == sorted(set(numbers))


def test_only_news_is_reported_in_between() -> None:
    world = world_of(2)
    world.reports(0)
    world.step(0.1)
    world.reports(100)
    world.step(0.1)
    assert world.reports(200, changed_only=True) == []
    world.tell(SCENE, TellRoute(robot=configs(2)[1].name))
    assert [r.robot for r in world.reports(300, changed_only=True)] == ["AMB-02"]


def test_a_moving_robot_does_not_act_and_an_acting_one_does_not_move() -> None:
    world = world_of(1)
    report = one(world)
    drive = drive_on(AREA, report, leaving(AREA, report)[0], 1)
    world.tell(SCENE, Act(robot=report.robot, id="a", name="Load"))
    world.tell(SCENE, drive)
    until(world, 3.0)
    assert one(world).odometer_m == 0.0
    until(world, 30.0)
    done = one(world)
    assert done.action is not None
    assert done.action.phase is ActionPhase.DONE
    assert done.progress == drive.authority


def at_a_charger(world: World) -> Report:
    """Walk the robot to a charger, breadth first."""
    report = one(world)
    chargers = {p.name for p in AREA.points if p.kind is PointKind.CHARGING}
    routes = {report.point: []}
    queue = [report.point]
    while queue and not chargers & routes.keys():
        here = queue.pop(0)
        for way in [p for p in AREA.paths if p.start == here]:
            if way.end not in routes:
                routes[way.end] = [*routes[here], way]
                queue.append(way.end)
    for way in next(routes[c] for c in chargers if c in routes):
        drive: Drive = drive_on(AREA, report, way, report.progress.piece + 1)
        world.tell(SCENE, drive)
        until(world, 60.0)
        report = one(world)
    return report


def test_a_robot_charges_on_a_charger_until_it_has_a_way_to_go() -> None:
    world = world_of(1)
    report = at_a_charger(world)
    world.tell(SCENE, Act(robot=report.robot, id="c", name="Charge"))
    until(world, 600.0)
    charged = one(world)
    assert charged.charging
    assert charged.battery_ratio > report.battery_ratio + 0.1
    assert charged.action is not None
    assert charged.action.phase is ActionPhase.RUNNING
    way = leaving(AREA, charged)[0]
    world.tell(SCENE, drive_on(AREA, charged, way, charged.progress.piece + 1))
    until(world, 60.0)
    left = one(world)
    assert (left.charging, left.point) == (False, way.end)
    assert left.battery_ratio < charged.battery_ratio


def test_there_is_no_charging_where_there_is_no_charger() -> None:
    world = world_of(1)
    report = one(world)
    world.tell(SCENE, Act(robot=report.robot, id="c", name="Charge"))
    action = one(world).action
    assert action is not None
    assert action.phase is ActionPhase.FAILED


def test_charging_can_be_cancelled() -> None:
    world = world_of(1)
    report = at_a_charger(world)
    world.tell(SCENE, Act(robot=report.robot, id="c", name="Charge"))
    world.tell(SCENE, Cancel(robot=report.robot, id="c"))
    assert not one(world).charging


def test_driving_and_resting_drain_the_battery() -> None:
    world = world_of(1)
    first = one(world)
    until(world, 3600.0)
    rested = one(world)
    assert first.battery_ratio - rested.battery_ratio == pytest.approx(1 / 24, rel=0.01)


def test_an_action_fails_when_asked_to() -> None:
    world = world_of(1)
    robot = configs(1)[0].name
    world.fail_next(SCENE, robot, "Load")
    world.tell(SCENE, Act(robot=robot, id="a", name="Load"))
    action = one(world).action
    assert action is not None
    assert action.phase is ActionPhase.FAILED


def test_disturbed_robots_are_later_but_arrive() -> None:
    def arrival_s(faults: FaultMix) -> int:
        world = world_of(1, 1, faults)
        report = one(world)
        drive = drive_on(AREA, report, leaving(AREA, report)[0], 1)
        world.tell(SCENE, drive)
        for second in range(10_000):
            world.step(1.0)
            if one(world).progress == drive.authority:
                return second
        raise AssertionError("never arrived")

    assert arrival_s(FaultMix(late_ratio=1.0, late_mean_s=60.0)) > arrival_s(NONE)
