import contextlib
import errno
import os
import shutil
from pathlib import Path
from random import Random

import pytest

from ledger.disk import Disk
from ledger.errors import LedgerDamaged, LedgerLocked, NotSealed
from ledger.lock import Lock
from ledger.measure import trailer_of
from ledger.scan import read_folder
from ledger.seal import LOCK_NAME, Sealed, seal, seal_folder, unsealed
from ledger.sealed import BEGINNING as SEALED_BEGINNING
from ledger.sealed import is_sealed
from ledger.segment import BEGINNING, TRAILER_BYTES
from ledger.store import FileLedger
from ledger.verify import verify
from tests.histories import history
from tests.laws.crash.disk import Crashed, FaultyDisk, Trouble
from tests.ledger.folders import commit_each, in_threes, written

EVENTS = history(31, 60)


@pytest.fixture(scope="module")
def rolled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five segments of four commits of three events."""
    folder = tmp_path_factory.mktemp("rolled")
    written(folder, in_threes(EVENTS), segment_chunks_max=4)
    assert len(list(folder.glob("*.mcap"))) == 5
    return folder


@pytest.fixture
def folder(rolled: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(rolled, tmp_path / "ledger"))


def sealed_names(folder: Path) -> list[str]:
    names = []
    for path in sorted(folder.glob("*.mcap")):
        with path.open("rb") as file:
            if is_sealed(file):
                names.append(path.stem.lstrip("0"))
    return names


def test_all_segments_but_the_newest_are_sealed_and_read_as_before(folder: Path) -> None:
    trailers = [trailer_of(path) for path in sorted(folder.glob("*.mcap"))]
    done = list(seal_folder(Disk(), folder))
    assert (
        [d.path.stem.lstrip("0") for d in done] == sealed_names(folder) == ["1", "13", "25", "37"]
    )
    assert [d.events for d in done] == [12] * 4
    assert all(d.bytes_after == d.path.stat().st_size < d.bytes_before for d in done)
    assert list(read_folder(folder)) == EVENTS
    assert [trailer_of(path) for path in sorted(folder.glob("*.mcap"))] == trailers
    assert not list(folder.glob("*.tmp"))
    verdict = verify(folder.parent)
    assert verdict.sound and not verdict.findings
    assert (verdict.segments, verdict.sealed, verdict.events) == (5, 4, 60)


def test_every_stretch_reads_alike_from_live_and_sealed_segments(folder: Path) -> None:
    list(seal_folder(Disk(), folder))
    ledger = FileLedger.open(folder)
    for after in range(0, 60, 5):
        for until in (None, after, after + 1, after + 14, 60, 99):
            expected = EVENTS[after:until]
            assert list(read_folder(folder, after, until)) == expected
            assert list(ledger.read(after, until)) == expected
    ledger.close()


def test_a_ledger_goes_on_after_its_newest_segment_was_sealed(folder: Path) -> None:
    """Nobody seals the newest; but the ones after it may be gone, or a backup hold no more."""
    list(seal_folder(Disk(), folder))
    (folder / f"{49:020}.mcap").unlink()
    ledger = FileLedger.open(folder)
    assert ledger.position == 48
    commit_each(ledger, in_threes(EVENTS[48:]))
    ledger.close()
    assert list(read_folder(folder)) == EVENTS
    assert verify(folder.parent).sound


def test_a_crash_before_a_first_commit_behind_a_sealed_segment_loses_nothing(folder: Path) -> None:
    list(seal_folder(Disk(), folder))
    (folder / f"{49:020}.mcap").write_bytes(BEGINNING + b"\x06torn")
    ledger = FileLedger.open(folder)
    commit_each(ledger, in_threes(EVENTS[48:]))
    ledger.close()
    assert list(read_folder(folder)) == EVENTS
    assert verify(folder.parent).sound


def test_what_is_sealed_is_not_sealed_again(folder: Path) -> None:
    list(seal_folder(Disk(), folder))
    before = {path.name: path.read_bytes() for path in folder.glob("*.mcap")}
    assert unsealed(folder) == []
    assert list(seal_folder(Disk(), folder)) == []
    assert {path.name: path.read_bytes() for path in folder.glob("*.mcap")} == before


class DyingDisk(Disk):
    """The nth thing asked of it fails; who is dead then does not even tidy up."""

    def __init__(self, nth: int, dead: bool, after: bool) -> None:
        self.left = nth
        self.failed = False
        self._dead = dead
        self._after = after  # it was done all the same

    def _step(self) -> None:
        self.left -= 1
        if self.left == 0 or (self.failed and self._dead):
            self.failed = True
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    def create(self, path: Path) -> int:
        self._step()
        return super().create(path)

    def write(self, fd: int, data: bytes | memoryview) -> int:
        if self.left == 1:
            super().write(fd, memoryview(data)[: len(data) // 2])
        self._step()
        return super().write(fd, data)

    def sync(self, fd: int) -> None:
        self._step()
        super().sync(fd)

    def settle(self, path: Path) -> None:
        self._step()
        super().settle(path)

    def rename(self, source: Path, target: Path) -> None:
        if self.left == 1 and self._after:
            source.rename(target)
        self._step()
        super().rename(source, target)

    def remove(self, path: Path) -> None:
        self._step()
        super().remove(path)


@pytest.mark.parametrize("dead", [False, True])
@pytest.mark.parametrize("after", [False, True])
def test_whatever_fails_while_sealing_nothing_is_lost(
    folder: Path, dead: bool, after: bool
) -> None:
    path = folder / f"{13:020}.mcap"
    live, steps = path.read_bytes(), 0
    while True:
        steps += 1
        disk = DyingDisk(steps, dead, after)
        try:
            assert isinstance(seal(disk, path), Sealed)
            break
        except OSError:
            assert disk.failed
        assert list(read_folder(folder)) == EVENTS
        assert dead or not list(folder.glob("*.tmp"))
        FileLedger.open(folder).close()
        assert not list(folder.glob("*.tmp")), "a draft is removed at open"
        assert verify(folder.parent).sound
        path.write_bytes(live)
    assert steps > 6
    assert list(read_folder(folder)) == EVENTS


@pytest.mark.parametrize("seed", range(40))
def test_a_crash_or_a_power_cut_while_sealing_loses_nothing(tmp_path: Path, seed: int) -> None:
    rng, folder = Random(seed), tmp_path / "ledger"
    disk = FaultyDisk(tmp_path, rng)
    written(folder, in_threes(EVENTS), segment_chunks_max=4, disk=disk, threaded=False)
    for _ in range(4):
        disk.live(Trouble(rng, soon=rng.random() < 0.5))
        with contextlib.suppress(Crashed):
            list(seal_folder(disk, folder, failed=lambda path, trouble: None))
        disk.live(None)
        assert list(read_folder(folder)) == EVENTS
        ledger = FileLedger.open(folder, disk=disk, threaded=False)
        assert list(ledger.read(0)) == EVENTS
        ledger.close()
        assert not list(folder.glob("*.tmp"))
    assert verify(tmp_path).sound
    assert not disk.broken_rules


def test_a_draft_left_behind_does_not_stop_the_next_sealing(folder: Path) -> None:
    path = folder / f"{13:020}.mcap"
    (folder / f"{path.name}.sealing.tmp").write_bytes(b"half a dra")
    assert seal(Disk(), path) is not None
    assert not list(folder.glob("*.tmp"))


class FlippingDisk(Disk):
    """Writes one wrong bit into the nth byte that it is given."""

    def __init__(self, byte: int) -> None:
        self._left = byte

    def write(self, fd: int, data: bytes | memoryview) -> int:
        wrong = bytearray(data)
        if 0 <= self._left < len(wrong):
            wrong[self._left] ^= 0x20
        self._left -= len(wrong)
        return super().write(fd, wrong)


def test_a_draft_that_is_not_what_was_meant_never_takes_the_place(folder: Path) -> None:
    path = folder / f"{13:020}.mcap"
    live = path.read_bytes()
    size = seal(Disk(), path)
    assert size is not None
    for byte in range(0, size.bytes_after, 97):
        path.write_bytes(live)
        with pytest.raises(NotSealed):
            seal(FlippingDisk(byte), path)
        assert path.read_bytes() == live
        assert not list(folder.glob("*.tmp"))


def test_a_damaged_segment_is_not_sealed_and_said_as_verify_says_it(folder: Path) -> None:
    path = folder / f"{13:020}.mcap"
    live = path.read_bytes()
    for offset in (3, len(BEGINNING) + 9, 700, len(live) - TRAILER_BYTES + 40, len(live) - 60):
        wrong = bytearray(live)
        wrong[offset] ^= 1
        path.write_bytes(wrong)
        with pytest.raises(LedgerDamaged) as caught:
            seal(Disk(), path)
        assert path.read_bytes() == wrong
        (first, *_) = verify(folder.parent).findings
        assert (caught.value.path, caught.value.offset) == (first.path, first.offset)
        assert caught.value.what == first.what


def test_who_stops_it_finds_the_segment_as_it_was(folder: Path) -> None:
    before = {path.name: path.read_bytes() for path in folder.glob("*.mcap")}
    assert list(seal_folder(Disk(), folder, lambda: True)) == []
    assert {path.name: path.read_bytes() for path in folder.glob("*.mcap")} == before
    assert not list(folder.glob("*.tmp"))


def test_two_sealers_never_work_in_one_folder(folder: Path) -> None:
    lock = Lock(folder, LOCK_NAME)
    with pytest.raises(LedgerLocked):
        list(seal_folder(Disk(), folder))
    lock.close()
    assert len(list(seal_folder(Disk(), folder))) == 4


def test_who_began_to_read_reads_on_while_segments_are_swapped(tmp_path: Path) -> None:
    ledger = FileLedger.open(tmp_path, segment_chunks_max=4)
    commit_each(ledger, in_threes(EVENTS[:36]))
    reading, others = ledger.read(0), read_folder(tmp_path)
    got = [next(reading) for _ in range(13)]  # the newest segment is still to come
    theirs = [next(others) for _ in range(13)]
    commit_each(ledger, in_threes(EVENTS[36:]))
    assert len(list(seal_folder(Disk(), tmp_path))) == 4
    assert [*got, *reading] == EVENTS[:36]
    assert [*theirs, *others] == EVENTS[:36]
    assert list(ledger.read(0)) == EVENTS
    ledger.close()


def test_a_stretch_of_a_sealed_segment_is_read_without_what_lies_before(tmp_path: Path) -> None:
    events = history(32, 6_000)
    path = written(tmp_path, [events[n : n + 600] for n in range(0, 6_000, 600)])
    assert seal(Disk(), path) is not None
    wrong = bytearray(path.read_bytes())
    wrong[500] ^= 1  # in the first of two chunks
    path.write_bytes(wrong)
    assert list(read_folder(tmp_path, 5_900, 5_910)) == events[5_900:5_910]
    words = f"byte {len(SEALED_BEGINNING)}, position 1: a chunk's CRC is wrong"
    with pytest.raises(LedgerDamaged, match=words):
        list(read_folder(tmp_path, 0, 3))
