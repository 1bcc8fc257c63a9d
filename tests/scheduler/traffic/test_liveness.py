"""Nobody stands still for good, and nobody ever overlaps: whole floors under the judge."""

import math

import pytest

from ledger.ids import PointName
from ledger.scene import Group, PointKind, SceneFile
from scheduler.corridors import Corridor
from sim.warehouses import for_robots
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice, smap, spread, warehouse

GROUPS = (Group(id=0, name="g"),)


def generated(robots: int, seed: int, late: float) -> Floor:
    scene: SceneFile = for_robots(robots, seed)
    (area,) = scene.areas
    parking = [p.name for p in area.points if p.kind in (PointKind.PARKING, PointKind.CHARGING)]
    starts = {f"R{k:02d}": (parking[k], math.pi / 2) for k in range(robots)}
    bins = sorted({bin.point for bin in area.bins})
    lanes = {p.name: Corridor(name=PointName(f"{p.x_m}"), orders_max=2) for p in area.points}
    return Floor(area, scene.groups, starts, bins, seed=seed, late=late, corridors=lanes)


def test_a_lattice_with_delays_keeps_going():
    area = lattice(6, 6)
    names = [point.name for point in area.points]
    floor = Floor(area, GROUPS, spread(area, names, 10), names, seed=1, late=0.1)
    floor.run(120)
    assert min(floor.done.values()) >= 1
    assert floor.still_ms < 60_000


def test_single_lane_aisles_and_dead_ends_keep_going():
    area = warehouse(6, 10, 5, blind=(2,))
    ends = [point.name for point in area.points if point.kind is not PointKind.WAYPOINT]
    floor = Floor(area, GROUPS, spread(area, ends, 6), ends, seed=2, late=0.1)
    floor.run(240)
    assert min(floor.done.values()) >= 1
    assert floor.still_ms < 90_000


def test_twenty_robots_keep_a_generated_warehouse_going():
    floor = generated(20, seed=1, late=0.05)
    floor.run(120)
    assert sum(floor.done.values()) >= 20
    assert floor.still_ms < 60_000


@pytest.mark.parametrize("name", ["ws_ps_bins", "seer_sample_3"])
def test_three_robots_keep_a_real_map_going(name):
    area = smap(name)
    parking = [point.name for point in area.points if point.kind is PointKind.PARKING]
    names = [point.name for point in area.points]
    floor = Floor(area, GROUPS, spread(area, parking, 3), names, seed=3)
    floor.run(240, judge_every_s=1.0)
    assert min(floor.done.values()) >= 1
    assert floor.still_ms < 120_000


def test_the_same_seed_gives_the_same_floor():
    floors = [generated(20, seed=5, late=0.1) for _ in range(2)]
    for floor in floors:
        for _ in range(300):
            floor.tick()
    first, second = ([robot.report(0, 0) for robot in f.robots.values()] for f in floors)
    assert first == second
    assert floors[0].traffic.plans(0) == floors[1].traffic.plans(0)


def stage(seed):
    """For the soak: floors full of robots, for long, and real maps."""
    if seed % 3:
        robots, seconds = ((20, 900), (50, 600))[seed % 2]
        floor = generated(robots, seed=seed, late=0.05)
        floor.run(seconds)
        assert min(floor.done.values()) >= 1
        assert floor.still_ms < 120_000
        return
    area = smap(("ws_ps_bins", "seer_sample_3")[seed % 2])
    names = [PointName(point.name) for point in area.points]
    floor = Floor(area, GROUPS, spread(area, names, 3), names, seed=seed, late=0.05)
    floor.run(3600, judge_every_s=1.0)
    assert min(floor.done.values()) >= 10
    assert floor.still_ms < 240_000
