import io
import zlib

from mcap.data_stream import RecordBuilder
from mcap.records import (
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import StreamReader

from ledger import mcap_records as mcap
from ledger.segment import BEGINNING


def by_the_library(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def test_our_records_are_the_librarys_byte_for_byte() -> None:
    assert mcap.header("p", "lib") == by_the_library(Header(profile="p", library="lib"))
    assert mcap.schema(7, "Ä", "jsonschema", b"{}") == by_the_library(
        Schema(id=7, name="Ä", encoding="jsonschema", data=b"{}")
    )
    assert mcap.channel(7, 8, "orders/X", "json") == by_the_library(
        Channel(id=7, schema_id=8, topic="orders/X", message_encoding="json", metadata={})
    )
    assert mcap.metadata("n", {"a": "1", "bc": "22"}) == by_the_library(
        Metadata(name="n", metadata={"a": "1", "bc": "22"})
    )
    assert mcap.data_end(99) == by_the_library(DataEnd(data_section_crc=99))
    assert mcap.footer() == by_the_library(Footer(0, 0, 0))
    assert mcap.chunk(b"records", 3, 9, b"") == by_the_library(
        Chunk(
            compression="",
            data=b"records",
            message_start_time=3,
            message_end_time=9,
            uncompressed_crc=zlib.crc32(b"records"),
            uncompressed_size=7,
        )
    )


def test_the_records_of_a_summary_are_the_librarys_byte_for_byte() -> None:
    assert mcap.packed_chunk(b"records", b"packed", 3, 9, 77) == by_the_library(
        Chunk(
            compression="zstd",
            data=b"packed",
            message_start_time=3,
            message_end_time=9,
            uncompressed_crc=77,
            uncompressed_size=7,
        )
    )
    entries = mcap.INDEX_ENTRY.pack(3, 0) + mcap.INDEX_ENTRY.pack(9, 40)
    assert mcap.message_index(7, entries) == by_the_library(MessageIndex(7, [(3, 0), (9, 40)]))
    assert mcap.statistics(
        {7: 2, 3: 5}, schemas=2, channels=4, chunks=6, first_ns=3, last_ns=9
    ) == by_the_library(
        Statistics(
            attachment_count=0,
            channel_count=4,
            channel_message_counts={3: 5, 7: 2},
            chunk_count=6,
            message_count=7,
            message_end_time=9,
            message_start_time=3,
            metadata_count=1,
            schema_count=2,
        )
    )
    assert mcap.metadata_index(5, 6, "n") == by_the_library(MetadataIndex(5, 6, "n"))
    assert mcap.summary_offset(mcap.SCHEMA, 5, 6) == by_the_library(
        SummaryOffset(group_opcode=mcap.SCHEMA, group_start=5, group_length=6)
    )


def test_a_schema_is_read_back() -> None:
    raw = mcap.schema(7, "Näme", "jsonschema", b"{data}")
    assert mcap.read_schema(raw[mcap.RECORD.size :]) == ("Näme", b"{data}")


def with_crc_zero(data: bytes) -> bytes:
    """Add the four bytes that bring a CRC-32 to 0: those of its own register, inverted."""
    table = {zlib.crc32(bytes([n])) ^ zlib.crc32(b"\0"): n for n in range(256)}
    by_top = {key >> 24: key for key in table}
    wanted, indices = 0xFFFFFFFF, []
    for _ in range(4):
        key = by_top[wanted >> 24]
        indices.append(table[key])
        wanted = ((wanted ^ key) << 8) & 0xFFFFFFFF
    register, patch = zlib.crc32(data) ^ 0xFFFFFFFF, b""
    for index in reversed(indices):
        patch += bytes([index ^ (register & 0xFF)])
        key = next(k for k, n in table.items() if n == index)
        register = (register >> 8) ^ key
    return data + patch


def test_a_chunk_never_has_crc_zero_which_would_mean_unchecked() -> None:
    spare = mcap.channel(1, 0, "t", "json")
    message = mcap.MESSAGE_HEAD.pack(mcap.MESSAGE, mcap.MESSAGE_REST + 8, 1, 0, 5, 5)
    records = with_crc_zero(spare + message + b"1234")
    assert zlib.crc32(records) == 0
    raw = mcap.chunk(records, 5, 5, spare)
    assert mcap.CHUNK_HEAD.unpack_from(raw)[5] != 0
    file = io.BytesIO(BEGINNING + raw + mcap.data_end(0) + mcap.footer() + mcap.MAGIC)
    kinds = [type(r).__name__ for r in StreamReader(file, validate_crcs=True).records]
    assert kinds == ["Header", "Channel", "Message", "Channel", "DataEnd", "Footer"]
