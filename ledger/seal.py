"""Sealing: a finished segment is written anew, packed and indexed, and takes its own place.

Only the chunks change: records are copied as they are, nothing is decoded. The draft is read back
from the disk and compared before it is renamed over the segment, so at any moment the name leads to
one whole file or the other, of the same events.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from zlib import crc32

from ledger import mcap_records as mcap
from ledger import sealed
from ledger.chunks import Chunk, Flaw, chunk_at
from ledger.damage import Inspection
from ledger.disk import DRAFT, Disk, write_all
from ledger.errors import LedgerDamaged, LedgerError, NotSealed
from ledger.lock import Lock
from ledger.measure import Measured, crc_of, measure_sealed
from ledger.scene import Value
from ledger.segment import (
    BEGINNING,
    TRAILER_BYTES,
    Trailer,
    first_position,
    read_trailer,
    segment_paths,
)

LOCK_NAME = "sealing"  # one sealer to a folder, also where the server before has not quite gone
SYNC_BYTES = 1024 * 1024  # a sync of much at once would keep a commit's own waiting
DRAFT_SUFFIX = ".sealing" + DRAFT

Stopped = Callable[[], bool]
Failed = Callable[[Path, Exception], None]


class Sealed(Value, frozen=True, kw_only=True):
    """What became of a segment."""

    path: Path
    events: int
    bytes_before: int
    bytes_after: int


def never() -> bool:
    """Nobody stops it."""
    return False


def refuse(path: Path, trouble: Exception) -> None:
    """Go no further."""
    raise trouble


def unsealed(directory: Path) -> list[Path]:
    """Segments that may be sealed, oldest first: all but the newest, which may be in writing."""
    return [path for path in segment_paths(directory)[:-1] if not _is_sealed(path)]


def _is_sealed(path: Path) -> bool:
    with path.open("rb") as file:
        return sealed.is_sealed(file)


def seal_folder(
    disk: Disk, directory: Path, stopped: Stopped = never, failed: Failed = refuse
) -> Iterator[Sealed]:
    """Seal one segment after the other until none is left to be sealed, or stopped.

    `failed` hears of each that could not be, and may raise. Raises LedgerLocked where another
    sealer is at work.
    """
    lock = Lock(directory, LOCK_NAME)
    try:
        for path in unsealed(directory):
            try:
                done = seal(disk, path, stopped)
            except (LedgerError, OSError) as trouble:
                failed(path, trouble)
                continue
            if done is None:
                return
            yield done
    finally:
        lock.close()


def seal(disk: Disk, path: Path, stopped: Stopped = never) -> Sealed | None:
    """Seal a finished segment; None if stopped before it was done, then nothing has changed.

    Raises LedgerDamaged where the segment is not as it was written, NotSealed where the draft does
    not hold the same, OSError as the disk does. The segment stays as it is then.
    """
    measured = _right(path)
    data = path.read_bytes()
    found = read_trailer(data[-TRAILER_BYTES:])
    assert found is not None
    trailer = found[0]
    draft = path.with_name(path.name + DRAFT_SUFFIX)
    if draft.exists():
        disk.remove(draft)  # of a sealer that died
    fd = disk.create(draft)
    try:
        try:
            whole = _write(disk, fd, path, data, trailer, stopped)
        finally:
            disk.close(fd)
        if whole:
            disk.settle(draft)
            _compare(draft, measured, trailer)
            size = draft.stat().st_size
            disk.rename(draft, path)
    except BaseException:
        _discard(disk, draft)
        raise
    if not whole:
        _discard(disk, draft)
        return None
    return Sealed(
        path=path, events=measured.tally.sequence, bytes_before=len(data), bytes_after=size
    )


def _discard(disk: Disk, draft: Path) -> None:
    try:
        disk.remove(draft)
    except OSError:
        return  # the next start, or the next sealing, takes it away


def _right(path: Path) -> Measured:
    """Count through the segment; what is damaged is not sealed, for that would bury it."""
    look = Inspection(thorough=False)
    look.alone(path)
    for finding in look.damage:
        raise finding.error()
    assert look.newest is not None
    measured = look.newest.measured
    if not look.newest.finished:
        position = first_position(path) + measured.tally.sequence
        raise LedgerDamaged(path, measured.end, "it has no trailer, but a successor", position)
    return measured


class _Draft:
    """Writes to the draft, counts, and syncs little by little."""

    def __init__(self, disk: Disk, fd: int) -> None:
        self.size = 0
        self.crc = 0
        self._disk = disk
        self._fd = fd
        self._unsynced = 0

    def write(self, data: bytes) -> None:
        write_all(self._disk, self._fd, data)
        self.size += len(data)
        self.crc = crc32(data, self.crc)
        self._unsynced += len(data)
        if self._unsynced >= SYNC_BYTES:
            self.sync()

    def sync(self) -> None:
        self._disk.sync(self._fd)
        self._unsynced = 0


def _write(
    disk: Disk, fd: int, path: Path, data: bytes, trailer: Trailer, stopped: Stopped
) -> bool:
    draft = _Draft(disk, fd)
    draft.write(sealed.BEGINNING)
    declared = sealed.Declarations()
    blocks: list[sealed.Block] = []
    for records, first_ns, last_ns in _groups(path, data, declared):
        if stopped():
            return False
        spare = next(iter(declared.schemas.values()))
        raw, block = sealed.pack_block(draft.size, records, first_ns, last_ns, spare)
        draft.write(raw)
        blocks.append(block)
    named = draft.size
    draft.write(trailer.record())
    draft.write(sealed.ending(draft.size, declared, tuple(blocks), named, draft.crc))
    draft.sync()
    return True


def _groups(
    path: Path, data: bytes, declared: sealed.Declarations
) -> Iterator[tuple[bytes, int, int]]:
    """The records of whole commits, a MiB or more of them, with first and last log time.

    What is declared again is left out.
    """
    gathered, first_ns, last_ns = bytearray(), 0, 0
    start, end = len(BEGINNING), len(data) - TRAILER_BYTES
    while start < end:
        chunk = chunk_at(data, start, end)
        assert isinstance(chunk, Chunk)  # all have been measured
        first_ns, last_ns = first_ns or chunk.first_ns, chunk.last_ns
        try:
            gathered += _records(data, chunk, declared)
        except ValueError as error:
            raise LedgerDamaged(path, start, str(error), first_position(path)) from error
        start = chunk.end
        if len(gathered) >= sealed.CHUNK_BYTES:
            yield bytes(gathered), first_ns, last_ns
            gathered, first_ns = bytearray(), 0
    if gathered:
        yield bytes(gathered), first_ns, last_ns


def _records(data: bytes, chunk: Chunk, declared: sealed.Declarations) -> bytes:
    """A chunk's records without declarations that are known; raises ValueError for other ones."""
    kept, at, since = b"", chunk.records, chunk.records
    while at < chunk.end:
        opcode, length = mcap.RECORD.unpack_from(data, at)
        end = at + mcap.RECORD.size + length
        if opcode != mcap.MESSAGE and not declared.learn(data[at:end]):
            kept += data[since:at]
            since = end
        at = end
    return kept + data[since : chunk.end]


def _compare(draft: Path, measured: Measured, trailer: Trailer) -> None:
    """Read the draft as any reader would; raises NotSealed unless it holds the same messages."""
    with draft.open("rb") as file:
        contents = sealed.read_contents(file)
        if isinstance(contents, Flaw):
            raise NotSealed(draft, contents.offset, contents.what)
        again = measure_sealed(file, contents, trailer.first)
        if again.flaw is not None:
            raise NotSealed(draft, again.flaw.offset, again.flaw.what)
        same = (contents.trailer, again.tally, again.sha256)
        if same != (trailer, measured.tally, trailer.sha256):
            raise NotSealed(draft, contents.named_at, "its events are not those of the segment")
        if crc_of(file, contents.data_end) != contents.data_crc:
            raise NotSealed(draft, contents.data_end, "the CRC of its data section is wrong")
