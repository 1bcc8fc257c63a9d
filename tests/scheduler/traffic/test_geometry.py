import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ledger.scene import Group
from scheduler.traffic.geometry import (
    MARGIN_M,
    bezier,
    body_at,
    cut_front,
    discs,
    is_straight,
    poses_along,
    sweeps,
    trace,
    turn_rad,
    widened,
    wrap,
)

coordinates = st.floats(-5, 5).map(lambda x: round(x, 3))
points = st.tuples(coordinates, coordinates)
controls = st.lists(points, min_size=2, max_size=5).filter(
    lambda c: math.dist(c[0], c[-1]) > 0.5 and len(set(c)) == len(c)
)
FOOTPRINT = Group(id=0, name="g").footprint


@given(controls)
def test_a_curve_begins_and_ends_at_its_ends(curve):
    xy, _ = bezier(np.array(curve), np.array([0.0, 1.0]))
    assert np.allclose(xy, [curve[0], curve[-1]])


@given(st.lists(points, min_size=4, max_size=4), st.floats(0, 1))
def test_a_cubic_is_the_bernstein_polynomial(curve, t):
    a, b, c, d = (np.array(p) for p in curve)
    u = 1 - t
    wanted = u**3 * a + 3 * u * u * t * b + 3 * u * t * t * c + t**3 * d
    assert np.allclose(bezier(np.array(curve), np.array([t]))[0][0], wanted)


@given(controls, st.floats(0.05, 0.95))
def test_the_rest_of_a_curve_lies_on_it_and_ends_where_it_ends(curve, share):
    length, poses = poses_along(curve, 201, False)
    rest = cut_front(curve, share * length)
    left, _ = poses_along(rest, 2, False)
    assert rest[-1] == pytest.approx(curve[-1])
    assert left == pytest.approx(length * (1 - share), abs=0.02 * length)
    line = shapely.LineString(poses[:, :2])
    assert line.distance(shapely.Point(rest[0])) < 0.02 * length


@given(controls, st.booleans(), st.floats(0, 1))
def test_the_body_is_inside_the_cell_of_the_piece_it_is_on(curve, backward, share):
    traces = trace([tuple(curve)], [backward])
    cells = sweeps(traces, widened(FOOTPRINT))
    _, poses = poses_along(curve, 401, backward)
    at = round(share * 400)
    piece = min(int(at / 400 * len(cells)), len(cells) - 1)
    x, y, heading = poses[at]
    turned = abs(wrap(poses[max(at - 1, 0)][2] - poses[min(at + 1, 400)][2]))
    if turned < 0.05:  # at a cusp no robot follows its path anyway
        body = body_at(np.array(FOOTPRINT), x, y, heading)
        assert cells[piece].buffer(1e-6).covers(body)


def test_driving_backwards_turns_the_body_by_half_a_turn():
    forward, backward = trace([((0, 0), (1, 0))] * 2, [False, True]).heading_start
    assert abs(wrap(forward - backward)) == pytest.approx(math.pi)


def test_a_curve_whose_controls_lie_on_its_chord_is_straight():
    assert is_straight(((0, 0), (1, 0), (2, 0), (3, 0)))
    assert not is_straight(((0, 0), (1, 0.1), (2, 0), (3, 0)))
    assert not is_straight(((0, 0), (4, 0), (2, 0), (3, 0)))


def test_a_turn_is_the_shorter_way_and_nothing_if_it_is_small():
    assert turn_rad(3.0, -3.0) == pytest.approx(2 * math.pi - 6.0)
    assert turn_rad(0.0, 0.04) == 0.0


def test_a_disc_holds_the_body_under_every_heading():
    corners = widened(FOOTPRINT)
    disc = discs(corners, np.array([[1.0, 2.0]]))[0]
    for k in range(60):
        assert disc.buffer(1e-9).covers(body_at(corners, 1.0, 2.0, k / 10))


def test_a_widened_footprint_has_the_margin_on_every_side():
    assert widened(FOOTPRINT).max(axis=0) == pytest.approx((0.5 + MARGIN_M, 0.35 + MARGIN_M))
