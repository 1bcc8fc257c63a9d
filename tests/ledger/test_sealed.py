import io
import zlib
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap.records import Chunk, ChunkIndex, DataEnd, Footer, MessageIndex, Metadata
from mcap.stream_reader import StreamReader

from ledger import mcap_records as mcap
from ledger import sealed
from ledger.chunks import Flaw
from ledger.codec import decode
from ledger.disk import Disk
from ledger.events import AnyEvent
from ledger.measure import trailer_of
from ledger.seal import seal
from ledger.segment import first_position
from tests.histories import history
from tests.ledger.folders import written
from tests.ledger.test_mcap_records import with_crc_zero

EVENTS = history(33, 8_000)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sealed segments of several chunks."""
    folder = tmp_path_factory.mktemp("sealed")
    commits = [EVENTS[n : n + 500] for n in range(0, len(EVENTS), 500)]
    written(folder, commits, segment_chunks_max=8)
    for path in sorted(folder.glob("*.mcap")):
        assert seal(Disk(), path) is not None
    return folder


def events_in(path: Path) -> list[AnyEvent]:
    first = first_position(path)
    trailer = trailer_of(path)
    assert trailer is not None and trailer.first == first
    return EVENTS[first - 1 : trailer.last]


def paths(folder: Path) -> list[Path]:
    found = sorted(folder.glob("*.mcap"))
    assert len(found) == 2
    return found


def test_the_stock_readers_read_all_with_every_crc(folder: Path) -> None:
    for path in paths(folder):
        for reader in (SeekingReader, NonSeekingReader, make_reader):
            with path.open("rb") as file:
                found = list(reader(file, validate_crcs=True).iter_messages())
            assert [decode(message.data) for _, _, message in found] == events_in(path)
            for schema, channel, message in found:
                assert schema is not None
                assert channel.topic.endswith(schema.name)
                assert msgspec.json.decode(message.data)["type"] == schema.name


def test_the_stock_reader_finds_a_stretch_of_time_by_the_index(folder: Path) -> None:
    for path in paths(folder):
        events = events_in(path)
        from_ns, to_ns = (events[n].at_ms * 1_000_000 for n in (2_000, 2_100))
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            messages = reader.iter_messages(starting_at=from_ns, ending_before=to_ns)
            got = [(m.log_time, decode(m.data)) for _, _, m in messages]
            everything = [(m.log_time, decode(m.data)) for _, _, m in reader.iter_messages()]
        assert 50 < len(got) < 200
        assert got == [(ns, event) for ns, event in everything if from_ns <= ns < to_ns]


def test_the_summary_counts_what_is_there(folder: Path) -> None:
    for path in paths(folder):
        events = events_in(path)
        with path.open("rb") as file:
            summary = make_reader(file, validate_crcs=True).get_summary()
        assert summary is not None and summary.statistics is not None
        by_name: dict[str, int] = {}
        for event in events:
            by_name[type(event).__name__] = by_name.get(type(event).__name__, 0) + 1
        counts = summary.statistics.channel_message_counts
        topics = {summary.channels[n].topic.partition("/")[2]: c for n, c in counts.items()}
        assert topics == by_name
        assert summary.statistics.message_count == len(events)
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) >= 2
        assert summary.statistics.channel_count == len(summary.channels)
        assert summary.statistics.schema_count == len(summary.schemas)
        assert summary.statistics.metadata_count == len(summary.metadata_indexes) == 1


def test_each_index_leads_to_its_chunk_and_each_message(folder: Path) -> None:
    for path in paths(folder):
        raw = path.read_bytes()
        with path.open("rb") as file:
            records = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
        with path.open("rb") as file:
            contents = sealed.read_contents(file)
        assert not isinstance(contents, Flaw)
        indexes = [r for r in records if isinstance(r, ChunkIndex)]
        assert [block.start for block in contents.blocks] == [i.chunk_start_offset for i in indexes]
        messages = 0
        for index, block in zip(indexes, contents.blocks, strict=True):
            builder = RecordBuilder()
            index.write(builder)
            assert block.record() == builder.end()
            assert raw[block.start] == mcap.CHUNK
            with path.open("rb") as file:
                unpacked = sealed.unpack_block(file, block)
            assert isinstance(unpacked, bytes)
            for channel, offset in index.message_index_offsets.items():
                assert raw[offset] == mcap.MESSAGE_INDEX
                (number,) = [int.from_bytes(raw[offset + 9 : offset + 11], "little")]
                assert number == channel
        for record in (r for r in records if isinstance(r, MessageIndex)):
            messages += len(record.records)
        assert messages == len(events_in(path))
        assert contents.data_crc == zlib.crc32(raw[: contents.data_end]) != 0
        kinds = [type(r) for r in records if not isinstance(r, Chunk | MessageIndex)]
        assert kinds[1:3] == [Metadata, DataEnd] and kinds[-1] is Footer


def test_an_event_takes_less_than_120_bytes(folder: Path) -> None:
    size = sum(path.stat().st_size for path in paths(folder))
    assert size / len(EVENTS) < 120


def test_a_packed_chunk_never_has_crc_zero_which_would_mean_unchecked() -> None:
    spare = mcap.channel(1, 0, "t", "json")
    message = mcap.MESSAGE_HEAD.pack(mcap.MESSAGE, mcap.MESSAGE_REST + 8, 1, 0, 5, 5)
    records = with_crc_zero(spare + message + b"1234")
    raw, block = sealed.pack_block(100, records, 5, 5, spare)
    assert int.from_bytes(raw[33:37], "little") != 0
    assert block.counts == {1: 1}
    with_offset = io.BytesIO(bytes(100) + raw)
    assert sealed.unpack_block(with_offset, block) == records + spare


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_a_cut_or_a_wrong_bit_at_the_end_is_noticed(folder: Path, data: st.DataObject) -> None:
    path = paths(folder)[0]
    raw = path.read_bytes()
    with path.open("rb") as file:
        contents = sealed.read_contents(file)
    assert isinstance(contents, sealed.Contents)
    at = data.draw(st.integers(contents.named_at, len(raw) - 1))
    if data.draw(st.booleans()):
        assert isinstance(sealed.read_contents(io.BytesIO(raw[:at])), Flaw)
        return
    wrong = bytearray(raw)
    wrong[at] ^= 1 << data.draw(st.integers(0, 7))
    found = sealed.read_contents(io.BytesIO(wrong))
    # the CRC of the data section, the trailer's record in it, is compared by who reads all of it
    assert isinstance(found, Flaw) or zlib.crc32(wrong[: found.data_end]) != found.data_crc
