"""The handful of MCAP records that a segment is made of, as bytes (mcap.dev/spec).

Written by ourselves, for the stock Writer truncates existing files, keeps 0.5 kB of objects per
chunk until it finishes and costs three to six times the CPU; the stock reader judges us in tests.
"""

import zlib
from struct import Struct, pack

MAGIC = b"\x89MCAP0\r\n"

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
MESSAGE_INDEX, CHUNK_INDEX, STATISTICS, METADATA = 0x07, 0x08, 0x0B, 0x0C
METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 0x0D, 0x0E, 0x0F

RECORD = Struct("<BQ")  # opcode, length of what follows
# opcode, length, channel, sequence, log time, publish time; the payload follows
MESSAGE_HEAD = Struct("<BQHIQQ")
MESSAGE_REST = MESSAGE_HEAD.size - RECORD.size  # of a message's length, beside its payload
# opcode, length, first and last log time, size, CRC-32, length of compression ("" here), size again
CHUNK_HEAD = Struct("<BQQQQIIQ")
CHUNK_REST = CHUNK_HEAD.size - RECORD.size
# the same where the compression is named `zstd`; the last size is that of the packed records
PACKED_HEAD = Struct("<BQQQQII4sQ")
PACKED_REST = PACKED_HEAD.size - RECORD.size
ZSTD = b"zstd"
INDEX_HEAD = Struct("<BQHI")  # opcode, length, channel, bytes of entries
INDEX_ENTRY = Struct("<QQ")  # log time, offset of the message in the chunk's records
FOOTER_RECORD = Struct("<BQQQI")  # opcode, length, start of summary, of its offsets, CRC


def record(opcode: int, body: bytes) -> bytes:
    """Any record: opcode, length, body."""
    return RECORD.pack(opcode, len(body)) + body


def text(value: str) -> bytes:
    """A string with its length before it."""
    raw = value.encode()
    return pack("<I", len(raw)) + raw


def _text_map(values: dict[str, str]) -> bytes:
    body = b"".join(text(key) + text(value) for key, value in values.items())
    return pack("<I", len(body)) + body


def header(profile: str, library: str) -> bytes:
    """First record of a file."""
    return record(HEADER, text(profile) + text(library))


def schema(number: int, name: str, encoding: str, data: bytes) -> bytes:
    """The shape of messages; numbers start at 1."""
    body = pack("<H", number) + text(name) + text(encoding) + pack("<I", len(data)) + data
    return record(SCHEMA, body)


def channel(number: int, schema_number: int, topic: str, encoding: str) -> bytes:
    """A stream of messages of one schema under one topic."""
    numbers = pack("<HH", number, schema_number)
    return record(CHANNEL, numbers + text(topic) + text(encoding) + _text_map({}))


def chunk(records: bytes | bytearray, first_ns: int, last_ns: int, spare: bytes) -> bytes:
    """An uncompressed chunk with its CRC, which is never 0, for that means `do not check`.

    `spare` is a record that may be repeated without changing anything; it turns a CRC that happens
    to be 0 into another.
    """
    crc = zlib.crc32(records)
    while crc == 0:
        records = bytes(records) + spare
        crc = zlib.crc32(records)
    size = len(records)
    return (
        CHUNK_HEAD.pack(CHUNK, CHUNK_REST + size, first_ns, last_ns, size, crc, 0, size) + records
    )


def metadata(name: str, values: dict[str, str]) -> bytes:
    """Named strings about the file."""
    return record(METADATA, text(name) + _text_map(values))


def data_end(crc: int) -> bytes:
    """End of the data section, with the CRC-32 of everything before it."""
    return record(DATA_END, pack("<I", crc))


def footer() -> bytes:
    """Last record of a file without a summary section."""
    return record(FOOTER, pack("<QQI", 0, 0, 0))


def packed_chunk(records: bytes, packed: bytes, first_ns: int, last_ns: int, crc: int) -> bytes:
    """A chunk whose records are packed by zstd; the CRC is that of the records."""
    size = len(packed)
    head = PACKED_HEAD.pack(
        CHUNK, PACKED_REST + size, first_ns, last_ns, len(records), crc, len(ZSTD), ZSTD, size
    )
    return head + packed


def message_index(channel_number: int, entries: bytes | bytearray) -> bytes:
    """Where the messages of one channel lie in the chunk before it."""
    length = INDEX_HEAD.size - RECORD.size + len(entries)
    return INDEX_HEAD.pack(MESSAGE_INDEX, length, channel_number, len(entries)) + entries


def statistics(
    counts: dict[int, int],
    *,
    schemas: int,
    channels: int,
    chunks: int,
    first_ns: int,
    last_ns: int,
) -> bytes:
    """What a file holds: messages by channel, one Metadata record, no attachments."""
    totals = pack("<QHIIII", sum(counts.values()), schemas, channels, 0, 1, chunks)
    by_channel = b"".join(pack("<HQ", *item) for item in sorted(counts.items()))
    times = pack("<QQI", first_ns, last_ns, len(by_channel))
    return record(STATISTICS, totals + times + by_channel)


def metadata_index(offset: int, length: int, name: str) -> bytes:
    """Where a Metadata record lies."""
    return record(METADATA_INDEX, pack("<QQ", offset, length) + text(name))


def summary_offset(opcode: int, start: int, length: int) -> bytes:
    """Where the summary's records of one kind lie."""
    return record(SUMMARY_OFFSET, pack("<BQQ", opcode, start, length))


def read_text(data: bytes | memoryview, at: int) -> tuple[str, int]:
    """Read a string at an offset; gives it and the offset behind it."""
    size = int.from_bytes(data[at : at + 4], "little")
    return bytes(data[at + 4 : at + 4 + size]).decode(), at + 4 + size


def read_schema(body: bytes | memoryview) -> tuple[str, bytes]:
    """Name and data of a schema record."""
    name, at = read_text(body, 2)
    _, at = read_text(body, at)
    return name, bytes(body[at + 4 :])
