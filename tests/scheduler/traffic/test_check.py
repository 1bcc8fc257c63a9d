from itertools import pairwise

import msgspec
import pytest

from ledger.ids import BinName, PointName, RobotName
from ledger.scene import Bin, Group, Path, Point, PointKind, RobotConfig, SceneFile
from scheduler.traffic.check import check_scene
from tests.scheduler.traffic.maps import area_of, both, lattice, smap


def codes(area, **given):
    found = check_scene(SceneFile(name="s", areas=(area,), **given))
    return {finding.code: finding.unusable for finding in found}


def point(name, x, **given):
    return Point(name=PointName(name), x_m=x, y_m=0.0, **given)


def test_nothing_is_said_against_a_sound_map():
    assert codes(lattice(4, 4)) == {}


def test_points_within_one_footprint_of_each_other_are_named():
    found = check_scene(SceneFile(name="s", areas=(lattice(4, 4, 0.5),)))
    words = next(finding.words for finding in found if finding.code == "PointsTooNear")
    assert "P0-0 and P0-1 (0.50 m)" in words


def test_a_map_without_paths_is_unusable():
    assert codes(area_of([point("A", 0.0), point("B", 5.0)], []))["NoStop"]


def test_paths_and_bins_at_unknown_points_are_unusable():
    area = lattice(2, 2)
    path = Path(start=PointName("P0-0"), end=PointName("X"))
    assert codes(msgspec.structs.replace(area, paths=(*area.paths, path)))["PathEndUnknown"]
    lost = Bin(name=BinName("b"), point=PointName("X"))
    assert codes(msgspec.structs.replace(area, bins=(lost,)))["BinPointUnknown"]


def test_names_that_mean_two_things_are_unusable():
    area = lattice(2, 2)
    assert codes(msgspec.structs.replace(area, points=(*area.points, area.points[0])))["PointTwice"]
    assert codes(msgspec.structs.replace(area, paths=(*area.paths, area.paths[0])))["PathTwice"]


def test_one_way_dead_ends_and_ways_in_that_are_missing_are_told_apart():
    area = lattice(3, 3)
    points = [*area.points, point("In", -3.0), point("Out", 7.0)]
    into = Path(start=PointName("P2-0"), end=PointName("Out"))
    out_of = Path(start=PointName("In"), end=PointName("P0-0"))
    found = check_scene(SceneFile(name="s", areas=(area_of(points, [*area.paths, into, out_of]),)))
    words = {finding.code: finding.words for finding in found}
    assert "Out" in words["DeadEnd"] and "In" not in words["DeadEnd"]
    assert "In" in words["Unreachable"]


def test_more_robots_than_room_is_unusable_and_many_are_a_warning():
    robots = tuple(RobotConfig(name=RobotName(f"R{k}")) for k in range(4))
    assert codes(lattice(2, 2), robots=robots)["TooManyRobots"]
    assert not codes(lattice(3, 3), robots=robots)["Crowded"]


def test_a_robot_of_a_group_that_is_not_there_is_unusable():
    robots = (RobotConfig(name=RobotName("R"), group=7),)
    assert codes(lattice(2, 2), robots=robots)["GroupUnknown"]


def test_a_footprint_without_area_is_unusable():
    flat = Group(id=0, name="flat", footprint=((0, 0), (1, 0)))
    assert codes(lattice(2, 2), groups=(flat,))["FootprintEmpty"]


def test_where_a_robot_would_have_to_turn_and_must_not_is_named():
    points = [point("A", 0.0), point("B", 3.0), point("D", 6.0, turning=False)]
    assert "TurnNeeded" in codes(area_of(points, both("A", "B") + both("B", "D")))


@pytest.mark.parametrize("name", ["ws_ps_bins", "seer_sample_3", "degenerate_20250908"])
def test_real_maps_can_be_used_as_they_are(name):
    assert not any(codes(smap(name)).values())


def test_three_points_within_one_footprint_are_reported():
    assert "PointsTooNear" in codes(smap("degenerate_20250908"))


def test_an_empty_area_is_unusable_and_harms_nobody():
    assert codes(area_of([], []))["NoStop"]


def test_where_loads_are_taken_too_near_to_others_is_said():
    """Two bins a metre and a half apart on two lanes: room for empty robots, not for pallets."""
    points = [point("A0", 0.0, kind=PointKind.ACTION), point("A1", 4.0)]
    beside = [
        msgspec.structs.replace(p, name=PointName(f"B{k}"), y_m=1.5) for k, p in enumerate(points)
    ]
    area = area_of([*points, *beside], [*both("A0", "A1"), *both("B0", "B1"), *both("A1", "B1")])
    pallet = ((0.9, 0.6), (-0.9, 0.6), (-0.9, -0.6), (0.9, -0.6))
    empty, forks = (Group(id=0, name="g", footprint_loaded=shape) for shape in (None, pallet))
    assert "TightWhenLoaded" not in codes(area, groups=(empty,))
    found = check_scene(SceneFile(name="s", areas=(area,), groups=(forks,)))
    words = next(finding.words for finding in found if finding.code == "TightWhenLoaded")
    assert "A0 (B0)" in words


def test_a_loaded_footprint_without_ground_is_unusable():
    flat = Group(id=0, name="g", footprint_loaded=((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)))
    assert codes(lattice(2, 2), groups=(flat,))["FootprintEmpty"]


def words_of(area, **given):
    found = check_scene(SceneFile(name="s", areas=(area,), **given))
    return {finding.code: finding.words for finding in found}


def beside(gap_m):
    """Two rows of short lanes side by side, this far apart."""
    names = [[f"P{i}-{j}" for i in range(8)] for j in range(2)]
    points = [
        Point(name=PointName(name), x_m=2.0 * i, y_m=gap_m * j)
        for j, row in enumerate(names)
        for i, name in enumerate(row)
    ]
    return area_of(points, [p for row in names for a, b in pairwise(row) for p in both(a, b)])


def test_roads_nearer_than_a_robot_is_wide_are_named():
    words = words_of(beside(0.7))["RoadsTooNear"]
    assert "of the ways between stops" in words and "->" in words
    assert "RoadsTooNear" not in words_of(beside(2.0))
    assert "RoadsTooNear" not in words_of(lattice(5, 5))


def test_dead_ends_in_which_robots_cannot_pass_are_named_with_their_depth():
    area = lattice(3, 3)
    stub = [point(f"S{k}", 4.0 + 2.0 * k) for k in (1, 2, 3)]
    line = ["P2-0", "S1", "S2", "S3"]
    paths = [p for a, b in pairwise(line) for p in both(a, b)]
    words = words_of(area_of([*area.points, *stub], [*area.paths, *paths]))["NoWayThrough"]
    assert "S3 (6 m)" in words


def test_a_turn_that_hits_a_robot_or_a_wall_is_named():
    near = [point("A", 0.0), point("B", 2.0), point("C", 2.9), point("D", 5.0)]
    area = area_of(near, both("A", "B") + both("B", "C") + both("C", "D"))
    assert "TurnHitsRobots" in words_of(area)
    walled = msgspec.structs.replace(lattice(3, 3), walls=(((-1.0, -0.5), (0.5, -0.5)),))
    words = words_of(walled)["TurnHitsWall"]
    assert "P0-0" in words and "P1-0" not in words


def test_points_where_work_blocks_others_are_named():
    points = [
        point("A", 0.0),
        point("B", 3.0, kind=PointKind.ACTION),
        point("B2", 3.5),
        point("C", 6.5),
    ]
    area = area_of(points, both("A", "B") + both("B", "B2") + both("B2", "C"))
    assert "B (" in words_of(area)["WorkBlocksLane"]


def test_points_inside_long_paths_are_never_named():
    area = area_of([point("A", 0.0), point("B", 20.0)], both("A", "B"))
    assert not any("@" in words for words in words_of(area).values())
