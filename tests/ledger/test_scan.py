from pathlib import Path

import msgspec
import pytest

from ledger import mcap_records as mcap
from ledger.chunks import later_chunk
from ledger.codec import encode, schema_of
from ledger.errors import LedgerDamaged, LedgerNewer
from ledger.events import OrderPrioritised, RobotConnected
from ledger.ids import OrderId, RobotName, SceneId
from ledger.scan import read_folder
from ledger.segment import BEGINNING
from tests.histories import history
from tests.ledger.folders import in_threes, killed, written

EVENTS = history(21, 60)
ONE = "00000000000000000001.mcap"


def forged(folder: Path, schema: bytes, payload: bytes) -> Path:
    """A segment of one event, as another program might have written it."""
    records = (
        mcap.schema(1, "RobotConnected", "jsonschema", schema)
        + mcap.channel(1, 1, "robots/RobotConnected", "json")
        + mcap.MESSAGE_HEAD.pack(mcap.MESSAGE, mcap.MESSAGE_REST + len(payload), 1, 0, 5, 5)
        + payload
    )
    folder.mkdir(exist_ok=True)
    (folder / ONE).write_bytes(BEGINNING + mcap.chunk(records, 5, 5, b""))
    return folder


EVENT = RobotConnected(position=1, at_ms=5, scene=SceneId("s"), robot=RobotName("r"))


def test_a_segment_of_a_newer_program_is_refused_by_its_schema(tmp_path: Path) -> None:
    ours = schema_of(RobotConnected)
    assert list(read_folder(forged(tmp_path, ours, encode(EVENT)))) == [EVENT]
    newer = msgspec.json.decode(ours)
    newer["properties"]["signal_db"] = {"type": "number"}
    forged(tmp_path, msgspec.json.encode(newer), encode(EVENT))
    with pytest.raises(LedgerNewer, match="unknown signal_db"):
        list(read_folder(tmp_path))


def test_an_event_that_is_not_where_it_says_is_damage(tmp_path: Path) -> None:
    event = msgspec.structs.replace(EVENT, position=2)
    forged(tmp_path, schema_of(RobotConnected), encode(event))
    with pytest.raises(LedgerDamaged, match="an event at 1 says that it is at 2"):
        list(read_folder(tmp_path))


def test_a_folder_without_segments_holds_no_events(tmp_path: Path) -> None:
    assert list(read_folder(tmp_path)) == []


def test_a_ledger_that_is_being_written_reads_up_to_its_last_whole_commit(tmp_path: Path) -> None:
    raw, ends = killed(tmp_path / "whole", in_threes(EVENTS))
    folder = tmp_path / "ledger"
    folder.mkdir()
    (folder / ONE).write_bytes(raw[: ends[7] + 100])
    assert list(read_folder(folder)) == EVENTS[:24]
    assert list(read_folder(folder, 20, 22)) == EVENTS[20:22]
    assert {path.name for path in folder.iterdir()} == {ONE}, "reading changes nothing"


def test_a_flaw_before_a_whole_commit_is_damage_to_a_reader_too(tmp_path: Path) -> None:
    raw, ends = killed(tmp_path / "whole", in_threes(EVENTS))
    folder = tmp_path / "ledger"
    folder.mkdir()
    wrong = bytearray(raw)
    wrong[ends[7] + 100] ^= 1
    (folder / ONE).write_bytes(wrong)
    with pytest.raises(LedgerDamaged, match="position 25"):
        list(read_folder(folder))


def test_damage_before_what_is_wanted_does_not_hide_it(tmp_path: Path) -> None:
    path = written(tmp_path, in_threes(EVENTS))
    wrong = bytearray(path.read_bytes())
    wrong[len(BEGINNING) + 60] ^= 1  # in the first commit's content
    path.write_bytes(wrong)
    assert list(read_folder(tmp_path, 30)) == EVENTS[30:]
    with pytest.raises(LedgerDamaged):
        list(read_folder(tmp_path, 0, 3))


def test_text_that_looks_like_a_chunk_is_not_one() -> None:
    event = OrderPrioritised(scene=SceneId("s"), order=OrderId("\x06" * 50), priority=1)
    text = encode(event) * 3 + b"\x06" * 100
    assert later_chunk(text, 0, len(text)) is None
