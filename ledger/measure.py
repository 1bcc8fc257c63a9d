"""What a segment holds, counted through to its first flaw; all but the payloads' meaning."""

import hashlib
import zlib
from pathlib import Path
from typing import BinaryIO

import msgspec

from ledger import mcap_records as mcap
from ledger import sealed
from ledger.chunks import Chunk, Flaw, Payloads, Tally, chunk_at, walk
from ledger.scene import Value
from ledger.segment import BEGINNING, TRAILER_BYTES, Trailer, header_flaw, read_trailer

PIECE_BYTES = 1024 * 1024  # read at once where only the CRC is wanted


class Measured(Value, frozen=True, kw_only=True):
    """What a segment holds up to its first flaw, or to the end."""

    chunks: int
    end: int  # where the last good chunk ends
    tally: Tally
    sha256: str
    flaw: Flaw | None


class Ends(Value, frozen=True, kw_only=True):
    """What a finished segment says of itself at its end."""

    trailer: Trailer
    data_crc: int
    data_end: int  # offset up to which the CRC reaches


class _Stamp(msgspec.Struct):
    position: int


_stamp = msgspec.json.Decoder(_Stamp)


def misplaced(payload: memoryview, position: int) -> str:
    """Say what is wrong where an event is not of the position that it stands at; "" if nothing."""
    try:
        says = _stamp.decode(payload).position
    except msgspec.DecodeError as error:
        return f"an event cannot be read: {error}"
    return "" if says == position else f"an event at {position} says that it is at {says}"


def measure(data: bytes, end: int, first: int, predecessor: str) -> Measured:
    """Count through the data section of a segment as it was written."""
    sha, tally, chunks, start = hashlib.sha256(predecessor.encode()), Tally(), 0, len(BEGINNING)
    flaw: Flaw | None = None
    if not data.startswith(BEGINNING):
        flaw, start = Flaw(offset=0, what=header_flaw(data)), 0
    while flaw is None and start < end:
        chunk = chunk_at(data, start, end)
        after: Tally | Flaw
        payloads: Payloads = []
        after = walk(data, chunk, tally, payloads) if isinstance(chunk, Chunk) else chunk
        if isinstance(chunk, Flaw) or isinstance(after, Flaw):
            flaw = after if isinstance(after, Flaw) else None
            break
        if what := misplaced(payloads[0], first + tally.sequence):
            flaw = Flaw(offset=start, what=what)
            break
        sha.update(b"".join(payloads))
        start, tally, chunks = chunk.end, after, chunks + 1
    return Measured(chunks=chunks, end=start, tally=tally, sha256=sha.hexdigest(), flaw=flaw)


def measure_sealed(file: BinaryIO, contents: sealed.Contents, first: int) -> Measured:
    """Count through a sealed segment; every index must be what the messages make it."""
    sha = hashlib.sha256(contents.trailer.predecessor.encode())
    tally, at = Tally(), len(sealed.BEGINNING)
    declared = sealed.Declarations()
    flaw: Flaw | None = None
    chunks = 0
    for block in contents.blocks:
        payloads: Payloads = []
        after = _measure_block(file, block, at, tally, declared, payloads)
        if isinstance(after, Flaw):
            flaw = after
            break
        if what := misplaced(payloads[0], first + tally.sequence):
            flaw = Flaw(offset=at, what=what)
            break
        sha.update(b"".join(payloads))
        tally, at, chunks = after, block.end, chunks + 1
    if flaw is None:
        flaw = _measure_end(contents, declared, at)
    return Measured(chunks=chunks, end=at, tally=tally, sha256=sha.hexdigest(), flaw=flaw)


def _measure_block(
    file: BinaryIO,
    block: sealed.Block,
    at: int,
    tally: Tally,
    declared: sealed.Declarations,
    payloads: Payloads,
) -> Tally | Flaw:
    if block.start != at:
        return Flaw(offset=at, what="a chunk is not where the summary says")
    records = sealed.unpack_block(file, block)
    if isinstance(records, Flaw):
        return records
    after = walk(records, unpacked(block, records), tally, payloads)
    if isinstance(after, Flaw):  # its offset is one of the unpacked records
        return Flaw(offset=at, what=after.what)
    try:
        declared.learn_all(records)
    except ValueError as error:
        return Flaw(offset=at, what=str(error))
    indexes, counts = sealed.message_indexes(records)
    file.seek(block.indexes_at)
    if counts != block.counts or file.read(len(indexes)) != indexes:
        return Flaw(offset=block.indexes_at, what="a chunk's index does not fit its messages")
    return after


def _measure_end(contents: sealed.Contents, declared: sealed.Declarations, at: int) -> Flaw | None:
    if not contents.blocks or at != contents.named_at:
        return Flaw(offset=at, what="its summary does not name all that is in it")
    due = sealed.ending(contents.data_end, declared, contents.blocks, at, contents.data_crc)
    if due != mcap.data_end(contents.data_crc) + contents.summary:
        return Flaw(offset=contents.data_end, what="its summary does not fit its content")
    return None


def unpacked(block: sealed.Block, records: bytes) -> Chunk:
    """Give a sealed chunk's records the form that `walk` takes."""
    return Chunk(
        start=0, records=0, end=len(records), first_ns=block.first_ns, last_ns=block.last_ns
    )


def ends_of(file: BinaryIO) -> Ends | None:
    """What a segment, live or sealed, says of itself; None if it is unfinished or damaged there."""
    if sealed.is_sealed(file):
        contents = sealed.read_contents(file)
        if isinstance(contents, Flaw):
            return None
        return Ends(
            trailer=contents.trailer, data_crc=contents.data_crc, data_end=contents.data_end
        )
    size = file.seek(0, 2)
    file.seek(max(0, size - TRAILER_BYTES))
    found = read_trailer(file.read())
    if found is None:
        return None
    named_bytes = len(found[0].record())
    return Ends(trailer=found[0], data_crc=found[1], data_end=size - TRAILER_BYTES + named_bytes)


def trailer_of(path: Path) -> Trailer | None:
    """Trailer of a finished segment, from its end alone; None if it has no whole one."""
    with path.open("rb") as file:
        ends = ends_of(file)
    return None if ends is None else ends.trailer


def crc_of(file: BinaryIO, end: int) -> int:
    """CRC-32 of a file's bytes up to an offset, in little memory."""
    crc, left = 0, end
    file.seek(0)
    while left > 0 and (piece := file.read(min(PIECE_BYTES, left))):
        crc = zlib.crc32(piece, crc)
        left -= len(piece)
    return crc


def sound_end(path: Path) -> Ends | None:
    """What a segment says of itself, if every byte of the file is as it was written; else None.

    Trusts the CRCs of the whole file; what they cannot show, `measure` does.
    """
    with path.open("rb") as file:
        ends = ends_of(file)
        if ends is None:
            return None
        file.seek(0)
        beginning = file.read(len(BEGINNING))
        ours = beginning == BEGINNING or sealed.is_sealed(file)
        return ends if ours and crc_of(file, ends.data_end) == ends.data_crc else None
