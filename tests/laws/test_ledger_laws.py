"""The ledger's laws: decoding undoes encoding, a fold is the state, a cut is a prefix."""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger import snapshot
from ledger.codec import decode, encode
from ledger.events import (
    EVENTS,
    AnyEvent,
    Event,
    RobotConnected,
    RobotDisconnected,
)
from ledger.evolve import evolve, fold
from ledger.ids import RobotName, SceneId
from ledger.scan import read_folder
from ledger.segment import BEGINNING
from ledger.snapshot import restore
from ledger.state import Fleet
from ledger.store import FileLedger
from tests.histories import histories, history
from tests.ledger.folders import in_threes, killed
from tests.strategies import events_of


@pytest.mark.parametrize("kind", EVENTS)
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_what_is_decoded_is_what_was_encoded(kind: type[Event], data: st.DataObject) -> None:
    event = data.draw(events_of(kind))
    assert decode(encode(event)) == event  # type: ignore[arg-type]


@settings(max_examples=25, deadline=None)
@given(events=histories(max_events=150), data=st.data())
def test_a_fold_of_all_events_is_the_live_state(
    events: list[AnyEvent], data: st.DataObject
) -> None:
    """However the events were split into commands, segments and lives of the server."""
    live = Fleet()
    with TemporaryDirectory() as name:
        folder = Path(name) / "ledger"
        while live.position < len(events):
            ledger = FileLedger.open(folder, segment_chunks_max=3)
            assert ledger.position == live.position
            for _ in range(data.draw(st.integers(1, 9))):
                size = data.draw(st.integers(1, 12))
                command = events[live.position : live.position + size]
                position = ledger.append(command, live.position)
                fold(live, command)
                if data.draw(st.booleans()):
                    assert ledger.wait(position, 30)
            ledger.close()
        assert list(read_folder(folder)) == events
        folded = restore(folder, Path(name) / "none")
    assert folded == live
    assert folded.canonical() == live.canonical()


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 99),
    count=st.integers(20, 200),
    apart=st.integers(5, 60),
    kept=st.integers(1, 6),
    data=st.data(),
)
def test_snapshots_change_nothing_but_time(
    seed: int, count: int, apart: int, kept: int, data: st.DataObject
) -> None:
    events = history(seed, count)
    with TemporaryDirectory() as name:
        folder, snapshots, none = (Path(name) / part for part in ("ledger", "snapshots", "none"))
        ledger = FileLedger.open(folder, segment_chunks_max=7)
        fleet = Fleet()
        for event in events:
            ledger.append([event], fleet.position)
            evolve(fleet, event)
            if fleet.position % apart == 0:
                snapshot.save(snapshots, fleet.copy(), kept_max=kept)
        ledger.close()
        assert len(list(snapshots.glob("*"))) == min(kept, count // apart)
        assert same(restore(folder, snapshots), fleet)
        for position in data.draw(st.lists(st.integers(0, count), max_size=4)):
            expected = fold(Fleet(), events[:position])
            assert same(restore(folder, snapshots, position=position), expected)
            assert same(restore(folder, none, position=position), expected)
        first_ms, last_ms = events[0].at_ms, events[-1].at_ms
        for at_ms in data.draw(st.lists(st.integers(first_ms - 1, last_ms + 1), max_size=4)):
            expected = fold(Fleet(), (e for e in events if e.at_ms <= at_ms))
            assert same(restore(folder, snapshots, at_ms=at_ms), expected)
            assert same(restore(folder, none, at_ms=at_ms), expected)


def same(one: Fleet, other: Fleet) -> bool:
    """Equal in everything, in the order of the dictionaries too, for later folds depend on it."""
    return snapshot.to_bytes(one) == snapshot.to_bytes(other)


def test_a_ledger_cut_at_any_byte_reads_as_a_whole_commit_prefix(tmp_path: Path) -> None:
    kinds = RobotConnected, RobotDisconnected  # short, with short schemas
    events: list[AnyEvent] = [
        kinds[n // 6](position=n + 1, at_ms=n // 2, scene=SceneId("s"), robot=RobotName(f"R{n}"))
        for n in range(12)
    ]
    raw, ends = killed(tmp_path / "whole", in_threes(events))
    folder = tmp_path / "cut"
    folder.mkdir()
    path = folder / "00000000000000000001.mcap"
    for cut in range(len(BEGINNING), len(raw) + 1):
        path.write_bytes(raw[:cut])
        commits = sum(end <= cut for end in ends)
        assert list(read_folder(folder)) == events[: 3 * commits]
        if any(abs(cut - end) < 9 for end in ends) or cut % 97 == 0:
            ledger = FileLedger.open(folder)
            assert ledger.position == 3 * commits
            assert list(ledger.read(0)) == events[: 3 * commits]
            ledger.close()
            for leftover in folder.iterdir():
                leftover.unlink()


APPENDER = """
import sys
from pathlib import Path
from ledger.store import FileLedger
from tests.histories import happenings

ledger = FileLedger.open(Path(sys.argv[1]), segment_chunks_max=50)
happening = happenings(3)
for _ in range(ledger.position):
    next(happening)
ledger.listen(lambda events: print(events[-1].position, flush=True))
command = []
for event in happening:
    command.append(event)
    if len(command) >= 1 + event.position % 4:
        ledger.append(command, ledger.position)
        command = []
        if event.position % 3 == 0:
            ledger.wait(ledger.position, 30)
        while ledger.position - ledger.durable > 100:
            ledger.wait(ledger.durable + 1, 30)
"""


def test_all_that_was_acknowledged_survives_kill_9(tmp_path: Path) -> None:
    acknowledged = 0
    for lines in (1, 40, 150, 60):
        appender = subprocess.Popen(
            [sys.executable, "-c", APPENDER, str(tmp_path)],
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        )
        try:
            assert appender.stdout is not None
            for _ in range(lines):
                acknowledged = int(appender.stdout.readline())
        finally:
            appender.kill()
            rest, _ = appender.communicate()
        acknowledged = int(([str(acknowledged), *rest.split("\n")[:-1]])[-1])
        found = list(read_folder(tmp_path))
        assert len(found) >= acknowledged
        assert found == history(3, len(found))
    ledger = FileLedger.open(tmp_path)
    assert ledger.position >= acknowledged
    ledger.close()
