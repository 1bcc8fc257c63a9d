import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader

from ledger.errors import LedgerDamaged
from ledger.evolve import fold
from ledger.scan import read_folder
from ledger.segment import BEGINNING, TRAILER_BYTES
from ledger.snapshot import save
from ledger.state import Fleet
from ledger.store import FileLedger
from tests.histories import history
from tests.ledger.folders import commit_each, in_threes, killed, written

EVENTS = history(11, 30)
ONE = "00000000000000000001.mcap"


@pytest.fixture(scope="module")
def crashed(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[int]]:
    """The segment of ten commits of three events, not finished, and where each commit ends."""
    return killed(tmp_path_factory.mktemp("crashed"), in_threes(EVENTS))


def reopened(folder: Path, raw: bytes) -> FileLedger:
    folder.mkdir(exist_ok=True)
    (folder / ONE).write_bytes(raw)
    return FileLedger.open(folder)


def check_goes_on(ledger: FileLedger, folder: Path, commits: int) -> None:
    """It holds so many commits, accepts more, and is then sound for us and for others."""
    assert ledger.position == ledger.durable == 3 * commits
    assert list(ledger.read(0)) == EVENTS[: 3 * commits]
    commit_each(ledger, in_threes(EVENTS[3 * commits :]))
    ledger.close()
    assert list(read_folder(folder)) == EVENTS
    others = 0
    for path in folder.glob("*.mcap"):
        with path.open("rb") as file:
            others += len(list(make_reader(file, validate_crcs=True).iter_messages()))
    assert others == len(EVENTS)


def test_a_killed_ledger_loses_nothing(tmp_path: Path, crashed: tuple[bytes, list[int]]) -> None:
    check_goes_on(reopened(tmp_path, crashed[0]), tmp_path, 10)
    assert not list(tmp_path.glob("*.torn-*"))


TAILS: dict[str, Callable[[bytes], bytes]] = {
    "zeros": lambda rest: bytes(len(rest) + 700),
    "garbage": lambda rest: (b"\x06\x05garbage" * 99)[: len(rest) + 50],
    "half": lambda rest: rest[: len(rest) // 2],
    "a zeroed sector": lambda rest: rest[:60] + bytes(100) + rest[160:],
    "its first bytes missing": lambda rest: bytes(40) + rest[40:],
    "all but a byte": lambda rest: rest[:-1],
    "one bit wrong": lambda rest: rest[:-9] + bytes([rest[-9] ^ 1]) + rest[-8:],
}


@pytest.mark.parametrize("tail", TAILS)
@pytest.mark.parametrize("commits", [0, 1, 6, 9])
def test_a_torn_last_commit_is_kept_aside_and_cut(
    tmp_path: Path, crashed: tuple[bytes, list[int]], commits: int, tail: str
) -> None:
    raw, ends = crashed
    starts = [len(BEGINNING), *ends]
    whole, rest = raw[: starts[commits]], raw[starts[commits] : starts[commits + 1]]
    torn = TAILS[tail](rest)
    ledger = reopened(tmp_path, whole + torn)
    (aside,) = tmp_path.glob("*.torn-*")
    assert (aside.name, aside.read_bytes()) == (f"{ONE}.torn-1", torn)
    check_goes_on(ledger, tmp_path, commits)


def test_a_second_torn_tail_does_not_replace_the_first(
    tmp_path: Path, crashed: tuple[bytes, list[int]]
) -> None:
    raw, ends = crashed
    for commits in (1, 2, 3):
        reopened(tmp_path, raw[: ends[commits] - 5]).close()
    sizes = [path.stat().st_size for path in sorted(tmp_path.glob("*.torn-*"))]
    assert sizes == [ends[n] - 5 - ends[n - 1] for n in (1, 2, 3)]


@pytest.mark.parametrize("commit", range(9))
def test_a_wrong_bit_before_a_whole_commit_is_damage(
    tmp_path: Path, crashed: tuple[bytes, list[int]], commit: int
) -> None:
    raw, ends = crashed
    starts = [len(BEGINNING), *ends]
    size = starts[commit + 1] - starts[commit]
    for offset in (0, 3, 20, 30, 36, 45, 49, 70, size // 2, size - 1):
        wrong = bytearray(raw)
        wrong[starts[commit] + offset] ^= 0x10
        # what a whole chunk says is under its CRC; only its head may be torn
        words = "and a whole commit follows|times are not those of its messages"
        with pytest.raises(LedgerDamaged, match=words) as caught:
            reopened(tmp_path, bytes(wrong))
        assert caught.value.position is not None
        assert 3 * commit < caught.value.position <= 3 * commit + 3
        assert (tmp_path / ONE).read_bytes() == wrong, "refusing changes nothing"


def test_a_whole_last_commit_that_contradicts_itself_is_damage_not_a_torn_tail(
    tmp_path: Path, crashed: tuple[bytes, list[int]]
) -> None:
    raw, ends = crashed
    wrong = bytearray(raw)
    wrong[ends[8] + 10] ^= 1  # the first log time, in a chunk whose CRC is right
    with pytest.raises(LedgerDamaged, match="times are not those of its messages"):
        reopened(tmp_path, bytes(wrong))
    assert (tmp_path / ONE).read_bytes() == wrong


def test_a_commit_taken_out_of_the_middle_is_damage(
    tmp_path: Path, crashed: tuple[bytes, list[int]]
) -> None:
    raw, ends = crashed
    with pytest.raises(LedgerDamaged, match="message 15 stands where 12 is due"):
        reopened(tmp_path, raw[: ends[3]] + raw[ends[4] :])


def test_an_unchecked_crc_is_refused(tmp_path: Path, crashed: tuple[bytes, list[int]]) -> None:
    raw, ends = crashed
    wrong = bytearray(raw)
    wrong[ends[3] + 33 : ends[3] + 37] = bytes(4)
    with pytest.raises(LedgerDamaged, match="CRC is wrong"):
        reopened(tmp_path, bytes(wrong))


def test_a_foreign_header_is_damage(tmp_path: Path, crashed: tuple[bytes, list[int]]) -> None:
    wrong = bytearray(crashed[0])
    wrong[30] ^= 1
    with pytest.raises(LedgerDamaged, match="header"):
        reopened(tmp_path, bytes(wrong))


def test_a_crash_while_finishing_loses_nothing(
    tmp_path: Path, crashed: tuple[bytes, list[int]]
) -> None:
    newest = written(tmp_path / "whole", in_threes(EVENTS))
    raw = newest.read_bytes()
    assert raw.startswith(crashed[0])
    for cut in range(0, TRAILER_BYTES + 1, 9):
        folder = tmp_path / str(cut)
        check_goes_on(reopened(folder, raw[: len(raw) - cut]), folder, 10)


def test_a_crash_while_making_a_segment_loses_nothing(tmp_path: Path) -> None:
    written(tmp_path, in_threes(EVENTS[:6]))
    (tmp_path / "00000000000000000007.mcap.tmp").write_bytes(BEGINNING[:9])
    ledger = FileLedger.open(tmp_path)
    check_goes_on(ledger, tmp_path, 2)
    assert not list(tmp_path.glob("*.tmp"))


@pytest.mark.parametrize("torn", [b"", b"\x06torn"])
def test_a_crash_before_a_segments_first_commit_loses_nothing(tmp_path: Path, torn: bytes) -> None:
    written(tmp_path, in_threes(EVENTS[:6]))
    (tmp_path / "00000000000000000007.mcap").write_bytes(BEGINNING + torn)
    check_goes_on(FileLedger.open(tmp_path), tmp_path, 2)
    only = tmp_path / "only"
    check_goes_on(reopened(only, BEGINNING + torn), only, 0)


@pytest.fixture(scope="module")
def rolled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rolled")
    written(folder, in_threes(EVENTS), segment_chunks_max=2)
    assert len(list(folder.glob("*.mcap"))) == 5
    return folder


@pytest.fixture
def folder(rolled: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(rolled, tmp_path / "ledger"))


@pytest.mark.parametrize("missing", [1, 7, 13, 19])
def test_a_missing_segment_is_damage(folder: Path, missing: int) -> None:
    (folder / f"{missing:020}.mcap").unlink()
    with pytest.raises(LedgerDamaged, match=f"position {missing} is missing"):
        FileLedger.open(folder)
    with pytest.raises(LedgerDamaged, match="missing"):
        list(read_folder(folder))


def test_a_renamed_segment_is_damage(folder: Path) -> None:
    path = folder / f"{13:020}.mcap"
    for name in ("backup.mcap", f"{14:020}.mcap", f"{8:020}.mcap", f"{99:020}.mcap"):
        path.rename(folder / name)
        with pytest.raises(LedgerDamaged):
            FileLedger.open(folder)
        (folder / name).rename(path)
    FileLedger.open(folder).close()


def test_a_segment_cut_short_is_damage_unless_it_is_the_newest(folder: Path) -> None:
    for first in (1, 7, 13, 19):
        path = folder / f"{first:020}.mcap"
        raw = path.read_bytes()
        for cut in (1, TRAILER_BYTES, TRAILER_BYTES + 30, len(raw) - len(BEGINNING)):
            path.write_bytes(raw[:-cut])
            with pytest.raises(LedgerDamaged, match="no trailer"):
                FileLedger.open(folder)
            with pytest.raises(LedgerDamaged):
                list(read_folder(folder))
        path.write_bytes(raw)
    FileLedger.open(folder).close()


def test_a_segment_of_another_ledger_is_damage(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    written(other, in_threes(history(12, 30)), segment_chunks_max=2)
    name = f"{13:020}.mcap"
    shutil.copy(other / name, folder / name)
    with pytest.raises(LedgerDamaged, match="hashes differ"):
        FileLedger.open(folder)


def test_a_finished_newest_segment_that_is_not_what_it_says_is_damage(folder: Path) -> None:
    path = folder / f"{25:020}.mcap"
    raw = path.read_bytes()
    for offset in (len(BEGINNING) + 8, len(BEGINNING) + 300, len(raw) - TRAILER_BYTES - 5):
        wrong = bytearray(raw)
        wrong[offset] ^= 1
        path.write_bytes(wrong)
        with pytest.raises(LedgerDamaged):
            FileLedger.open(folder)
        assert path.read_bytes() == wrong


def test_every_segment_is_checked_at_start_and_when_it_is_read(folder: Path) -> None:
    path = folder / f"{7:020}.mcap"
    right = path.read_bytes()
    wrong = bytearray(right)
    wrong[len(BEGINNING) + 300] ^= 1
    words = f"{7:020}.mcap, byte {len(BEGINNING)}, position 7: a chunk's CRC is wrong"
    path.write_bytes(wrong)
    with pytest.raises(LedgerDamaged, match=words):
        FileLedger.open(folder)
    path.write_bytes(right)
    ledger = FileLedger.open(folder)
    path.write_bytes(wrong)
    with pytest.raises(LedgerDamaged, match=words):
        list(ledger.read(0))
    assert list(ledger.read(12)) == EVENTS[12:]
    ledger.close()


def test_progress_of_a_start_ends_with_all_bytes(folder: Path) -> None:
    told: list[tuple[int, int]] = []
    FileLedger.open(folder, progress=lambda done, total: told.append((done, total))).close()
    total = sum(path.stat().st_size for path in folder.glob("*.mcap"))
    assert told[-1] == (total, total) and len(told) == 5


def test_a_segment_that_was_never_finished_is_not_taken_for_another(
    tmp_path: Path, crashed: tuple[bytes, list[int]]
) -> None:
    """A copy of an unfinished segment has no trailer that would tell, but its events do."""
    written(tmp_path, in_threes(EVENTS))
    copy = tmp_path / f"{31:020}.mcap"
    copy.write_bytes(crashed[0])
    with pytest.raises(LedgerDamaged, match="an event at 31 says that it is at 1"):
        FileLedger.open(tmp_path)
    assert copy.read_bytes() == crashed[0], "refusing changes nothing"


def test_a_ledger_that_ends_before_its_snapshots_is_damage(folder: Path, tmp_path: Path) -> None:
    snapshots = tmp_path / "snapshots"
    path = save(snapshots, fold(Fleet(), EVENTS))
    FileLedger.open(folder, snapshots=snapshots).close()
    (folder / f"{25:020}.mcap").unlink()
    words = "the ledger ends at position 24, but here is the state after it"
    with pytest.raises(LedgerDamaged, match=words) as caught:
        FileLedger.open(folder, snapshots=snapshots)
    assert "Restore the newest segments" in caught.value.hint
    path.write_bytes(path.read_bytes()[:-1])  # a damaged one says nothing: it is a cache
    FileLedger.open(folder, snapshots=snapshots).close()
