"""What is done to a ledger's files before it is written again.

Only the newest segment can be unfinished. Its whole commits stay; a torn tail is copied aside and
cut; then it gets its trailer and is never written again. Anything else out of place is damage, and
the server refuses to start, for to go on would bury it.
"""

import zlib
from pathlib import Path

import structlog

from ledger import sealed
from ledger.chunks import Flaw, last_ns_of
from ledger.damage import Inspection, Newest, Progress, unseen
from ledger.disk import DRAFT, Disk, write_file
from ledger.measure import ends_of
from ledger.scene import Value
from ledger.segment import (
    BEGINNING,
    NO_HASH,
    SUFFIX,
    TRAILER_BYTES,
    Trailer,
    finish,
    first_position,
    segment_paths,
)

log = structlog.get_logger()


class Recovered(Value, frozen=True, kw_only=True):
    """Where a ledger goes on."""

    position: int = 0  # of the newest event
    last_ns: int = 0  # its log time
    sha256: str = NO_HASH  # of the newest segment
    paths: tuple[Path, ...] = ()


def recover(
    disk: Disk, directory: Path, snapshots: Path | None = None, progress: Progress = unseen
) -> Recovered:
    """Make the folder fit for appending; raises LedgerDamaged where that would hide a loss.

    Every file is checked first, and nothing is changed before all of them are found right.
    """
    for draft in directory.glob(f"*{DRAFT}"):
        disk.remove(draft)  # never had an event, or its segment is still there
    last = max(directory.glob(f"*{SUFFIX}"), default=None)
    if last is not None:
        disk.settle(last)  # whoever wrote it may have died or given up before the sync
    found = Inspection(thorough=False)
    found.folder(directory, progress)
    if snapshots is not None:
        found.snapshots(snapshots)
    for finding in found.damage:
        raise finding.error()
    paths = segment_paths(directory)
    newest = found.newest
    if newest is None or newest.finished:
        return _end_of(paths) if paths else Recovered()
    measured = newest.measured
    if not measured.chunks:
        return _without_empty(disk, paths, newest)
    _cut_and_finish(disk, newest, found.predecessor)
    return Recovered(
        position=found.position,
        last_ns=measured.tally.last_ns,
        sha256=measured.sha256,
        paths=tuple(paths),
    )


def _cut_and_finish(disk: Disk, newest: Newest, predecessor: str) -> None:
    path, measured = newest.path, newest.measured
    data = path.read_bytes()
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


def _without_empty(disk: Disk, paths: list[Path], newest: Newest) -> Recovered:
    """Take away a segment that was begun and never got a whole commit; its place is free again."""
    path = newest.path
    if newest.size > len(BEGINNING):
        aside = _keep_aside(disk, path, path.read_bytes()[len(BEGINNING) :])
        log.warning("torn first commit cut", segment=path.name, kept=aside)
    disk.remove(path)
    disk.sync_folder(path.parent)
    if len(paths) == 1:
        return Recovered()
    return _end_of(paths[:-1])


def _end_of(paths: list[Path]) -> Recovered:
    """Where finished segments end, which the inspection has found right."""
    with paths[-1].open("rb") as file:
        ends = ends_of(file)
        assert ends is not None
        if sealed.is_sealed(file):
            contents = sealed.read_contents(file)
            assert not isinstance(contents, Flaw)
            last_ns = contents.blocks[-1].last_ns
        else:
            file.seek(0)
            data = file.read()
            last_ns = last_ns_of(data, len(BEGINNING), len(data) - TRAILER_BYTES)
    return Recovered(
        position=ends.trailer.last,
        last_ns=last_ns,
        sha256=ends.trailer.sha256,
        paths=tuple(paths),
    )
