import shutil
from pathlib import Path

import pytest

from ledger.evolve import fold
from ledger.segment import BEGINNING, TRAILER_BYTES
from ledger.snapshot import save
from ledger.state import Fleet
from ledger.store import FileLedger
from ledger.verify import Verdict, verify
from tests.histories import history
from tests.ledger.folders import in_threes, killed, written

EVENTS = history(41, 30)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder of five segments, two commits each, and two snapshots."""
    folder = tmp_path_factory.mktemp("sound")
    written(folder / "ledger", in_threes(EVENTS), segment_chunks_max=2)
    for position in (10, 20):
        save(folder / "snapshots", fold(Fleet(), EVENTS[:position]))
    return folder


@pytest.fixture
def data(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "data"))


def one_finding(verdict: Verdict) -> tuple[str, str]:
    (finding,) = verdict.findings
    assert finding.damage and not verdict.sound
    assert finding.advice
    return finding.path.name, finding.what


def test_a_sound_folder_is_counted_and_nothing_found(data: Path) -> None:
    progress: list[tuple[int, int]] = []
    verdict = verify(data, lambda done, total: progress.append((done, total)))
    assert verdict == Verdict(
        segments=5, sealed=0, chunks=10, events=30, snapshots=2, position=30, findings=()
    )
    assert verdict.sound
    files = [p for p in data.rglob("*") if p.suffix in (".mcap", ".snapshot")]
    total = sum(path.stat().st_size for path in files)
    assert progress[-1] == (total, total)
    assert len(progress) == 6, "after each segment, and after the snapshots"


def test_a_folder_without_a_ledger_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        verify(tmp_path)


@pytest.mark.parametrize("first", [1, 7, 13, 19, 25])
def test_every_wrong_bit_in_a_segment_is_found(data: Path, first: int) -> None:
    path = data / "ledger" / f"{first:020}.mcap"
    raw = path.read_bytes()
    for offset in range(first % 7, len(raw), 397):
        wrong = bytearray(raw)
        wrong[offset] ^= 1 << (offset % 8)
        path.write_bytes(wrong)
        verdict = verify(data)
        # the trailer of the newest segment alone may be missing: the next start writes it anew
        newest = first == 25 and offset >= len(raw) - TRAILER_BYTES
        assert verdict.findings
        assert newest or not verdict.sound
        assert verdict.findings[0].path == path


def test_a_missing_segment_is_found(data: Path) -> None:
    (data / "ledger" / f"{13:020}.mcap").unlink()
    whats = [finding.what for finding in verify(data).findings]
    assert whats == [
        "position 13 is missing before it",
        "it does not follow the segment before it: the hashes differ",
    ]


def test_a_missing_newest_segment_is_found_by_a_snapshot_ahead_of_it(data: Path) -> None:
    save(data / "snapshots", fold(Fleet(), EVENTS))
    (data / "ledger" / f"{25:020}.mcap").unlink()
    name, what = one_finding(verify(data))
    assert name == f"{30:020}.snapshot"
    assert what == "the ledger ends at position 24, but here is the state after it"


def test_a_renamed_segment_is_found(data: Path) -> None:
    (data / "ledger" / f"{13:020}.mcap").rename(data / "ledger" / "copy.mcap")
    verdict = verify(data)
    assert [finding.what for finding in verdict.findings] == [
        "its name is not a first position of 20 digits",
        "position 13 is missing before it",
        "it does not follow the segment before it: the hashes differ",
    ]
    assert verdict.findings[0].path.name == "copy.mcap"


def test_a_damaged_snapshot_is_found(data: Path) -> None:
    path = data / "snapshots" / f"{20:020}.snapshot"
    raw = path.read_bytes()
    for wrong in (raw[:-1], b"", b"x" + raw[1:], raw[:-9] + bytes([raw[-9] ^ 4]) + raw[-8:]):
        path.write_bytes(wrong)
        assert one_finding(verify(data))[0] == path.name


def test_a_torn_tail_is_told_but_is_no_damage(tmp_path: Path) -> None:
    raw, ends = killed(tmp_path / "whole", in_threes(EVENTS))
    folder = tmp_path / "data" / "ledger"
    folder.mkdir(parents=True)
    (folder / f"{1:020}.mcap").write_bytes(raw[: ends[4] + 77])
    verdict = verify(tmp_path / "data")
    (finding,) = verdict.findings
    assert verdict.sound and not finding.damage
    assert (finding.offset, finding.position, verdict.events) == (ends[4], 16, 15)


def test_damage_before_a_whole_commit_of_a_live_segment_is_found(tmp_path: Path) -> None:
    raw, ends = killed(tmp_path / "whole", in_threes(EVENTS))
    folder = tmp_path / "data" / "ledger"
    folder.mkdir(parents=True)
    wrong = bytearray(raw)
    wrong[ends[4] + 77] ^= 1
    (folder / f"{1:020}.mcap").write_bytes(wrong)
    assert not verify(tmp_path / "data").sound


def test_a_server_may_be_running(tmp_path: Path) -> None:
    ledger = FileLedger.open(tmp_path / "ledger")
    assert verify(tmp_path) == Verdict(
        segments=0, sealed=0, chunks=0, events=0, snapshots=0, position=0, findings=()
    )
    assert ledger.wait(ledger.append(EVENTS, 0), 30)
    assert verify(tmp_path) == Verdict(
        segments=1, sealed=0, chunks=1, events=30, snapshots=0, position=30, findings=()
    )
    ledger.close()
    assert verify(tmp_path).sound
    assert (tmp_path / "ledger" / f"{1:020}.mcap").read_bytes().startswith(BEGINNING)
