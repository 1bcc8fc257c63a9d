"""A past moment is the fold up to it, whatever was looked at before."""

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.errors import Refused
from ledger.evolve import fold
from ledger.moment import At
from ledger.snapshot import save
from ledger.state import Fleet
from ledger.store import FileLedger, MemoryLedger
from replay.moment import Moments
from tests.histories import histories, history

looks = st.lists(st.tuples(st.booleans(), st.integers(0, 2**20)), min_size=1, max_size=12)


@given(events=histories(min_events=1), looked=looks, snapshot=st.integers(0, 120))
@settings(max_examples=60, deadline=None)
def test_any_sequence_of_looks_shows_what_a_fold_from_the_beginning_shows(
    events: list, looked: list[tuple[bool, int]], snapshot: int
) -> None:
    with tempfile.TemporaryDirectory() as name:
        kept = fold(Fleet(), events[: snapshot % len(events)])
        if kept.position:
            save(Path(name) / "snapshots", kept)
        moments = Moments(Path(name), read=MemoryLedger(events).read, kept_max=3)
        for by_position, number in looked:
            if by_position:
                position = number % (len(events) + 1)
                at, until = At(position=position), events[:position]
            else:
                at_ms = events[0].at_ms - 2 + number % (events[-1].at_ms - events[0].at_ms + 5)
                at, until = At(at_ms=at_ms), [e for e in events if e.at_ms <= at_ms]
            assert moments.fleet(at).canonical() == fold(Fleet(), until).canonical()


def test_without_a_moment_the_newest_state_is_given(tmp_path: Path) -> None:
    events = history(1, 50)
    ledger = MemoryLedger(events[:30])
    moments = Moments(tmp_path, read=ledger.read)
    assert moments.fleet(At()).position == 30
    ledger.append(events[30:], 30)
    assert moments.fleet(At()).canonical() == fold(Fleet(), events).canonical()


def test_a_state_given_earlier_does_not_change_when_a_later_one_is_asked(tmp_path: Path) -> None:
    moments = Moments(tmp_path, read=MemoryLedger(history(2, 80)).read)
    early = moments.fleet(At(position=40))
    before = early.canonical()
    moments.fleet(At(position=80))
    assert early.canonical() == before


def test_a_position_that_is_not_there_yet_is_refused(tmp_path: Path) -> None:
    moments = Moments(tmp_path, read=MemoryLedger(history(3, 10)).read)
    with pytest.raises(Refused, match="11 is not written yet"):
        moments.fleet(At(position=11))


def test_a_folder_is_read_while_somebody_else_writes_there(tmp_path: Path) -> None:
    events = history(4, 60)
    with_lock = FileLedger.open(tmp_path / "ledger")
    moments = Moments(tmp_path)
    for part in (events[:20], events[20:]):
        with_lock.wait(with_lock.append(part, with_lock.position), 10)
        assert moments.fleet(At()).position == part[-1].position
    with_lock.close()
