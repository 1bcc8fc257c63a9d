from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from fleetledger.clock import Clock, kept_time_ms


@given(st.integers(0, 10**13), st.integers(0, 10**18), st.floats(0.1, 100))
def test_a_child_reads_the_clock_that_the_core_wrote(base: int, start: int, speed: float) -> None:
    clock = Clock(base_ms=base, started_ns=start, speed=speed)

    assert Clock.parse(clock.text()) == clock


def test_a_clock_starts_behind_the_newest_event_even_if_the_wall_is_earlier() -> None:
    far_ahead_ms = 10**13

    clock = Clock.start(far_ahead_ms, speed=10)

    assert clock.now_ms() >= far_ahead_ms


def test_time_does_not_go_back_while_it_runs_fast() -> None:
    clock = Clock.start(0, speed=100)

    times = [clock.now_ms() for _ in range(1000)]

    assert times == sorted(times)


def test_nothing_kept_is_the_beginning_of_time(tmp_path: Path) -> None:
    assert kept_time_ms(tmp_path) == 0
    (tmp_path / "clock").write_text("1234")
    assert kept_time_ms(tmp_path) == 1234
