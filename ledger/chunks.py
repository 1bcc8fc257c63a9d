"""The chunks of a live segment: whole or not, and what their messages must be.

Our own, for the stock readers cannot tell a clean end from a torn one, and take three times as
long.
"""

import zlib

from ledger import mcap_records as mcap
from ledger.scene import Value


class Chunk(Value, frozen=True, kw_only=True):
    """Where a whole chunk with a right CRC lies in a buffer."""

    start: int
    records: int  # where its records begin
    end: int
    first_ns: int
    last_ns: int


class Flaw(Value, frozen=True, kw_only=True):
    """Where the bytes stop being what a writer would have written, and how."""

    offset: int
    what: str
    torn: bool = False  # a crash may have left it so; what a whole chunk holds cannot be torn


class Tally(Value, frozen=True, kw_only=True):
    """What has been counted through up to the end of a chunk."""

    sequence: int = 0  # of the next message
    last_ns: int = 0


def chunk_at(data: bytes, start: int, end: int) -> Chunk | Flaw:
    """Check the frame and the CRC of the chunk at an offset; a CRC of 0 is refused."""
    what = ""
    if start + mcap.CHUNK_HEAD.size > end:
        return Flaw(offset=start, what="a chunk's head is cut off", torn=True)
    opcode, length, first_ns, last_ns, size, crc, compression, records_size = (
        mcap.CHUNK_HEAD.unpack_from(data, start)
    )
    records = start + mcap.CHUNK_HEAD.size
    if opcode != mcap.CHUNK:
        what = f"a chunk should be here, not a record {opcode:#04x}"
    elif compression or size != records_size or length != mcap.CHUNK_REST + size:
        what = "a chunk's sizes contradict each other"
    elif records + size > end:
        what = "a chunk is cut off"
    elif crc == 0 or zlib.crc32(memoryview(data)[records : records + size]) != crc:
        what = "a chunk's CRC is wrong"
    if what:
        return Flaw(offset=start, what=what, torn=True)
    return Chunk(
        start=start, records=records, end=records + size, first_ns=first_ns, last_ns=last_ns
    )


Payloads = list[memoryview]


def walk(data: bytes, chunk: Chunk, tally: Tally, payloads: Payloads | None) -> Tally | Flaw:
    """Check a chunk's messages against those before: sequence gap-free, log times increasing.

    Collects the payloads where a list is given.
    """
    at, sequence, last_ns = chunk.records, tally.sequence, tally.last_ns
    first_ns, messages = 0, 0
    whole = memoryview(data)
    head, size = mcap.MESSAGE_HEAD.unpack_from, mcap.MESSAGE_HEAD.size
    while at < chunk.end:
        opcode, length = mcap.RECORD.unpack_from(data, at) if at + 9 <= chunk.end else (0, 0)
        end = at + mcap.RECORD.size + length
        if end > chunk.end or opcode not in (mcap.MESSAGE, mcap.SCHEMA, mcap.CHANNEL):
            return Flaw(offset=at, what=f"a record {opcode:#04x} does not belong into a chunk")
        if opcode == mcap.MESSAGE:
            if length < mcap.MESSAGE_REST:
                return Flaw(offset=at, what="a message is cut off")
            _, _, _, number, log_ns, _ = head(data, at)
            if number != sequence:
                return Flaw(offset=at, what=f"message {number} stands where {sequence} is due")
            if log_ns <= last_ns:
                return Flaw(offset=at, what="a message's log time is not after the one before")
            first_ns = first_ns or log_ns
            last_ns = log_ns
            sequence += 1
            messages += 1
            if payloads is not None:
                payloads.append(whole[at + size : end])
        at = end
    if not messages or (chunk.first_ns, chunk.last_ns) != (first_ns, last_ns):
        return Flaw(offset=chunk.start, what="a chunk's times are not those of its messages")
    return Tally(sequence=sequence, last_ns=last_ns)


def later_chunk(data: bytes, start: int, end: int) -> int | None:
    """Find a whole chunk anywhere behind a flaw: then the flaw is damage, not a torn tail."""
    at = data.find(mcap.CHUNK, start + 1, end)
    while at >= 0:
        if isinstance(chunk_at(data, at, end), Chunk):
            return at
        at = data.find(mcap.CHUNK, at + 1, end)
    return None


def damage_of(data: bytes, flaw: Flaw, chunk_start: int, end: int) -> Flaw | None:
    """Tell damage from a torn tail: a torn chunk is followed by nothing.

    Gives the flaw in words for people, or None where a crash may have left the bytes so.
    """
    if not flaw.torn:
        return flaw
    later = later_chunk(data, chunk_start, end)
    if later is None:
        return None
    what = f"{flaw.what}, and a whole commit follows at byte {later}"
    return Flaw(offset=flaw.offset, what=what)


def last_ns_of(data: bytes, start: int, end: int) -> int:
    """Log time of the newest message, by the heads of chunks that are known to be right."""
    last_ns = 0
    while start < end:
        _, length, _, last_ns, *_ = mcap.CHUNK_HEAD.unpack_from(data, start)
        start += mcap.RECORD.size + length
    return last_ns


def sequence_at(data: bytes, chunk_start: int, end: int) -> int | None:
    """Sequence of the first message of a chunk, without checking it; None where there is none."""
    at = chunk_start + mcap.CHUNK_HEAD.size
    while at + mcap.MESSAGE_HEAD.size <= end:
        opcode, length = mcap.RECORD.unpack_from(data, at)
        if opcode == mcap.MESSAGE:
            sequence: int = mcap.MESSAGE_HEAD.unpack_from(data, at)[3]
            return sequence
        if opcode not in (mcap.SCHEMA, mcap.CHANNEL):
            return None
        at += mcap.RECORD.size + length
    return None


def seek(data: bytes, start: int, end: int, sequence: int) -> tuple[int, int, list[int]]:
    """Find the chunk that holds a message: its offset and first sequence.

    Gives also where the chunks before it are that declare schemas: they hold for what follows.

    Hops over the chunks before it by their lengths alone, as those are not going to be used.
    Whatever looks wrong ends the hopping, and the strict reading that follows will name it.
    """
    at, first = start, 0
    declaring: list[int] = []
    while at + mcap.CHUNK_HEAD.size < end:
        following = at + mcap.RECORD.size + mcap.RECORD.unpack_from(data, at)[1]
        if data[at] != mcap.CHUNK or following >= end:
            break
        coming = sequence_at(data, following, end)
        if coming is None or coming > sequence or coming <= first:
            break
        if data[at + mcap.CHUNK_HEAD.size] == mcap.SCHEMA:
            declaring.append(at)
        at, first = following, coming
    return at, first, declaring
