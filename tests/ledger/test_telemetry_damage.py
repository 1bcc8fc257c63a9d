"""Damage and full disks cost telemetry, and never give wrong telemetry."""

import errno
import io
import math
import tempfile
from pathlib import Path
from typing import IO, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typing_extensions import Buffer

from ledger.ids import RobotName
from ledger.telemetry import (
    TelemetryLog,
    plans_at,
    read_plans,
    read_telemetry,
    reports_at,
)
from ledger.telemetry_format import files
from tests.ledger.driving import SCENE, T0, drive, plan, report


def blank(folder: Path, cut: int, length: int) -> None:
    """Make some bytes of the one file zeros."""
    [(_, path)] = files(folder)
    content = bytearray(path.read_bytes())
    at = 8 + cut % (len(content) - 8)
    content[at : at + length] = bytes(min(length, len(content) - at))
    path.write_bytes(content)


@given(cut=st.integers(0, 1 << 20), flip=st.booleans())
@settings(max_examples=60, deadline=None)
def test_a_torn_or_damaged_file_reads_as_far_as_it_is_whole(cut: int, flip: bool) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = TelemetryLog(folder)
        said = {(r.robot, r.at_ms): r for r in drive(log, seconds=4)}
        log.close()
        [(_, path)] = files(folder)
        content = bytearray(path.read_bytes())
        at = 8 + cut % (len(content) - 8)
        if flip:
            content[at] ^= 0x40
        else:
            del content[at:]
        path.write_bytes(content)
        for found in read_telemetry(folder, SCENE, T0, T0 + 5_000):
            assert found == said[found.robot, found.at_ms]
        reports_at(folder, SCENE, T0 + 4_000)


@given(cut=st.integers(0, 1 << 20), length=st.integers(1, 2_000))
@settings(max_examples=40, deadline=None)
def test_steps_are_not_counted_over_a_batch_that_is_missing(cut: int, length: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = TelemetryLog(folder, chunk_ms=200)
        said = {}
        for tick in range(60):
            reports = [report(f"R{n}", T0 + tick * 200, (tick + n) ** 2 % 23 / 4) for n in range(3)]
            log.write(reports)
            said.update({(r.robot, r.at_ms): r for r in reports})
        log.close()
        blank(folder, cut, length)
        for found in read_telemetry(folder, SCENE, T0, T0 + 60_000):
            assert found == said[found.robot, found.at_ms]
        for second in range(13):
            for found in reports_at(folder, SCENE, T0 + second * 1_000).values():
                assert found == said[found.robot, found.at_ms]


@given(cut=st.integers(0, 1 << 20), length=st.integers(1, 4_000))
@settings(max_examples=60, deadline=None)
def test_damage_costs_plans_and_never_gives_wrong_ones(cut: int, length: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = TelemetryLog(folder, chunk_ms=200)
        said = {}
        for tick in range(60):
            plans = [plan(f"R{n}", T0 + tick * 200, float((tick + n) % 9)) for n in range(4)]
            log.write_plans(plans)
            said.update({(p.robot, p.at_ms): p for p in plans})
        log.close()
        blank(folder, cut, length)
        for found in read_plans(folder, SCENE, T0, T0 + 60_000):
            assert found == said[found.robot, found.at_ms]
        for second in range(13):
            for found in plans_at(folder, SCENE, T0 + second * 1_000).values():
                assert found == said[found.robot, found.at_ms]


class Full(io.FileIO):
    """A file on a disk that is full after so many bytes, and then is not full any more."""

    def __init__(self, path: Path, room: int) -> None:
        super().__init__(path, "x")
        self._room = room

    def write(self, data: Buffer) -> int:
        some = bytes(data)[: self._room]
        self._room -= len(some)
        super().write(some)
        if len(some) < len(bytes(data)):
            raise OSError(errno.ENOSPC, "no space left on device")
        return len(some)


@pytest.mark.parametrize("room", [0, 10, 1_000, 2_000, 3_000, 4_000])
def test_a_full_disk_costs_telemetry_only_and_it_comes_back(tmp_path: Path, room: int) -> None:
    rooms = [room]

    def opened(path: Path) -> IO[bytes]:
        return cast("IO[bytes]", Full(path, rooms.pop())) if rooms else path.open("xb")

    log = TelemetryLog(tmp_path, opened=opened)
    said = {(r.robot, r.at_ms): r for r in drive(log, seconds=30)}
    said |= {(r.robot, r.at_ms): r for r in drive(log, seconds=5, start_ms=T0 + 100_000)}
    log.close()
    assert len(files(tmp_path)) == 2
    for found in read_telemetry(tmp_path, SCENE, T0, T0 + 200_000):
        assert math.isclose(found.x_m, said[found.robot, found.at_ms].x_m, abs_tol=0.0005001)
    assert reports_at(tmp_path, SCENE, T0 + 104_000)[RobotName("R0")].at_ms == T0 + 104_000
