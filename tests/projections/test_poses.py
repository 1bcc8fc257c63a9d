"""Reports of different times, brought to one instant."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import RobotName
from ledger.link import Report
from projections.poses import CARRIED_MS_MAX, FRESH_MS, at_instant, carried, common_instant
from tests.strategies import SCENE


def report(at_ms: int, x_m: float = 0.0, heading_rad: float = 0.0, **more: float) -> Report:
    return Report(
        scene=SCENE,
        robot=RobotName("R1"),
        number=0,
        at_ms=at_ms,
        area=0,
        x_m=x_m,
        y_m=0.0,
        heading_rad=heading_rad,
        **more,  # type: ignore[arg-type]
    )


def test_nobody_reported_means_no_instant() -> None:
    assert common_instant([]) is None


def test_the_instant_is_the_newest_that_all_have_reached() -> None:
    assert common_instant([report(1_000), report(1_090), report(1_030)]) == 1_000


def test_nobody_waits_for_a_robot_that_fell_silent() -> None:
    assert common_instant([report(0), report(FRESH_MS + 100), report(FRESH_MS + 90)]) == (
        FRESH_MS + 90
    )


@given(st.floats(0, 1), st.floats(-10, 10), st.floats(-10, 10))
def test_a_pose_between_two_reports_lies_between_them(part: float, a: float, b: float) -> None:
    found = at_instant([report(0, a), report(1_000, b)], round(part * 1_000))
    assert min(a, b) - 1e-9 <= found.x_m <= max(a, b) + 1e-9


def test_headings_turn_the_short_way_round() -> None:
    found = at_instant([report(0, heading_rad=3.0), report(100, heading_rad=-3.0)], 50)
    assert abs(found.heading_rad) == pytest.approx(math.pi)


def test_a_robot_is_carried_on_for_a_moment_only() -> None:
    moving = report(0, speed_mps=1.0)
    assert carried(moving, 100).x_m == pytest.approx(0.1)
    assert carried(moving, 60_000).x_m == pytest.approx(CARRIED_MS_MAX / 1000)
    assert carried(moving, 60_000).at_ms == 60_000


def test_a_robot_that_joined_later_is_shown_where_it_joined() -> None:
    assert at_instant([report(100, 5.0)], 50).x_m == 5.0


def test_two_areas_are_not_mixed() -> None:
    other = Report(
        **{f: getattr(report(100, 9.0), f) for f in Report.__struct_fields__} | {"area": 1}
    )
    assert at_instant([report(0), other], 50).x_m == 0.0
