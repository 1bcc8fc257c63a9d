"""Reading segments: chunk by chunk, every CRC checked, every position in its place."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import msgspec

from ledger import mcap_records as mcap
from ledger import sealed
from ledger.chunks import Chunk, Flaw, Payloads, Tally, chunk_at, damage_of, seek, walk
from ledger.codec import DECODER, Decoder
from ledger.errors import LedgerDamaged
from ledger.events import AnyEvent
from ledger.measure import trailer_of, unpacked
from ledger.segment import (
    BEGINNING,
    NO_HASH,
    TRAILER_BYTES,
    Trailer,
    first_position,
    header_flaw,
    read_trailer,
    segment_paths,
)


def events_between(
    path: Path,
    data: bytes,
    start: int,
    end: int,
    tally: Tally,
    decoder: Decoder = DECODER,
    base: int = 0,
    lenient: bool = False,
) -> Iterator[list[AnyEvent]]:
    """Read chunk after chunk of a live segment; raises LedgerDamaged at the first flaw.

    `base` is the file offset of the buffer. A lenient reader takes what it cannot read at the end
    for a commit in the making, unless a whole chunk follows.
    """
    while start < end:
        chunk = chunk_at(data, start, end)
        if isinstance(chunk, Flaw):
            flaw = damage_of(data, chunk, start, end) if lenient else chunk
            if flaw is None:
                return
            position = first_position(path) + tally.sequence
            raise LedgerDamaged(path, base + flaw.offset, flaw.what, position)
        events, tally = _events_of(path, data, chunk, tally, decoder, base + start)
        yield events
        start = chunk.end


def sealed_events(
    path: Path,
    file: BinaryIO,
    contents: sealed.Contents,
    after: int,
    until: int | None = None,
    decoder: Decoder = DECODER,
    chunks: int | None = None,
) -> Iterator[list[AnyEvent]]:
    """Events with after < position ≤ until, by chunk; those before are neither read nor decoded.

    Raises LedgerDamaged at the first flaw; reads no more than so many chunks of the file.
    """
    for body in contents.schemas:
        _check_schema(path, body, decoder)
    tally, first = Tally(), first_position(path)
    for block in contents.blocks[:chunks]:
        if until is not None and first + tally.sequence > until:
            return
        if first + tally.sequence + block.messages - 1 <= after:
            tally = Tally(sequence=tally.sequence + block.messages)
            continue
        records = sealed.unpack_block(file, block)
        if isinstance(records, Flaw):
            raise LedgerDamaged(path, records.offset, records.what, first + tally.sequence)
        chunk = unpacked(block, records)
        here = first + tally.sequence
        part = slice(max(0, after + 1 - here), None if until is None else until + 1 - here)
        events, tally = _events_of(path, records, chunk, tally, decoder, block.start, part)
        yield events


def _events_of(
    path: Path,
    data: bytes,
    chunk: Chunk,
    tally: Tally,
    decoder: Decoder,
    offset: int,
    part: slice | None = None,
) -> tuple[list[AnyEvent], Tally]:
    """Check a whole chunk that lies at a file offset, and decode it; raises LedgerDamaged.

    `part` is what is wanted of a packed chunk, whose offsets are not those of the file.
    """
    position = first_position(path) + tally.sequence
    payloads: Payloads = []
    after = walk(data, chunk, tally, payloads)
    if isinstance(after, Flaw):
        at = offset if part is not None else offset + after.offset - chunk.start
        raise LedgerDamaged(path, at, after.what, position)
    _check_schemas(path, data, chunk, decoder)
    if part is not None:
        payloads = payloads[part]
        position += part.start
    decode = decoder.decode
    try:
        events = [decode(payload) for payload in payloads]
    except msgspec.DecodeError as error:  # the CRC is right: somebody wrote it so
        what = f"an event cannot be read: {error}"
        raise LedgerDamaged(path, offset, what, position) from error
    for event in events:
        if event.position != position:
            what = f"an event at {position} says that it is at {event.position}"
            raise LedgerDamaged(path, offset, what, position)
        position += 1
    return events, after


def _check_schemas(path: Path, data: bytes, chunk: Chunk, decoder: Decoder) -> None:
    """Refuse shapes that this program is too old for. Schemas come before a chunk's messages."""
    at = chunk.records
    while at < chunk.end and data[at] != mcap.MESSAGE:
        opcode, length = mcap.RECORD.unpack_from(data, at)
        body = at + mcap.RECORD.size
        if opcode == mcap.SCHEMA:
            _check_schema(path, memoryview(data)[body : body + length], decoder)
        at = body + length


def _check_schema(path: Path, body: bytes | memoryview, decoder: Decoder) -> None:
    try:
        decoder.check(*mcap.read_schema(body))
    except (struct.error, UnicodeDecodeError, msgspec.DecodeError) as error:
        what = f"a schema cannot be read: {error}"
        raise LedgerDamaged(path, 0, what, first_position(path)) from error


def read_segment(
    path: Path, after: int, until: int | None, newest: bool, decoder: Decoder = DECODER
) -> Iterator[AnyEvent]:
    """Events of one file with after < position ≤ until. Only the newest may be unfinished."""
    if until is not None and until <= max(after, first_position(path) - 1):
        return
    with path.open("rb") as file:  # once: a sealed segment may take the name's place meanwhile
        last = first_position(path) - 1
        if sealed.is_sealed(file):
            contents = sealed.read_contents(file)
            if isinstance(contents, Flaw):
                raise LedgerDamaged(path, contents.offset, contents.what, last + 1)
            trailer: Trailer | None = contents.trailer
            end = contents.named_at
            batches = sealed_events(path, file, contents, after, until, decoder)
        else:
            file.seek(0)
            trailer, end, batches = _live(path, file.read(), after, newest, decoder)
        if trailer is not None and trailer.first != last + 1:
            what = f"its trailer says that it begins at position {trailer.first}"
            raise LedgerDamaged(path, end, what, last + 1)
        for events in batches:
            last = events[-1].position
            if last <= after:
                continue
            for event in events:
                if until is not None and event.position > until:
                    return
                if event.position > after:
                    yield event
            if last == until:
                return
    if trailer is not None and trailer.last > after and trailer.last != last:
        what = f"it ends at position {last}, its trailer says {trailer.last}"
        raise LedgerDamaged(path, end, what, last)


def _live(
    path: Path, data: bytes, after: int, newest: bool, decoder: Decoder
) -> tuple[Trailer | None, int, Iterator[list[AnyEvent]]]:
    first = first_position(path)
    found = read_trailer(data[-TRAILER_BYTES:])
    if not data.startswith(BEGINNING):
        raise LedgerDamaged(path, 0, header_flaw(data), first)
    if found is None and not newest:
        raise LedgerDamaged(path, len(data), "it has no trailer, but a successor", first)
    end = len(data) if found is None else len(data) - TRAILER_BYTES
    start, sequence, declaring = seek(data, len(BEGINNING), end, max(0, after + 1 - first))
    for offset in declaring:  # what is hopped over may still say that this program is too old
        chunk = chunk_at(data, offset, end)
        if isinstance(chunk, Chunk):
            _check_schemas(path, data, chunk, decoder)
    tally = Tally(sequence=sequence)
    lenient = found is None
    batches = events_between(path, data, start, end, tally, decoder, lenient=lenient)
    return None if found is None else found[0], end, batches


def read_folder(
    directory: Path, after: int = 0, until: int | None = None, decoder: Decoder = DECODER
) -> Iterator[AnyEvent]:
    """Events of a ledger that need not be open, or is open elsewhere: after < position ≤ until.

    Reads what is on the file system at that moment, durable or not.
    """
    paths = segment_paths(directory)
    firsts = [first_position(path) for path in paths]
    if paths and firsts[0] != 1:
        raise LedgerDamaged(paths[0], 0, "position 1 is missing before it", 1)
    due: int | None = None
    for number, path in enumerate(paths):
        newest = number + 1 == len(paths)
        if not newest and firsts[number + 1] <= after + 1:
            continue  # all of it lies before
        if until is not None and firsts[number] > until:
            return
        if due is not None and firsts[number] != due:
            raise LedgerDamaged(path, 0, f"position {due} is missing before it", due)
        _check_follows(path, paths[number - 1] if number else None)
        for event in read_segment(path, after, until, newest, decoder):
            due = event.position + 1
            yield event


def _check_follows(path: Path, before: Path | None) -> None:
    """Compare what a segment says that it follows with what the one before it says that it is."""
    own = trailer_of(path)
    other = None if before is None else trailer_of(before)
    if own is None or (before is not None and other is None):
        return  # the newest is not finished, or reading will say what is wrong
    if own.predecessor != (NO_HASH if other is None else other.sha256):
        what = "it does not follow the segment before it: the hashes differ"
        raise LedgerDamaged(path, 0, what, first_position(path))
