"""A sealed segment: the messages of a finished one, packed and indexed, for any MCAP reader.

    magic, Header, (Chunk, MessageIndex …) …, Metadata `fleetledger.segment`, DataEnd with CRC,
    Schema …, Channel …, Statistics, ChunkIndex …, MetadataIndex, SummaryOffset …,
    Footer with CRC, magic

Chunks are 1 MiB of whole commits, packed by zstd. The Metadata is that of the live trailer, so the
hashes of the payloads go on from segment to segment. How many messages a chunk holds follows from
the size of its MessageIndex records, so the summary alone says which chunk holds a position.
Every byte is under one of three CRCs, or always the same.
"""

import struct
import zlib
from typing import BinaryIO

import zstandard

from ledger import mcap_records as mcap
from ledger.chunks import Flaw
from ledger.scene import Value
from ledger.segment import TRAILER_NAME, Trailer, parse_trailer_record

BEGINNING = mcap.MAGIC + mcap.header("", "fleetledger-sealed-1")
CHUNK_BYTES = 1024 * 1024  # of records; the commit that reaches it is the chunk's last
UNPACKED_BYTES_MAX = 1024 * 1024 * 1024  # of a chunk: a greater size is damage
LEVEL = 3  # 9 saves 2 to 4 bytes an event and takes four times as long (bench/seal.py)

_END_BYTES = mcap.FOOTER_RECORD.size + len(mcap.MAGIC)
_NAMED_BYTES = len(Trailer(first=1, last=1, predecessor="0" * 64, sha256="0" * 64).record())
_DATA_END_BYTES = len(mcap.data_end(0))

Counts = dict[int, int]  # messages by channel number


class Block(Value, frozen=True, kw_only=True):
    """A packed chunk and the indexes behind it, as the summary's ChunkIndex has them."""

    start: int
    length: int  # of the chunk's record
    packed: int
    unpacked: int
    first_ns: int
    last_ns: int
    counts: Counts

    @property
    def messages(self) -> int:
        """How many it holds."""
        return sum(self.counts.values())

    @property
    def indexes_at(self) -> int:
        """Where its MessageIndex records begin."""
        return self.start + self.length

    @property
    def end(self) -> int:
        """Where the next record begins."""
        each = mcap.INDEX_HEAD.size
        return self.indexes_at + each * len(self.counts) + mcap.INDEX_ENTRY.size * self.messages

    def record(self) -> bytes:
        """The ChunkIndex."""
        offsets, at = b"", self.indexes_at
        for number, count in self.counts.items():
            offsets += struct.pack("<HQ", number, at)
            at += mcap.INDEX_HEAD.size + mcap.INDEX_ENTRY.size * count
        head = struct.pack(
            "<QQQQI", self.first_ns, self.last_ns, self.start, self.length, len(offsets)
        )
        name = struct.pack("<I", len(mcap.ZSTD)) + mcap.ZSTD
        sizes = struct.pack("<QQ", self.packed, self.unpacked)
        indexes = struct.pack("<Q", self.end - self.indexes_at)
        return mcap.record(mcap.CHUNK_INDEX, head + offsets + indexes + name + sizes)


class Declarations:
    """The schemas and channels of a segment, by number, as records."""

    def __init__(self) -> None:
        self.schemas: dict[int, bytes] = {}
        self.channels: dict[int, bytes] = {}

    def learn(self, record: bytes) -> bool:
        """Take a Schema or Channel record; True if it is new.

        Raises ValueError for another one by a number that is taken.
        """
        known = self.schemas if record[0] == mcap.SCHEMA else self.channels
        (number,) = struct.unpack_from("<H", record, mcap.RECORD.size)
        if known.setdefault(number, record) != record:
            raise ValueError(f"number {number} is declared twice, and differently")
        return known[number] is record

    def learn_all(self, records: bytes) -> None:
        """Take those among the records of a chunk; raises ValueError too."""
        at = 0
        while at < len(records):
            opcode, length = mcap.RECORD.unpack_from(records, at)
            end = at + mcap.RECORD.size + length
            if opcode != mcap.MESSAGE:
                self.learn(bytes(records[at:end]))
            at = end


class Contents(Value, frozen=True, kw_only=True):
    """What the end of a sealed segment says of the whole."""

    trailer: Trailer
    data_crc: int
    data_end: int  # where the DataEnd record begins: up to here reaches the CRC
    blocks: tuple[Block, ...]
    schemas: tuple[bytes, ...]  # bodies of the records
    summary: bytes

    @property
    def named_at(self) -> int:
        """Where the Metadata record begins, and the chunks end."""
        return self.data_end - _NAMED_BYTES


def pack_block(
    start: int, records: bytes, first_ns: int, last_ns: int, spare: bytes
) -> tuple[bytes, Block]:
    """Pack records that `chunks.walk` finds right: the bytes for offset `start`, and what they are.

    `spare` is a declaration that may be repeated, should the CRC be 0, which means `do not check`.
    """
    while (crc := zlib.crc32(records)) == 0:
        records += spare
    packed = zstandard.ZstdCompressor(level=LEVEL).compress(records)
    chunk = mcap.packed_chunk(records, packed, first_ns, last_ns, crc)
    indexes, counts = message_indexes(records)
    block = Block(
        start=start,
        length=len(chunk),
        packed=len(packed),
        unpacked=len(records),
        first_ns=first_ns,
        last_ns=last_ns,
        counts=counts,
    )
    return chunk + indexes, block


def message_indexes(records: bytes) -> tuple[bytes, Counts]:
    """Index the messages of records that are known to be whole: by channel, in file order."""
    entries: dict[int, bytearray] = {}
    at, head, entry = 0, mcap.MESSAGE_HEAD.unpack_from, mcap.INDEX_ENTRY.pack
    while at < len(records):
        opcode, length = mcap.RECORD.unpack_from(records, at)
        if opcode == mcap.MESSAGE:
            _, _, channel, _, log_ns, _ = head(records, at)
            if channel not in entries:
                entries[channel] = bytearray()
            entries[channel] += entry(log_ns, at)
        at += mcap.RECORD.size + length
    numbers = sorted(entries)
    indexes = b"".join(mcap.message_index(number, entries[number]) for number in numbers)
    return indexes, {number: len(entries[number]) // mcap.INDEX_ENTRY.size for number in numbers}


def ending(
    data_end: int, declared: Declarations, blocks: tuple[Block, ...], named: int, data_crc: int
) -> bytes:
    """All from the DataEnd record to the last magic; `named` is where the Metadata begins."""
    start = data_end + _DATA_END_BYTES
    counts: Counts = {}
    for block in blocks:
        for number, count in block.counts.items():
            counts[number] = counts.get(number, 0) + count
    groups = (
        (mcap.SCHEMA, b"".join(declared.schemas[n] for n in sorted(declared.schemas))),
        (mcap.CHANNEL, b"".join(declared.channels[n] for n in sorted(declared.channels))),
        (
            mcap.STATISTICS,
            mcap.statistics(
                counts,
                schemas=len(declared.schemas),
                channels=len(declared.channels),
                chunks=len(blocks),
                first_ns=blocks[0].first_ns,
                last_ns=blocks[-1].last_ns,
            ),
        ),
        (mcap.CHUNK_INDEX, b"".join(block.record() for block in blocks)),
        (mcap.METADATA_INDEX, mcap.metadata_index(named, _NAMED_BYTES, TRAILER_NAME)),
    )
    summary, offsets = b"", b""
    for opcode, records in groups:
        offsets += mcap.summary_offset(opcode, start + len(summary), len(records))
        summary += records
    footer = mcap.FOOTER_RECORD.pack(mcap.FOOTER, 20, start, start + len(summary), 0)[:-4]
    crc = zlib.crc32(summary + offsets + footer)
    return (
        mcap.data_end(data_crc) + summary + offsets + footer + struct.pack("<I", crc) + mcap.MAGIC
    )


def is_sealed(file: BinaryIO) -> bool:
    """Whether a file begins as sealed segments do."""
    file.seek(0)
    return file.read(len(BEGINNING)) == BEGINNING


def read_contents(file: BinaryIO) -> Contents | Flaw:
    """Read the end of a sealed segment; the Flaw where it is not as it was written."""
    size = file.seek(0, 2)
    if size < len(BEGINNING) + _NAMED_BYTES + _DATA_END_BYTES + _END_BYTES:
        return Flaw(offset=size, what="its end is cut off")
    file.seek(size - _END_BYTES)
    end = file.read(_END_BYTES)
    opcode, length, start, _, crc = mcap.FOOTER_RECORD.unpack_from(end)
    named = start - _DATA_END_BYTES - _NAMED_BYTES
    if end[-len(mcap.MAGIC) :] != mcap.MAGIC or (opcode, length) != (mcap.FOOTER, 20):
        return Flaw(offset=size - _END_BYTES, what="its end is cut off or overwritten")
    if not len(BEGINNING) <= named <= size - _END_BYTES:
        return Flaw(offset=size - _END_BYTES, what="its footer points to nowhere")
    file.seek(named)
    tail = file.read(size - named)
    summary = tail[start - named :]
    if zlib.crc32(summary[: -len(mcap.MAGIC) - 4]) != crc:
        return Flaw(offset=start, what="the CRC of its summary is wrong")
    trailer = parse_trailer_record(tail[:_NAMED_BYTES])
    data_end = tail[_NAMED_BYTES : _NAMED_BYTES + _DATA_END_BYTES]
    data_crc = int.from_bytes(data_end[-4:], "little")
    if trailer is None or data_end != mcap.data_end(data_crc):
        return Flaw(offset=named, what="its trailer is not as it was written")
    try:
        blocks, schemas = _read_summary(summary[:-_END_BYTES])
    except (struct.error, IndexError, ValueError):
        return Flaw(offset=start, what="its summary cannot be read")
    return Contents(
        trailer=trailer,
        data_crc=data_crc,
        data_end=start - _DATA_END_BYTES,
        blocks=tuple(blocks),
        schemas=tuple(schemas),
        summary=summary,
    )


def _read_summary(summary: bytes) -> tuple[list[Block], list[bytes]]:
    blocks: list[Block] = []
    schemas: list[bytes] = []
    at = 0
    while at < len(summary):
        opcode, length = mcap.RECORD.unpack_from(summary, at)
        body = summary[at + mcap.RECORD.size : at + mcap.RECORD.size + length]
        if opcode == mcap.CHUNK_INDEX:
            blocks.append(_read_block(body))
        elif opcode == mcap.SCHEMA:
            schemas.append(body)
        at += mcap.RECORD.size + length
    return blocks, schemas


def _read_block(body: bytes) -> Block:
    """Read a ChunkIndex; a MessageIndex is as long as its messages are many."""
    first_ns, last_ns, start, length, offsets_bytes = struct.unpack_from("<QQQQI", body)
    at = 36 + offsets_bytes
    numbers = list(struct.iter_unpack("<HQ", body[36:at]))
    (indexes_bytes,) = struct.unpack_from("<Q", body, at)
    packed, unpacked = struct.unpack_from("<QQ", body, at + 8 + 4 + len(mcap.ZSTD))
    begins = [offset for _, offset in numbers]
    ends = [*begins[1:], start + length + indexes_bytes]
    return Block(
        start=start,
        length=length,
        packed=packed,
        unpacked=unpacked,
        first_ns=first_ns,
        last_ns=last_ns,
        counts={
            number: (end - begin - mcap.INDEX_HEAD.size) // mcap.INDEX_ENTRY.size
            for (number, begin), end in zip(numbers, ends, strict=True)
        },
    )


def unpack_block(file: BinaryIO, block: Block) -> bytes | Flaw:
    """Read one chunk's records, checked against its head, its CRC and the summary."""
    file.seek(block.start)
    raw = file.read(block.length)
    if len(raw) != block.length or len(raw) < mcap.PACKED_HEAD.size:
        return Flaw(offset=block.start, what="a chunk is cut off")
    (crc,) = struct.unpack_from("<I", raw, mcap.RECORD.size + 24)
    head = mcap.PACKED_HEAD.pack(
        mcap.CHUNK,
        mcap.PACKED_REST + block.packed,
        block.first_ns,
        block.last_ns,
        block.unpacked,
        crc,
        len(mcap.ZSTD),
        mcap.ZSTD,
        block.packed,
    )
    packed = raw[mcap.PACKED_HEAD.size :]
    if not raw.startswith(head) or len(packed) != block.packed:
        return Flaw(offset=block.start, what="a chunk's head is not what the summary says")
    wrong = Flaw(offset=block.start, what="a chunk's CRC is wrong")
    try:
        if zstandard.frame_content_size(packed) != block.unpacked > 0:
            return wrong
        if block.unpacked > UNPACKED_BYTES_MAX:
            return wrong
        records = zstandard.ZstdDecompressor().decompress(packed)
    except zstandard.ZstdError:
        return wrong
    return records if crc != 0 and zlib.crc32(records) == crc else wrong
