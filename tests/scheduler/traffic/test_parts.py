import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.ids import PointName, RobotName
from ledger.scene import Group, Path, Point
from ledger.scene_config import SceneConfig
from scheduler.goal import Goal
from scheduler.traffic.compile import compile_area
from scheduler.traffic.costs import Costs
from scheduler.traffic.geometry import poses_along
from scheduler.traffic.network import network
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import area_of, both

xy = st.tuples(st.floats(-8, 8), st.floats(-8, 8)).map(lambda p: (round(p[0], 3), round(p[1], 3)))


def lane(end, controls=(), back=True, **given_):
    """A path from the origin, and the way back over the same ground."""
    points = [
        Point(name=PointName("A"), x_m=0.0, y_m=0.0, **given_),
        Point(name=PointName("B"), x_m=end[0], y_m=end[1]),
    ]
    there = Path(start=PointName("A"), end=PointName("B"), controls=tuple(controls))
    home = Path(start=PointName("B"), end=PointName("A"), controls=tuple(controls[::-1]))
    return area_of(points, [there, home] if back else [there])


@settings(max_examples=25, deadline=None)
@given(xy.filter(lambda p: math.hypot(*p) > 1), st.lists(xy, max_size=3), st.floats(0.5, 4))
def test_the_parts_of_a_path_are_the_path_and_equally_long(end, controls, part_m):
    area = lane(end, controls)
    whole, cut = network(area), network(area, part_m)
    length = whole.traces.length_m[0]
    there = [k for k, p in enumerate(cut.paths) if p.start == "A" and not cut.retreat[k]]
    assert len(there) == (1 if length < 2 * part_m else int(length / part_m))
    assert sum(cut.traces.length_m[k] for k in there) == pytest.approx(length, rel=0.01)
    assert len(there) == 1 or min(cut.traces.length_m[k] for k in there) > 0.95 * part_m
    _, poses = poses_along(whole.traces.curves[0], 2001, False)
    for k in there:
        x, y = cut.traces.curves[k][-1]
        assert np.hypot(poses[:, 0] - x, poses[:, 1] - y).min() < 0.02 * max(length, 1.0)
    assert [cut.end[k] for k in there[:-1]] == [cut.start[k] for k in there[1:]]


@settings(max_examples=25, deadline=None)
@given(xy.filter(lambda p: math.hypot(*p) > 4), st.lists(xy, max_size=2))
def test_both_ways_of_a_lane_are_cut_at_the_same_points(end, controls):
    net = network(lane(end, controls), 2.0)
    ways = {(net.start[k], net.end[k]) for k in range(len(net.paths)) if not net.retreat[k]}
    assert ways == {(b, a) for a, b in ways}
    assert len(net.points) == net.named + len(ways) // 2 - 1


def test_ways_over_different_ground_share_no_points():
    area = lane((12.0, 0.0))
    bowed = Path(start=PointName("B"), end=PointName("A"), controls=((6.0, 3.0),))
    net = network(area_of(list(area.points), [area.paths[0], bowed]), 3.0)
    assert all(len(net.out[k]) == 1 for k in range(net.named, len(net.points)))


def test_points_inside_a_path_are_no_points_of_the_area():
    area = lane((12.0, 0.0))
    net = network(area, 3.0)
    assert (net.named, len(net.points)) == (2, 5)
    assert set(net.number) == {"A", "B"}
    assert network(area).points == list(area.points)


def test_where_an_end_forbids_turning_so_do_the_points_inside():
    net = network(lane((12.0, 0.0), turning=False), 3.0)
    assert [point.turning for point in net.points] == [False, True, False, False, False]


def comb():
    """A ring of four with a stub of two points at one corner, and a one-way stub at another."""
    at = {"A": (0, 0), "B": (4, 0), "C": (4, 4), "D": (0, 4), "S": (-3, 0), "T": (-5, 0)}
    points = [Point(name=PointName(n), x_m=x, y_m=y) for n, (x, y) in at.items()]
    points.append(Point(name=PointName("O"), x_m=7.0, y_m=4.0))
    ways = ("AB", "BC", "CD", "DA", "AS", "ST")
    paths = [path for a, b in ways for path in both(a, b)]
    return area_of(points, [*paths, Path(start=PointName("C"), end=PointName("O"))])


def test_out_of_dead_ends_there_are_ways_in_reverse_over_the_way_in():
    net = network(comb())
    back = {net.paths[k].key for k in range(len(net.paths)) if net.retreat[k]}
    assert back == {"S->A", "T->S"}
    for k, path in enumerate(net.paths):
        if net.retreat[k]:
            twin = next(j for j, p in enumerate(net.paths) if p.key == f"{path.end}->{path.start}")
            assert path.backward
            assert net.traces.heading_end[k] == pytest.approx(net.traces.heading_start[twin])


def test_who_backs_into_a_dead_end_needs_no_other_way_out():
    area = comb()
    paths = [
        Path(start=p.start, end=p.end, backward=True) if p.key == "A->S" else p for p in area.paths
    ]
    net = network(area_of(list(area.points), paths))
    assert {net.paths[k].key for k in range(len(net.paths)) if net.retreat[k]} == {"T->S"}


def test_reversing_out_of_a_dead_end_is_open_only_to_whom_it_is_switched_on_for():
    roadmap = compile_area(comb(), (Group(id=0, name="g"),))
    moves, limits = roadmap.moves, roadmap.groups[0].kinematics
    assert moves.retreats
    s, a = (roadmap.place[PointName(n)] for n in "SA")
    plain, also = Costs(roadmap, limits), Costs(roadmap, limits, retreats=True)
    facing_in = math.pi
    assert moves.retreats.isdisjoint(m for _, m, *_ in plain.departures(s, facing_in))
    assert not moves.retreats.isdisjoint(m for _, m, *_ in also.departures(s, facing_in))
    assert also.cost_s(s, facing_in, a) < plain.cost_s(s, facing_in, a) - 3.0
    for move in moves.retreats:
        cells = [c for path in moves.paths[move] for c, _ in roadmap.path_cells(0, path)]
        there = (moves.end[move], moves.start[move])
        into = next(
            m
            for m in range(moves.count)
            if (moves.start[m], moves.end[m]) == there and m not in moves.retreats
        )
        same = [c for path in moves.paths[into] for c, _ in roadmap.path_cells(0, path)]
        assert cells == same[::-1]


def test_a_robot_reverses_out_of_a_dead_end_where_it_may():
    made = Floor(comb(), (Group(id=0, name="g"),), {"R0": ("A", 0.0)}, [], seed=1)
    name = RobotName("R0")
    made.idle = {name}
    made.traffic.tune(SceneConfig(reverse_out_of_deadlock=True))
    for orders, point in enumerate(("T", "C")):
        made.goals[name] = Goal(point=PointName(point), rank=(0, 0, name))
        backed = False
        while made.done[name] == orders and made.now_ms < 1_200_000:
            made.tick()
            made.judge()
            backed = backed or made.robots[name].speed < 0
        assert made.done[name] == orders + 1
        assert backed == (point == "C")
