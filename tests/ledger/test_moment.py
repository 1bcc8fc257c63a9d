"""Moments are read as people write them, and refused in words."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.errors import Refused
from ledger.moment import TIME_MS_MAX, parse_position, parse_time, time_text


@given(st.integers(0, TIME_MS_MAX))
def test_a_time_reads_back_as_it_was_written(at_ms: int) -> None:
    assert parse_time(time_text(at_ms)) == at_ms
    assert parse_time(str(at_ms)) == at_ms


@pytest.mark.parametrize(
    "text",
    [
        "2026-11-22T10:30:00Z",
        "2026-11-22T11:30:00+01:00",
        "2026-11-22T11:30:00 01:00",  # a plus sign in a URL that nobody encoded
        "2026-11-22T10:30:00",
        "2026-11-22 10:30",
        "1795343400000",
    ],
)
def test_all_usual_ways_to_write_a_time_are_read(text: str) -> None:
    assert parse_time(text) == 1_795_343_400_000


@pytest.mark.parametrize("text", ["", "yesterday", "-5", "2026-13-01", "9" * 30, "1e5", "²"])
def test_what_is_no_time_is_refused_with_the_name_of_its_field(text: str) -> None:
    with pytest.raises(Refused, match="'asOf'"):
        parse_time(text)


@pytest.mark.parametrize("text", ["", "-1", "x", "1.5", "9" * 19])
def test_what_is_no_position_is_refused(text: str) -> None:
    with pytest.raises(Refused, match="'position'"):
        parse_position(text)
