import sqlite3
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path
from random import Random

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from structlog.testing import capture_logs

from ledger.callbacks import CallbackConfig
from ledger.events import AnyEvent
from ledger.ids import CommandId
from ledger.state import Fleet
from ledger.store import MemoryLedger
from projections.callbacks import Callback
from projections.outbox import POSITIONS_APART, Outbox
from tests.projections.told import ALL, OPENED, Heard, expected, fleet_at, heard, told_history

WAIT_S = 30.0


class Ear:
    """Who hears, and waits for it."""

    def __init__(self) -> None:
        self.callbacks: list[Callback] = []
        self._changed = threading.Condition()

    def hear(self, callbacks: Sequence[Callback]) -> None:
        with self._changed:
            self.callbacks += callbacks
            self._changed.notify_all()

    def until(self, enough: Callable[[], bool]) -> None:
        with self._changed:
            assert self._changed.wait_for(enough, WAIT_S), self.callbacks[-1:]

    def until_more_than(self, count: int) -> None:
        self.until(lambda: len(self.callbacks) > count)

    def until_heard(self, wanted: list[Heard]) -> None:
        self.until(lambda: len(self.callbacks) >= len(wanted))
        assert heard(self.callbacks) == wanted


class Place:
    """A folder, a ledger, and the outbox that is open now."""

    def __init__(self, path: Path, events: Sequence[AnyEvent] = ()) -> None:
        self.path = path
        self.ledger = MemoryLedger(events)

    @contextmanager
    def opened(
        self, callbacks_max: int = 50_000, folding: Callable[[], None] = lambda: None
    ) -> Iterator[tuple[Outbox, Ear]]:
        ear = Ear()
        outbox = Outbox(self.path, ear.hear, callbacks_max=callbacks_max)
        events = list(self.ledger.read(0))
        self.ledger.listen(outbox.follow)

        def fleet_of(position: int) -> Fleet:
            folding()
            return fleet_at(list(self.ledger.read(0)), position)

        outbox.start(self.ledger.read, fleet_of, fleet_at(events, len(events)))
        try:
            yield outbox, ear
        finally:
            outbox.close()

    def append(self, events: Sequence[AnyEvent]) -> None:
        for event in events:
            self.ledger.append([event], event.position - 1)


def rows(path: Path) -> int:
    with closing(sqlite3.connect(path)) as connection:
        (count,) = connection.execute("SELECT count(*) FROM callbacks").fetchone()
    return int(count)


def after(events: Sequence[AnyEvent], position: int) -> list[Heard]:
    return [one for one in expected(events) if one.position > position]


def test_what_happens_is_heard_in_order_and_numbered(tmp_path: Path) -> None:
    events = told_history(1, 300, {OPENED: ALL})
    place = Place(tmp_path / "outbox.sqlite")
    with place.opened() as (outbox, ear):
        place.append(events)
        ear.until_heard(list(expected(events)))
        assert [c.number for c in ear.callbacks] == list(range(1, len(ear.callbacks) + 1))
        assert outbox.waiting() == ear.callbacks
    assert (tmp_path / "outbox.sqlite").stat().st_mode & 0o777 == 0o600


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 2**16), st.integers(0, 2**16))
def test_over_any_number_of_restarts_all_is_heard_until_it_is_settled(
    tmp_path_factory: pytest.TempPathFactory, seed: int, chance: int
) -> None:
    random = Random(chance)
    off = CallbackConfig()
    changes = {OPENED: ALL, random.randint(20, 80): off, random.randint(81, 120): ALL}
    events = told_history(seed, 200, changes)
    place = Place(tmp_path_factory.mktemp("outbox") / "outbox.sqlite")
    whole = list(expected(events))
    settled: set[Heard] = set()
    for start, end in pairwise([0, *sorted(random.sample(range(1, 200), 3)), len(events)]):
        with place.opened() as (outbox, ear):
            place.append(events[start:end])
            due = [one for one in whole if one.position <= end]
            ear.until_heard([one for one in due if one not in settled])
            done = random.sample(ear.callbacks, random.randint(0, len(ear.callbacks)))
            for noted in [outbox.settle(callback.number) for callback in done]:
                noted.result(WAIT_S)
            settled |= set(heard(done))
    assert rows(place.path) == len(due) - len(settled)


def test_tries_are_kept_over_a_restart(tmp_path: Path) -> None:
    events = told_history(2, 60, {OPENED: ALL})
    place = Place(tmp_path / "outbox.sqlite")
    with place.opened() as (outbox, ear):
        place.append(events)
        ear.until_heard(list(expected(events)))
        tried = msgspec.structs.replace(ear.callbacks[0], tries=3, error="HTTP 500")
        outbox.tried(tried)
        assert outbox.waiting()[0] == tried
    with place.opened() as (outbox, ear):
        assert outbox.waiting()[0] == tried
        assert ear.callbacks[0] == tried


def test_what_was_not_followed_before_a_stop_comes_in_at_the_next_start(tmp_path: Path) -> None:
    events = told_history(3, 300, {OPENED: ALL})
    place = Place(tmp_path / "outbox.sqlite", events[:50])
    with place.opened() as (_, ear):
        ear.until_heard([])
    place.append(events[50:])  # nobody listens: as if a crash came before the outbox followed
    wanted = after(events, 50)
    with place.opened() as (_, ear):
        ear.until_heard(wanted)


def test_settings_that_come_late_are_followed_from_where_they_are(tmp_path: Path) -> None:
    """While nobody wants to hear anything no orders are folded: the state is fetched then."""
    events = told_history(4, 300, {200: ALL})
    place = Place(tmp_path / "outbox.sqlite")
    with place.opened() as (_, ear):
        place.append(events)
        ear.until_heard(list(expected(events)))


def test_a_file_that_is_gone_begins_at_the_newest_event_and_says_so(tmp_path: Path) -> None:
    events = told_history(5, 200, {OPENED: ALL})
    place = Place(tmp_path / "outbox.sqlite", events[:100])
    with capture_logs() as logs, place.opened() as (_, ear):
        place.append(events[100:])
        ear.until_heard(after(events, 100))
    warned = [line for line in logs if "begins at the newest" in line["event"]]
    assert [(line["log_level"], line["position"]) for line in warned] == [("warning", 100)]


def test_a_new_folder_warns_nobody(tmp_path: Path) -> None:
    place = Place(tmp_path / "outbox.sqlite")
    with capture_logs() as logs, place.opened():
        pass
    assert logs == []


def test_a_ledger_from_a_backup_takes_back_what_it_lacks(tmp_path: Path) -> None:
    events = told_history(6, 200, {OPENED: ALL})
    place = Place(tmp_path / "outbox.sqlite")
    with place.opened() as (_, ear):
        place.append(events)
        ear.until_heard(list(expected(events)))
    restored = Place(place.path, events[:120])
    with capture_logs() as logs, restored.opened() as (outbox, ear):
        left = list(expected(events[:120]))
        ear.until_heard(left)
        assert len(outbox.waiting()) == len(left)
    said = next(line for line in logs if "backup" in line["event"])
    assert (said["log_level"], said["ledger"], said["outbox"]) == ("error", 120, len(events))
    assert said["callbacks"] == len(list(expected(events))) - len(left)


def test_the_outbox_of_another_ledger_is_set_aside(tmp_path: Path) -> None:
    events = told_history(7, 100, {OPENED: ALL})
    place = Place(tmp_path / "outbox.sqlite")
    with place.opened() as (_, ear):
        place.append(events)
        ear.until_heard(list(expected(events)))
    others = [msgspec.structs.replace(e, command=CommandId("other")) for e in events]
    with capture_logs() as logs, Place(place.path, others).opened() as (outbox, _):
        assert outbox.waiting() == []
    assert [line["why"] for line in logs if "why" in line] == ["the ledger is another one"]
    assert rows(tmp_path / "outbox.sqlite.aside") == len(list(expected(events)))


@pytest.mark.parametrize("damage", [b"", b"no database" * 500, None])
def test_a_file_that_cannot_be_read_is_set_aside(tmp_path: Path, damage: bytes | None) -> None:
    events = told_history(8, 100, {OPENED: ALL})
    place = Place(tmp_path / "outbox.sqlite")
    with place.opened() as (_, ear):
        place.append(events)
        ear.until_heard(list(expected(events)))
    if damage is None:  # another version
        connection = sqlite3.connect(place.path)
        connection.execute("PRAGMA user_version = 99")
        connection.close()
    else:
        place.path.write_bytes(damage)
    with place.opened() as (outbox, _):
        assert outbox.waiting() == []
    assert place.path.exists()


def test_with_too_many_waiting_no_more_are_taken_until_some_are_settled(tmp_path: Path) -> None:
    events = told_history(9, 3_000, {OPENED: ALL})
    place = Place(tmp_path / "outbox.sqlite", events[:10])
    place_max = 20
    with place.opened():
        pass
    place.append(events[10:])
    wanted = after(events, 10)
    with place.opened(callbacks_max=place_max) as (outbox, ear):
        ear.until(lambda: len(ear.callbacks) >= place_max)
        first = len(ear.callbacks)
        assert first < len(wanted)
        assert outbox.behind > 0
        settled = 0
        while settled < len(wanted):
            ear.until_more_than(settled)
            noted = [outbox.settle(callback.number) for callback in ear.callbacks[settled:]]
            for one in noted:
                one.result(WAIT_S)
            settled += len(noted)
        assert heard(ear.callbacks) == wanted


def test_after_the_disk_failed_it_goes_on_without_a_gap(tmp_path: Path) -> None:
    events = told_history(10, 200, {OPENED: ALL})
    place = Place(tmp_path / "outbox.sqlite", events[:10])
    mended: list[bool] = []

    def mend() -> None:
        """After a failure the state is fetched anew, on the outbox's own thread."""
        with closing(sqlite3.connect(place.path)) as connection:
            connection.execute("DROP TRIGGER full")
        mended.append(True)

    with capture_logs() as logs, place.opened(folding=mend) as (_, ear):
        with closing(sqlite3.connect(place.path)) as connection:
            connection.execute(
                "CREATE TRIGGER full BEFORE INSERT ON callbacks "
                "BEGIN SELECT RAISE(ABORT, 'the disk is full'); END"
            )
        place.append(events[10:])
        ear.until_heard(after(events, 10))
    assert mended == [True], "it failed once"
    said = [line["reason"] for line in logs if line["event"] == "outbox falls behind"]
    assert said == ["the disk is full"]


def test_the_position_is_noted_although_nobody_wants_to_hear_anything(tmp_path: Path) -> None:
    count = POSITIONS_APART + 10
    events = told_history(11, count, {})
    place = Place(tmp_path / "outbox.sqlite")
    with place.opened() as (outbox, _):
        place.append(events)
        outbox.settle(0).result(WAIT_S)
    connection = sqlite3.connect(place.path)
    (position,) = connection.execute("SELECT position FROM followed").fetchone()
    connection.close()
    assert position > 0
