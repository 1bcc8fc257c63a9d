"""Positions along Bezier paths."""

from math import hypot, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.scene import XY
from sim.curves import SAMPLE_M, pose, track

near = st.floats(-5.0, 5.0)
curves = st.lists(st.tuples(near, near), min_size=2, max_size=6).filter(
    lambda points: hypot(points[0][0] - points[-1][0], points[0][1] - points[-1][1]) > 0.1
)


@given(points=curves, part=st.floats(0.0, 1.0))
def test_equal_lengths_are_equal_ways(points: list[XY], part: float) -> None:
    table = track(tuple(points))
    along_m = part * table.length_m
    x, y, _, _ = pose(table, along_m)
    onward_m = min(along_m + 0.01, table.length_m)
    new_x, new_y, _, _ = pose(table, onward_m)
    assert hypot(new_x - x, new_y - y) <= onward_m - along_m + 1e-9


@given(points=curves)
def test_a_curve_begins_and_ends_at_its_ends(points: list[XY]) -> None:
    table = track(tuple(points))
    for at_m, end in ((0.0, points[0]), (table.length_m, points[-1])):
        x, y, _, _ = pose(table, at_m)
        assert hypot(x - end[0], y - end[1]) < 1e-9


def test_a_quarter_circle_has_its_length_heading_and_curvature() -> None:
    k = 0.5522847498
    table = track(((1.0, 0.0), (1.0, k), (k, 1.0), (0.0, 1.0)))
    assert table.length_m == pytest.approx(pi / 2, rel=1e-3)
    assert pose(table, table.length_m / 2)[2] == pytest.approx(pi * 3 / 4, abs=1e-3)
    assert table.curvature_max == pytest.approx(1.0, abs=0.05)
    assert max(table.distances_m[i + 1] - table.distances_m[i] for i in range(8)) < SAMPLE_M * 1.5


def test_coincident_controls_have_the_direction_of_the_way() -> None:
    fifth = ((0.0, 0.0), (0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 0.0))
    table = track(fifth)
    assert table.headings_rad == pytest.approx([0.0] * len(table.headings_rad))
