"""What is done to a ledger's files before it is written again.

Only the newest segment can be unfinished. Its whole commits stay; a torn tail is copied aside and
cut; then it gets its trailer and is never written again. Anything else out of place is damage, and
the server refuses to start, for to go on would bury it.
"""

import hashlib
import zlib
from pathlib import Path

import structlog

from ledger.disk import DRAFT, Disk, write_file
from ledger.errors import LedgerDamaged
from ledger.scan import Chunk, Flaw, Payloads, Tally, chunk_at, later_chunk, trailer_of, walk
from ledger.scene import Value
from ledger.segment import (
    BEGINNING,
    NO_HASH,
    TRAILER_BYTES,
    Trailer,
    finish,
    first_position,
    read_trailer,
    segment_paths,
)

log = structlog.get_logger()


class Recovered(Value, frozen=True, kw_only=True):
    """Where a ledger goes on."""

    position: int = 0  # of the newest event
    last_ns: int = 0  # its log time
    sha256: str = NO_HASH  # of the newest segment
    paths: tuple[Path, ...] = ()


class Measured(Value, frozen=True, kw_only=True):
    """What a segment holds up to its first flaw, or to the end."""

    chunks: int
    end: int  # where the last good chunk ends
    tally: Tally
    sha256: str
    flaw: Flaw | None


def measure(data: bytes, end: int, predecessor: str) -> Measured:
    """Count through a segment's data section; checks all but the payloads' meaning."""
    sha, tally, chunks, start = hashlib.sha256(predecessor.encode()), Tally(), 0, len(BEGINNING)
    flaw: Flaw | None = None
    if not data.startswith(BEGINNING):
        flaw, start = Flaw(offset=0, what="its header is not ours"), 0
    while flaw is None and start < end:
        chunk = chunk_at(data, start, end)
        payloads: Payloads = []
        after = walk(data, chunk, tally, payloads) if isinstance(chunk, Chunk) else chunk
        if isinstance(chunk, Flaw) or isinstance(after, Flaw):
            flaw = after if isinstance(after, Flaw) else None
            break
        sha.update(b"".join(payloads))
        start, tally, chunks = chunk.end, after, chunks + 1
    return Measured(chunks=chunks, end=start, tally=tally, sha256=sha.hexdigest(), flaw=flaw)


def recover(disk: Disk, directory: Path) -> Recovered:
    """Make the folder fit for appending; raises LedgerDamaged where that would hide a loss."""
    for draft in directory.glob(f"*{DRAFT}"):
        disk.remove(draft)  # never had an event
    paths = segment_paths(directory)
    before = _check_finished(paths)
    if not paths:
        return before
    newest = paths[-1]
    first = first_position(newest)
    if first != before.position + 1:
        what = f"position {before.position + 1} is missing before it"
        raise LedgerDamaged(newest, 0, what, before.position + 1)
    disk.settle(newest)  # whoever wrote it may have died or given up before the sync
    data = newest.read_bytes()
    found = read_trailer(data[-TRAILER_BYTES:])
    end = len(data) if found is None else len(data) - TRAILER_BYTES
    measured = measure(data, end, before.sha256)
    last = first + measured.tally.sequence - 1
    if found is not None:
        _check_claims(newest, data, end, found, measured, before.sha256)
    else:
        if measured.flaw is not None:
            _refuse_damage(newest, data, measured)
        if not measured.chunks:
            return _without_empty(disk, paths, data, before)
        _cut_and_finish(disk, newest, data, measured, before.sha256)
    return Recovered(
        position=last,
        last_ns=measured.tally.last_ns,
        sha256=measured.sha256,
        paths=tuple(paths),
    )


def _check_finished(paths: list[Path]) -> Recovered:
    """Check that all segments but the newest are finished and follow each other.

    Reads the ends of the files only; `fleetledger verify` reads everything.
    """
    position, sha256 = 0, NO_HASH
    for path in paths[:-1]:
        found = trailer_of(path)
        if first_position(path) != position + 1:
            what = f"position {position + 1} is missing before it"
            raise LedgerDamaged(path, 0, what, position + 1)
        if found is None:
            size = path.stat().st_size
            raise LedgerDamaged(path, size, "it has no trailer, but a successor", position + 1)
        trailer, _ = found
        if trailer.first != position + 1:
            what = f"its trailer says that it begins at position {trailer.first}"
            raise LedgerDamaged(path, 0, what, position + 1)
        if trailer.predecessor != sha256:
            what = "it does not follow the segment before it: the hashes differ"
            raise LedgerDamaged(path, 0, what, position + 1)
        position, sha256 = trailer.last, trailer.sha256
    return Recovered(position=position, sha256=sha256, paths=tuple(paths[:-1]))


def _check_claims(
    path: Path,
    data: bytes,
    end: int,
    found: tuple[Trailer, int],
    measured: Measured,
    predecessor: str,
) -> None:
    trailer, crc = found
    first = first_position(path)
    if measured.flaw is not None:
        position = first + measured.tally.sequence
        raise LedgerDamaged(path, measured.flaw.offset, measured.flaw.what, position)
    says = Trailer(
        first=first,
        last=first + measured.tally.sequence - 1,
        predecessor=predecessor,
        sha256=measured.sha256,
    )
    if trailer != says:
        raise LedgerDamaged(path, end, "its trailer does not fit its content", trailer.last)
    named = end + len(trailer.record())
    if zlib.crc32(memoryview(data)[:named]) != crc:
        raise LedgerDamaged(path, end, "the CRC of its data section is wrong", trailer.last)


def _refuse_damage(path: Path, data: bytes, measured: Measured) -> None:
    """Tell damage from a torn tail: one is followed by a whole commit, the other by nothing."""
    assert measured.flaw is not None
    position = first_position(path) + measured.tally.sequence
    if measured.flaw.offset == 0:  # a header appears whole, or there is no file
        raise LedgerDamaged(path, 0, measured.flaw.what, position)
    later = later_chunk(data, measured.end, len(data))
    if later is not None:
        what = f"{measured.flaw.what}, and a whole commit follows at byte {later}"
        raise LedgerDamaged(path, measured.flaw.offset, what, position)


def _cut_and_finish(
    disk: Disk, path: Path, data: bytes, measured: Measured, predecessor: str
) -> None:
    tail = data[measured.end :]
    fd = disk.reopen(path)
    try:
        if tail:
            aside = _keep_aside(disk, path, tail)
            what = measured.flaw.what if measured.flaw else ""
            log.warning("torn tail cut", segment=path.name, bytes=len(tail), kept=aside, why=what)
            disk.truncate(fd, measured.end)
            disk.sync(fd)
        first = first_position(path)
        trailer = Trailer(
            first=first,
            last=first + measured.tally.sequence - 1,
            predecessor=predecessor,
            sha256=measured.sha256,
        )
        finish(disk, fd, trailer, zlib.crc32(memoryview(data)[: measured.end]))
    finally:
        disk.close(fd)


def _keep_aside(disk: Disk, path: Path, tail: bytes) -> str:
    taken = sum(1 for _ in path.parent.glob(f"{path.name}.torn-*"))
    aside = path.with_name(f"{path.name}.torn-{taken + 1}")
    disk.close(write_file(disk, aside, tail))
    return aside.name


def _without_empty(disk: Disk, paths: list[Path], data: bytes, before: Recovered) -> Recovered:
    """Take away a segment that was begun and never got a whole commit; its place is free again."""
    path = paths[-1]
    if len(data) > len(BEGINNING):
        aside = _keep_aside(disk, path, data[len(BEGINNING) :])
        log.warning("torn first commit cut", segment=path.name, kept=aside)
    disk.remove(path)
    disk.sync_folder(path.parent)
    if len(paths) == 1:
        return Recovered()
    previous = paths[-2]
    whole = previous.read_bytes()
    found = read_trailer(whole[-TRAILER_BYTES:])
    assert found is not None  # _check_finished has seen it
    end = len(whole) - TRAILER_BYTES
    measured = measure(whole, end, found[0].predecessor)
    _check_claims(previous, whole, end, found, measured, found[0].predecessor)
    return Recovered(
        position=before.position,
        last_ns=measured.tally.last_ns,
        sha256=before.sha256,
        paths=tuple(paths[:-1]),
    )
