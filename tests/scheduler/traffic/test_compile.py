import math

import pytest

from ledger.ids import PointName
from ledger.scene import Bin, BinName, Group, Kinematics, Path, Point, PointKind
from scheduler.traffic.compile import compile_area, digest_of
from scheduler.traffic.costs import Costs
from tests.scheduler.traffic.maps import area_of, both, lattice, smap, warehouse

GROUPS = [Group(id=0, name="g")]


def names(roadmap, places):
    return {roadmap.net.points[roadmap.places.point[k]].name for k in places}


def stops_of(roadmap):
    return names(roadmap, range(roadmap.places.stops))


def line(*xs: float, **given) -> object:
    points = [Point(name=PointName(f"L{k}"), x_m=x, y_m=0.0, **given) for k, x in enumerate(xs)]
    paths = [p for k in range(len(xs) - 1) for p in both(f"L{k}", f"L{k + 1}")]
    return area_of(points, paths)


def test_every_point_of_a_wide_lattice_is_a_stop():
    roadmap = compile_area(lattice(4, 3), GROUPS)
    assert roadmap.places.stops == 12
    assert roadmap.moves.count == len(roadmap.net.paths)


def test_stops_are_clear_of_each_other_and_of_each_others_turns():
    roadmap = compile_area(lattice(6, 6, 0.5), GROUPS)
    at = [roadmap.net.points[roadmap.places.point[k]] for k in range(roadmap.places.stops)]
    least = min(
        math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) for a in at for b in at if a.name != b.name
    )
    assert least > 0.4 + 0.68 - 0.01  # half a body and the radius of a turn


def test_chargers_and_parking_are_stops_before_all_others():
    points = [
        Point(name=PointName("A"), x_m=0.0, y_m=0.0),
        Point(name=PointName("C"), x_m=0.6, y_m=0.0, kind=PointKind.CHARGING),
        Point(name=PointName("B"), x_m=3.0, y_m=0.0),
    ]
    roadmap = compile_area(area_of(points, both("A", "C") + both("C", "B")), GROUPS)
    assert stops_of(roadmap) == {"B", "C"}


def test_a_goal_too_near_to_a_stop_may_still_be_visited():
    roadmap = compile_area(line(0.0, 2.0, 2.6, 5.0), GROUPS)
    assert len(roadmap.place) == 4
    assert roadmap.places.stops < 4


def test_a_move_needs_its_end_and_all_that_rest_in_its_way_empty():
    roadmap = compile_area(line(0.0, 2.0, 2.6, 5.0), GROUPS)
    for move, end in enumerate(roadmap.moves.end):
        assert roadmap.moves.need[move] >> end & 1
        assert not roadmap.moves.need[move] >> roadmap.moves.start[move] & 1


def test_where_turning_is_forbidden_robots_only_pass():
    names_ = ("A", "M", "B")
    points = [
        Point(name=PointName(n), x_m=3.0 * k, y_m=0.0, turning=n != "M")
        for k, n in enumerate(names_)
    ]
    area = area_of(points, both("A", "M") + both("M", "B"))
    roadmap = compile_area(area, GROUPS)
    costs = Costs(roadmap, GROUPS[0].kinematics)
    a, m, b = (roadmap.place[PointName(n)] for n in names_)
    assert costs.cost_s(a, 0.0, b) < math.inf
    assert costs.cost_s(m, 0.0, b) < math.inf
    assert costs.cost_s(m, 0.0, a) < math.inf  # by way of B, where it may turn
    assert costs.cost_s(m, 0.0, a) > costs.cost_s(m, math.pi, a)


def test_a_dead_end_where_turning_is_forbidden_is_no_stop():
    points = [
        Point(name=PointName("A"), x_m=0.0, y_m=0.0),
        Point(name=PointName("B"), x_m=3.0, y_m=0.0),
        Point(name=PointName("D"), x_m=6.0, y_m=0.0, turning=False),
    ]
    roadmap = compile_area(area_of(points, both("A", "B") + both("B", "D")), GROUPS)
    assert stops_of(roadmap) == {"A", "B"}


def test_reverse_paths_lead_out_of_a_dead_end_without_a_turn():
    points = [
        Point(name=PointName("A"), x_m=0.0, y_m=0.0),
        Point(name=PointName("D"), x_m=3.0, y_m=0.0, turning=False),
    ]
    paths = [
        Path(start=PointName("A"), end=PointName("D")),
        Path(start=PointName("D"), end=PointName("A"), backward=True),
    ]
    roadmap = compile_area(area_of(points, paths), GROUPS)
    costs = Costs(roadmap, GROUPS[0].kinematics)
    assert costs.cost_s(roadmap.place[PointName("D")], 0.0, roadmap.place[PointName("A")]) < 4


def test_the_heading_that_a_goal_demands_costs_a_turn():
    points = [
        Point(name=PointName("A"), x_m=0.0, y_m=0.0),
        Point(name=PointName("B"), x_m=3.0, y_m=0.0, heading_rad=math.pi / 2),
    ]
    roadmap = compile_area(area_of(points, both("A", "B")), GROUPS)
    costs = Costs(roadmap, GROUPS[0].kinematics)
    a, b = roadmap.place[PointName("A")], roadmap.place[PointName("B")]
    assert costs.cost_s(a, 0.0, b) > 3.0 / 1.2 + math.pi / 2
    assert costs.cost_s(b, math.pi / 2, b) == 0.0
    assert costs.cost_s(b, 0.0, b) > 1.0


def test_costs_are_those_of_each_groups_own_limits():
    slow = Group(id=1, name="slow", kinematics=Kinematics(speed_mps_max=0.3))
    roadmap = compile_area(lattice(2, 1), [*GROUPS, slow])
    fast_s, slow_s = (
        Costs(roadmap, g.kinematics).cost_s(0, 0.0 if roadmap.places.point[0] == 0 else math.pi, 1)
        for g in (GROUPS[0], slow)
    )
    assert slow_s == pytest.approx(4 * fast_s)


def test_stubs_and_blind_aisles_are_pockets_and_the_rest_is_not():
    roadmap = compile_area(warehouse(4, 8, 2, blind=(1,)), GROUPS)
    inside = names(
        roadmap, [k for k in range(len(roadmap.place)) if roadmap.pockets.pocket[k] >= 0]
    )
    assert inside == {"K0", "K1"} | {f"B1-{k}" for k in range(8)}
    depths = [roadmap.pockets.depth_m[roadmap.place[PointName(f"B1-{k}")]] for k in range(8)]
    assert depths == sorted(depths)


def test_a_kept_roadmap_is_the_same_as_a_new_one(tmp_path):
    area = warehouse(3, 6, 2)
    first = compile_area(area, GROUPS, tmp_path / "cache")
    second = compile_area(area, GROUPS, tmp_path / "cache")
    assert len(list((tmp_path / "cache").iterdir())) == 1
    assert (first.moves.need, first.moves.paths) == (second.moves.need, second.moves.paths)
    assert first.places.resting == second.places.resting
    assert first.pockets.pocket == second.pockets.pocket
    assert [first.conflicts(c) for c in range(first.cells.count)] == [
        second.conflicts(c) for c in range(second.cells.count)
    ]


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 no archive", b"\x93NUMPY"])
def test_a_damaged_cache_is_made_anew(tmp_path, content):
    area = lattice(2, 2)
    (tmp_path / f"roadmap-{digest_of(area, GROUPS)}.npz").write_bytes(content)
    assert compile_area(area, GROUPS, tmp_path).places.stops == 4


def test_the_digest_changes_with_what_matters_and_with_nothing_else():
    area = lattice(2, 2)
    binned = area_of(
        list(area.points), list(area.paths), [Bin(name=BinName("b"), point=area.points[0].name)]
    )
    digests = {
        digest_of(area, GROUPS),
        digest_of(lattice(2, 2, 2.1), GROUPS),
        digest_of(binned, GROUPS),
        digest_of(area, [Group(id=0, name="g", footprint=((1, 0), (0, 1), (-1, 0)))]),
    }
    assert len(digests) == 4
    assert digest_of(area, GROUPS) == digest_of(lattice(2, 2), GROUPS)


@pytest.mark.parametrize("name", ["ws_ps_bins", "seer_sample_3"])
def test_on_real_maps_every_point_can_be_reached_and_left(name):
    roadmap = compile_area(smap(name), GROUPS)
    costs = Costs(roadmap, GROUPS[0].kinematics)
    assert len(roadmap.place) == roadmap.net.named
    for goal in range(len(roadmap.place)):
        assert max(costs.row(goal)[s] for m, s in enumerate(costs.state)) < math.inf
