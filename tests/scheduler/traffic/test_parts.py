import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.ids import PathKey, PointName
from ledger.scene import Path, Point
from scheduler.traffic.geometry import poses_along
from scheduler.traffic.network import network
from scheduler.traffic.parts import parts
from tests.scheduler.traffic.maps import area_of

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
    there = [k for k, path in enumerate(cut.paths) if path.start == "A"]
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
    ways = {(a, b) for a, b in zip(net.start, net.end, strict=True)}
    assert ways == {(b, a) for a, b in ways}
    assert len(net.points) == net.named + len(net.paths) // 2 - 1


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


def test_named_paths_stay_whole():
    found = parts(lane((12.0, 0.0)), [], 3.0)
    assert found == []
    area = lane((12.0, 0.0))
    kept = parts(area, list(area.points), 3.0, {PathKey("A->B")})
    assert [part.key for part in kept].count("A->B") == 1
    assert [part.key for part in kept].count("B->A") == 4


def test_where_an_end_forbids_turning_so_do_the_points_inside():
    net = network(lane((12.0, 0.0), turning=False), 3.0)
    assert [point.turning for point in net.points] == [False, True, False, False, False]
