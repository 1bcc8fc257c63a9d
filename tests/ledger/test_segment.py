from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from ledger.codec import decode, schema_of
from ledger.disk import Disk
from ledger.errors import LedgerDamaged
from ledger.events import EVENTS, AnyEvent, RobotConnected
from ledger.ids import RobotName, SceneId
from ledger.segment import (
    BEGINNING,
    NO_HASH,
    TRAILER_BYTES,
    SegmentWriter,
    Trailer,
    first_position,
    read_trailer,
    segment_name,
)
from tests.histories import history
from tests.ledger.folders import in_threes, written


def test_a_name_is_a_position_of_twenty_digits(tmp_path: Path) -> None:
    assert segment_name(42) == "00000000000000000042.mcap"
    assert first_position(tmp_path / segment_name(42)) == 42
    for name in ("42.mcap", "0000000000000000004x.mcap", "00000000000000000000.mcap", "a.mcap"):
        with pytest.raises(LedgerDamaged, match="20 digits"):
            first_position(tmp_path / name)


def test_the_stock_reader_reads_exactly_what_was_appended(tmp_path: Path) -> None:
    events = history(5, 200)
    written(tmp_path, in_threes(events), segment_chunks_max=20)
    got: list[AnyEvent] = []
    for path in sorted(tmp_path.glob("*.mcap")):
        first = first_position(path)
        channels: dict[int, Channel] = {}
        schemas: dict[int, Schema] = {}
        last_ns, here = 0, 0
        with path.open("rb") as file:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    event = decode(record.data)
                    channel = channels[record.channel_id]
                    schema = schemas[channel.schema_id]
                    kind = type(event)
                    assert channel.topic == f"{EVENTS[kind]}/{kind.__name__}"
                    assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
                    assert (schema.name, schema.data) == (kind.__name__, schema_of(kind))
                    assert record.sequence == event.position - first == here
                    assert record.publish_time == event.at_ms * 1_000_000
                    assert record.log_time > last_ns
                    assert record.log_time >= record.publish_time
                    last_ns, here = record.log_time, here + 1
                    got.append(event)
                elif isinstance(record, Metadata):
                    assert record.metadata["last"] == f"{first + here - 1:020}"
        with path.open("rb") as file:
            messages = list(make_reader(file, validate_crcs=True).iter_messages())
            assert [decode(m.data) for _, _, m in messages] == got[first - 1 :]
    assert got == events
    assert len(list(tmp_path.glob("*.mcap"))) > 3


def connected(position: int, at_ms: int) -> RobotConnected:
    return RobotConnected(position=position, at_ms=at_ms, scene=SceneId("s"), robot=RobotName("R1"))


def test_log_times_increase_even_where_the_clock_stands_or_goes_back(tmp_path: Path) -> None:
    clock = [7, 7, 7, 3, 9]
    written(tmp_path, [[connected(n, at_ms)] for n, at_ms in enumerate(clock, 1)])
    with (tmp_path / segment_name(1)).open("rb") as file:
        times = [m.log_time for _, _, m in make_reader(file).iter_messages()]
    assert times == [7_000_000, 7_000_001, 7_000_002, 7_000_003, 9_000_000]


def test_a_segment_never_replaces_another(tmp_path: Path) -> None:
    (tmp_path / segment_name(1)).write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        SegmentWriter(Disk(), tmp_path, 1, 0, NO_HASH)
    assert (tmp_path / segment_name(1)).read_bytes() == b"precious"


@given(
    st.builds(
        Trailer,
        first=st.integers(1, 10**19),
        last=st.integers(0, 10**19),
        predecessor=st.text("0123456789abcdef", min_size=64, max_size=64),
        sha256=st.text("0123456789abcdef", min_size=64, max_size=64),
    ),
    st.integers(0, 2**32 - 1),
)
def test_a_trailer_always_has_one_size_and_reads_back(trailer: Trailer, crc: int) -> None:
    raw = trailer.to_bytes(crc)
    assert len(raw) == TRAILER_BYTES
    found = read_trailer(raw)
    assert found is not None
    assert found[0] == trailer


@given(st.integers(0, TRAILER_BYTES - 1), st.integers(0, 7))
def test_a_flipped_bit_in_a_trailer_is_noticed_or_changes_a_claim(at: int, bit: int) -> None:
    trailer = Trailer(first=1, last=9, predecessor=NO_HASH, sha256="ab" * 32)
    raw = bytearray(trailer.to_bytes(5))
    whole = read_trailer(bytes(raw))
    raw[at] ^= 1 << bit
    assert read_trailer(bytes(raw)) != whole


def test_a_short_or_foreign_end_is_no_trailer() -> None:
    assert read_trailer(b"") is None
    assert read_trailer(BEGINNING) is None
    assert read_trailer(bytes(TRAILER_BYTES)) is None


def test_each_finished_segment_names_the_hash_of_the_one_before(tmp_path: Path) -> None:
    written(tmp_path, in_threes(history(5, 60)), segment_chunks_max=5)
    before = NO_HASH
    for path in sorted(tmp_path.glob("*.mcap")):
        found = read_trailer(path.read_bytes()[-TRAILER_BYTES:])
        assert found is not None
        assert found[0].predecessor == before
        before = found[0].sha256


def test_messages_are_plain_json_for_any_other_program(tmp_path: Path) -> None:
    written(tmp_path, [history(1, 3)])
    with (tmp_path / segment_name(1)).open("rb") as file:
        for _, _, message in make_reader(file).iter_messages():
            assert {"type", "position", "at_ms", "scene", "by", "command"} <= set(
                msgspec.json.decode(message.data)
            )
