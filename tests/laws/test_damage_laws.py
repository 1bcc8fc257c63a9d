"""Whatever happens to a ledger's bytes or files: it is found, said alike, and never read as right.

`verify`, the start of a server, and a reader look at each damaged folder. Where a reader gives
anything, it is a prefix of what was written. Where `verify` finds damage, the start refuses with
the same words; where it starts, only a tail was torn that nobody can tell from an unacknowledged
commit, and what it goes on with is a prefix too.
"""

import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import msgspec
import pytest
from structlog.testing import capture_logs

from ledger import mcap_records as mcap
from ledger import sealed
from ledger.chunks import Chunk, chunk_at
from ledger.damage import Inspection
from ledger.disk import Disk
from ledger.errors import LedgerDamaged
from ledger.events import AnyEvent, SignedOut
from ledger.evolve import fold
from ledger.ids import SceneId
from ledger.measure import measure, sound_end
from ledger.recovery import Recovered, recover
from ledger.scan import read_folder
from ledger.seal import seal, unsealed
from ledger.segment import BEGINNING, TRAILER_BYTES, read_trailer, segment_name
from ledger.snapshot import save
from ledger.state import Fleet
from ledger.store import FileLedger
from ledger.verify import Verdict, verify
from tests.histories import history
from tests.ledger.folders import in_threes, killed, written

FOREIGN = "it does not follow the segment before it: the hashes differ"
UNFIT = "its trailer does not fit its content"


class Hasty(Disk):
    """Does not wait for the medium, for thousands of folders are opened here."""

    def sync(self, fd: int) -> None:
        pass

    def settle(self, path: Path) -> None:
        pass

    def sync_folder(self, folder: Path) -> None:
        pass


DISK = Hasty()


def small(count: int) -> list[AnyEvent]:
    """Events with a short schema, so that a ledger of them has few bits."""
    return [
        SignedOut(position=n + 1, at_ms=n // 2, scene=SceneId("s"), user="u") for n in range(count)
    ]


def starts(data: Path) -> Recovered | LedgerDamaged:
    """What a server does with the folder, which it may mend."""
    try:
        return recover(DISK, data / "ledger", data / "snapshots")
    except LedgerDamaged as error:
        return error


def reads(data: Path) -> list[AnyEvent]:
    """What a reader gets before it raises."""
    got: list[AnyEvent] = []
    try:
        for event in read_folder(data / "ledger"):
            got.append(event)
    except LedgerDamaged:
        pass
    return got


def check(data: Path, events: list[AnyEvent], what: str, *, cut: bool = False) -> Verdict:
    """The law, for one folder; gives what `verify` said before a start may have mended it.

    What is cut off at the end of a commit leaves no trace in the ledger itself.
    """
    verdict = verify(data)
    got = reads(data)
    assert got == events[: len(got)], what
    assert verdict.findings or cut or got == events, what
    before = contents(data)
    found = starts(data)
    damage = [finding for finding in verdict.findings if finding.damage]
    if isinstance(found, LedgerDamaged):
        assert damage, (what, found)
        error = damage[0].error()
        assert (str(found), found.hint) == (str(error), error.hint), what
        assert contents(data) == before, f"{what}: refusing changes nothing"
        return verdict
    assert not damage, (what, damage)
    assert list(read_folder(data / "ledger")) == events[: found.position], what
    assert verify(data).sound, what
    return verdict


def contents(data: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(data.glob("*/*.mcap"))}


def restored(data: Path, files: dict[str, bytes]) -> None:
    folder = data / "ledger"
    for path in folder.iterdir():
        if path.name not in files:
            path.unlink()
    for name, raw in files.items():
        (folder / name).write_bytes(raw)


def live_finished(data: Path) -> list[AnyEvent]:
    events = small(3)
    written(data / "ledger", [events[:2], events[2:]])
    return events


def live_unfinished(data: Path) -> list[AnyEvent]:
    events = small(3)
    raw, _ = killed(data / "ledger", [events[:1], events[1:2], events[2:]])
    (data / "ledger" / ONE).write_bytes(raw)
    return events


def sealed_one(data: Path) -> list[AnyEvent]:
    events = live_finished(data)
    assert seal(DISK, data / "ledger" / ONE) is not None
    return events


ONE = segment_name(1)
Kind = Callable[[Path], list[AnyEvent]]
KINDS: tuple[Kind, ...] = (live_finished, live_unfinished, sealed_one)


@pytest.mark.parametrize("kind", [live_finished, sealed_one])
def test_every_wrong_bit_of_a_finished_segment_is_damage(tmp_path: Path, kind: Kind) -> None:
    kind(tmp_path)
    path = tmp_path / "ledger" / ONE
    raw = path.read_bytes()
    with path.open("r+b", buffering=0) as file:
        for bit in range(8 * len(raw)):
            file.seek(bit // 8)
            file.write(bytes([raw[bit // 8] ^ (1 << bit % 8)]))
            look = Inspection(thorough=False)
            look.segment(path, sound_end(path), newest=False)
            assert list(look.damage), bit
            file.seek(bit // 8)
            file.write(raw[bit // 8 : bit // 8 + 1])
    assert sound_end(path) is not None


def flip(data: Path, files: dict[str, bytes], name: str, bit: int) -> str:
    wrong = bytearray(files[name])
    wrong[bit // 8] ^= 1 << (bit % 8)
    restored(data, {**files, name: bytes(wrong)})
    return f"bit {bit} of {name}"


@pytest.mark.parametrize("kind", KINDS)
def test_a_wrong_bit_is_said_alike_and_never_read(tmp_path: Path, kind: Kind) -> None:
    events = kind(tmp_path)
    files = contents(tmp_path)
    for bit in range(5, 8 * len(files[ONE]), 37):
        check(tmp_path, events, flip(tmp_path, files, ONE, bit))


def cut(data: Path, files: dict[str, bytes], size: int) -> str:
    restored(data, {ONE: files[ONE][:size]})
    return f"cut at {size}"


@pytest.mark.parametrize("kind", KINDS)
def test_a_cut_is_said_alike_and_reads_as_a_prefix(tmp_path: Path, kind: Kind) -> None:
    events = kind(tmp_path)
    files = contents(tmp_path)
    for size in range(0, len(files[ONE]), 5):
        verdict = check(tmp_path, events, cut(tmp_path, files, size), cut=True)
        assert verdict.sound is (kind is not sealed_one and size >= len(BEGINNING))


@pytest.mark.parametrize("kind", [live_finished, live_unfinished])
def test_a_cut_that_loses_what_a_snapshot_knows_is_damage(tmp_path: Path, kind: Kind) -> None:
    events = kind(tmp_path)
    save(tmp_path / "snapshots", fold(Fleet(), events))
    files = contents(tmp_path)
    for size in range(0, len(files[ONE]), 23):
        what = cut(tmp_path, files, size)
        lost = reads(tmp_path) != events
        assert check(tmp_path, events, what, cut=True).sound is not lost


EVENTS = history(51, 60)
NAMES = [segment_name(first) for first in (1, 13, 25, 37, 49)]


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five segments of twelve events, the second and the third sealed."""
    data = tmp_path_factory.mktemp("mixed")
    written(data / "ledger", in_threes(EVENTS), segment_chunks_max=4)
    for name in NAMES[1:3]:
        assert seal(DISK, data / "ledger" / name) is not None
    return data


@pytest.fixture
def data(mixed: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(mixed, tmp_path / "data"))


def test_a_missing_segment_is_damage_but_the_newest(data: Path) -> None:
    files = contents(data)
    for name in NAMES:
        restored(data, {other: raw for other, raw in files.items() if other != name})
        verdict = check(data, EVENTS, f"without {name}", cut=True)
        assert verdict.sound is (name == NAMES[-1])
    save(data / "snapshots", fold(Fleet(), EVENTS[:49]))
    verdict = check(data, EVENTS, "without the newest, but with a snapshot ahead", cut=True)
    assert [finding.what for finding in verdict.findings] == [
        "the ledger ends at position 48, but here is the state after it"
    ]


def test_a_segment_under_another_name_is_damage(data: Path) -> None:
    files = contents(data)
    others = [*NAMES, segment_name(7), segment_name(61), segment_name(99), "copy.mcap"]
    for name in NAMES:
        for other in others:
            if other == name:
                continue
            moved = {n: raw for n, raw in files.items() if n != name}
            restored(data, {**moved, other: files[name]})  # may take the place of another
            assert not check(data, EVENTS, f"{name} renamed to {other}").sound
            restored(data, {**files, other: files[name]})
            assert not check(data, EVENTS, f"{name} copied to {other}").sound


def test_segments_that_have_changed_places_are_damage(data: Path) -> None:
    files = contents(data)
    for one in NAMES:
        for other in NAMES:
            if one < other:
                restored(data, {**files, one: files[other], other: files[one]})
                assert not check(data, EVENTS, f"{one} and {other} swapped").sound


@pytest.mark.parametrize("packed", [False, True])
def test_a_segment_of_another_ledger_is_damage(data: Path, tmp_path: Path, packed: bool) -> None:
    files = contents(data)
    written(tmp_path / "other" / "ledger", in_threes(history(52, 60)), segment_chunks_max=4)
    for name in NAMES if packed else ():
        assert seal(DISK, tmp_path / "other" / "ledger" / name) is not None
    others = contents(tmp_path / "other")
    for name in NAMES[1:]:
        restored(data, {**files, name: others[name]})
        verdict = check(data, EVENTS, f"{name} of another ledger")
        assert verdict.findings[0].what == FOREIGN


def edit(records: bytes) -> bytes:
    """Say that somebody else asked for the first event."""
    at = records.index(b'"by":"') + 6
    return records[:at] + b"mallo" + records[at + 5 :]


def test_a_history_that_was_edited_shows_by_its_hashes(data: Path) -> None:
    files = contents(data)
    name, path = NAMES[3], data / "ledger" / NAMES[3]
    raw, found = files[name], read_trailer(files[name][-TRAILER_BYTES:])
    chunk = chunk_at(raw, len(BEGINNING), len(raw))
    assert found is not None and isinstance(chunk, Chunk)
    forged = BEGINNING + mcap.chunk(
        edit(raw[chunk.records : chunk.end]), chunk.first_ns, chunk.last_ns, b""
    )
    forged += raw[chunk.end : -TRAILER_BYTES]
    path.write_bytes(forged + found[0].to_bytes(zlib.crc32(forged)))
    assert sound_end(path) is not None, "all CRCs are right"
    (finding,) = verify(data).findings
    assert (finding.path.name, finding.what) == (name, UNFIT)
    with pytest.raises(LedgerDamaged, match=UNFIT):
        seal(DISK, path)  # that would make it look right

    measured = measure(forged, len(forged), 37, found[0].predecessor)
    trailer = msgspec.structs.replace(found[0], sha256=measured.sha256)
    path.write_bytes(forged + trailer.to_bytes(zlib.crc32(forged)))
    refusal, (finding,) = starts(data), verify(data).findings
    assert (finding.path.name, finding.what) == (NAMES[4], FOREIGN)
    assert str(refusal) == str(finding.error())


def test_a_sealed_history_that_was_edited_shows_by_its_hashes(data: Path) -> None:
    path = data / "ledger" / NAMES[1]
    with path.open("rb") as file:
        before = sealed.read_contents(file)
        assert isinstance(before, sealed.Contents)
        (block,) = before.blocks
        records = sealed.unpack_block(file, block)
    assert isinstance(records, bytes)
    declared = sealed.Declarations()
    declared.learn_all(records)
    raw, packed = sealed.pack_block(block.start, edit(records), block.first_ns, block.last_ns, b"")
    forged = sealed.BEGINNING + raw + before.trailer.record()
    named = len(sealed.BEGINNING + raw)
    end = sealed.ending(len(forged), declared, (packed,), named, zlib.crc32(forged))
    path.write_bytes(forged + end)
    assert sound_end(path) is not None, "all CRCs are right"
    (finding,) = verify(data).findings
    assert (finding.path.name, finding.what) == (NAMES[1], UNFIT)


def large(data: Path, seed: int) -> list[AnyEvent]:
    """Some hundred commits in segments, the older ones sealed, the newest as a crash leaves it."""
    random = Random(seed)
    events = history(seed % 1_000, random.randint(600, 1_500))
    ledger = FileLedger.open(data / "ledger", segment_chunks_max=random.randint(5, 40), disk=DISK)
    at = 0
    while at < len(events):
        size = random.randint(1, 30)
        ledger.wait(ledger.append(events[at : at + size], at), 30)
        at += size
    newest = max((data / "ledger").glob("*.mcap"))
    raw = newest.read_bytes()
    ledger.close()
    if random.random() < 0.5:
        newest.write_bytes(raw)
    waiting = unsealed(data / "ledger")
    for path in waiting[: random.randint(0, len(waiting))]:
        assert seal(DISK, path) is not None
    return events


def mutilate(random: Random, data: Path, files: dict[str, bytes]) -> tuple[str, bool]:
    """Do one thing that disks, people and cosmic rays do; gives what, and whether it is a cut."""
    name = random.choice(list(files))
    raw = files[name]
    roll = random.random()
    if roll < 0.5:
        return flip(data, files, name, random.randrange(8 * len(raw))), False
    at = random.randrange(len(raw))
    if roll < 0.7:
        restored(data, {**files, name: raw[:at]})
        return f"{name} cut at {at}", True
    if roll < 0.9:
        size = random.choice((1, 512, 4096))
        at = at // size * size
        there = len(raw[at : at + size])
        filling = random.choice((bytes(there), random.randbytes(there)))
        restored(data, {**files, name: raw[:at] + filling + raw[at + size :]})
        return f"{there} bytes of {name} overwritten at {at}", False
    other = random.choice(list(files))
    restored(data, {**files, name: files[other]})
    return f"{other} copied over {name}", False


def random_damage(seed: int, times: int) -> None:
    """A large ledger of this seed, damaged in so many ways, one at a time."""
    random = Random(seed)
    with TemporaryDirectory() as folder:
        data = Path(folder)
        events = large(data, seed)
        files = contents(data)
        for number in range(times):
            what, is_cut = mutilate(random, data, files)
            if contents(data) != files:
                check(data, events, f"seed {seed}, damage {number}: {what}", cut=is_cut)


@pytest.mark.parametrize("seed", [1, 2])
def test_random_damage_to_a_large_ledger_is_found(seed: int) -> None:
    random_damage(seed, 12)


def stage(seed: int) -> None:
    """For the soak: every cut and many bits of small ledgers, and random damage to large ones."""
    with capture_logs():  # of torn tails: thousands
        for kind in KINDS:
            with TemporaryDirectory() as folder:
                data = Path(folder)
                events = kind(data)
                files = contents(data)
                size = len(files[ONE])
                for at in range(size):
                    check(data, events, cut(data, files, at), cut=True)
                for bit in range(seed % 11, 8 * size, 11):
                    check(data, events, flip(data, files, ONE, bit))
        for number in range(2):
            random_damage(seed * 2 + number, 40)
