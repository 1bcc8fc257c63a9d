import asyncio
import itertools
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import structlog
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from commands.handle import Handler
from commands.scene_life import CreateScene
from fleetledger.clock import Clock, keep_time, kept_time_ms, wall_ms, warn_if_ahead
from ledger.ids import CommandId, SceneId
from ledger.moment import At
from ledger.scan import read_folder
from ledger.snapshot import restore
from ledger.store import FileLedger
from replay.moment import Moments


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


@pytest.mark.parametrize("text", ["", "soon", "-5", "1e9", "\0", "9" * 30, str(10**13), "12 34"])
def test_a_damaged_time_is_passed_over(tmp_path: Path, text: str) -> None:
    (tmp_path / "clock").write_text(text)
    assert kept_time_ms(tmp_path) == 0


def test_a_time_that_cannot_be_read_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "clock").write_bytes(b"\xff\xfe")
    assert kept_time_ms(tmp_path) == 0
    (tmp_path / "clock").unlink()
    (tmp_path / "clock").mkdir()
    assert kept_time_ms(tmp_path) == 0


DAY_MS = 86_400_000


def warned(clock: Clock, newest_ms: int) -> list[Any]:
    with structlog.testing.capture_logs() as logs:
        warn_if_ahead(clock, newest_ms, Path("data"))
    return logs


def test_a_time_far_ahead_of_the_wall_is_told_with_its_cause() -> None:
    now_ms = wall_ms()
    assert warned(Clock.start(now_ms + DAY_MS // 2, 1.0), now_ms) == []
    assert warned(Clock.start(now_ms + 3 * DAY_MS, 10.0), now_ms) == [], "a fast clock runs ahead"
    (of_file,) = warned(Clock.start(now_ms + 3 * DAY_MS, 1.0), now_ms)
    assert "clock says so" in of_file["because"]
    assert "delete that file" in of_file["hint"]
    newest_ms = now_ms + 3 * DAY_MS
    (of_events,) = warned(Clock.start(newest_ms, 1.0), newest_ms)
    assert "newest event" in of_events["because"]
    assert of_events["hours"] in (71, 72)


async def test_time_is_kept_again_once_the_disk_takes_it(tmp_path: Path) -> None:
    data = tmp_path / "data"  # not there yet: writing fails
    clock = Clock.start(0, 1.0)
    with structlog.testing.capture_logs() as logs:
        keeping = asyncio.create_task(keep_time(data, clock, every_s=0.0))
        while not logs:
            await asyncio.sleep(0)
        data.mkdir()
        while not (data / "clock").exists():
            await asyncio.sleep(0)
        keeping.cancel()
    assert [line["event"] for line in logs] == ["time is not kept"]
    assert kept_time_ms(data) > 0


steps = st.tuples(st.integers(0, 4 * DAY_MS), st.booleans())  # the wall, and whether it restarts


@given(st.lists(steps, min_size=1, max_size=8))
@settings(max_examples=25, deadline=None)
def test_whatever_the_wall_does_the_past_stays_in_order(steps: list[tuple[int, bool]]) -> None:
    """Commands and restarts with clocks that jump: times rise, log times strictly, asOf agrees."""
    with TemporaryDirectory() as name:
        folder = Path(name) / "ledger"
        for _, run in itertools.groupby(enumerate(steps), lambda step: _restarts(steps, step[0])):
            ledger = FileLedger.open(folder)
            fleet = restore(folder, folder)
            for number, (wall_ms, _) in run:
                handler = Handler(fleet, ledger, partial(int, wall_ms), partial(str, number))
                handler.handle(_scene(number, wall_ms))
            ledger.close()
        events = list(read_folder(folder, 0))
        at = [event.at_ms for event in events]
        assert at == sorted(at)
        times: list[int] = []
        for path in sorted(folder.glob("*.mcap")):
            with path.open("rb") as file:
                messages = make_reader(file).iter_messages(log_time_order=False)
                times += [message.log_time for _, _, message in messages]
        assert all(a < b for a, b in itertools.pairwise(times))
        moments = Moments(Path(name))
        for at_ms in {*at, *(wall_ms for wall_ms, _ in steps)}:
            due = sum(1 for each in at if each <= at_ms)
            assert moments.fleet(At(at_ms=at_ms)).position == due


def _restarts(steps: list[tuple[int, bool]], number: int) -> int:
    return sum(restart for _, restart in steps[: number + 1])


def _scene(number: int, at_ms: int) -> CreateScene:
    id_ = SceneId(f"{number:024X}")
    name = f"scene {number}"
    return CreateScene(id=CommandId(name), by="alice", at_ms=at_ms, scene=id_, name=name)
