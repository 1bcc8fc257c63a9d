"""The history is mended while others are served: right answers, or none yet."""

import asyncio
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event as Flag
from typing import Any

import duckdb
import pytest

import projections.archive
from ledger.errors import Refused
from ledger.events import AnyEvent
from ledger.ids import OrderId
from projections.archive import Archive
from projections.history import History
from projections.live import Live
from projections.projector import Projector
from projections.reading import Rebuilding
from tests.projections.past import Log, Side, all_orders, long_log
from tests.projections.test_find import DONE, all_rows, asked, truth
from tests.projections.test_history import (
    LOG,
    PATIENCE_S,
    contents,
    opened,
    rows,
    whole,
)

LIVE_ONLY = {"type": "General", "field1": "doneOn", "operator": "Null"}
NAME = "history.duckdb"


class Gated(Side):
    """A read side whose history reads a ledger that stops at a gate."""

    def __init__(self, folder: Path, position: int, stop_at: int) -> None:
        self.gate, self.stop_at = Flag(), stop_at
        self.log = LOG
        self.live = Live(LOG.fleet_at(position))
        self.history = History(folder / NAME, self.live)
        self.history.start(self.read, LOG.fleet_at, wait_s=0)
        self._dress()

    def read(self, after: int) -> Iterator[AnyEvent]:
        for event in LOG.events[after : self.live.position]:
            if event.position > self.stop_at:
                assert self.gate.wait(PATIENCE_S)
            yield event


@pytest.fixture
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("projections.archive.CATCH_UP_EVENTS", 50)


async def test_while_it_is_rebuilt_answers_are_right_or_refused(
    tmp_path: Path, small_batches: None
) -> None:
    side = Gated(tmp_path, 500, stop_at=250)
    side.reach(250)
    now, find = truth(LOG, 500), side.find
    with pytest.raises(Rebuilding) as refused:
        await find.page(asked(DONE), 0, 5)
    assert (refused.value.status, refused.value.arguments) == (503, (50,))
    for query in (find.count(asked()), find.some(asked(), 0, 1), all_rows(find, asked())):
        with pytest.raises(Rebuilding):
            await query
    live = [row for row in now if row["doneOn"] is None]
    assert await all_rows(find, asked(LIVE_ONLY)) == live
    assert (await find.count(asked(LIVE_ONLY)))[0] == len(live)
    page = await find.page(asked(LIVE_ONLY), 2, 3)
    assert (list(page.rows), page.total) == (live[2:5], len(live))
    then = LOG.events[200].at_ms  # DuckDB is past it already
    until = max(e.position for e in LOG.events if e.at_ms <= then)
    assert await all_rows(find, asked(), then) == truth(LOG, until)
    refusals = 0
    for id_, order in all_orders(Log(LOG.events[:500])).items():
        try:
            assert await find.order(id_) == (order, 500)
        except Rebuilding:
            refusals += 1
            assert order.terminal
    assert 0 < refusals < sum(row["doneOn"] is not None for row in now)
    side.gate.set()
    side.reach(500)
    assert await all_rows(find, asked()) == now
    side.close()


async def test_an_order_that_was_never_made_is_unknown_even_then(
    tmp_path: Path, small_batches: None
) -> None:
    side = Gated(tmp_path, 500, stop_at=100)
    side.reach(100)
    day, count = next(iter(side.live.fleet.order_counts.items()))
    for id_ in ("TO1", f"TO{day}-{count + 1:06}", "TO19990101-000001"):
        assert (await side.find.order(OrderId(id_)))[0] is None
    side.gate.set()
    side.close()


async def test_what_ends_during_a_long_rebuild_needs_no_more_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_batches: None
) -> None:
    monkeypatch.setattr("projections.live.FINISHED_MAX", 8)
    monkeypatch.setattr("projections.live.FINISHED_LESS", 3)
    side = Gated(tmp_path, 250, stop_at=100)
    for until in range(260, 601, 20):
        side.go_on(until)
        assert len(side.live.finished) <= 8
        with pytest.raises(Rebuilding):
            await side.find.count(asked())
        for id_, order in side.live.finished.items():
            assert (await side.find.order(id_))[0] == order
    side.gate.set()
    side.reach(600)
    newest = sorted(truth(LOG, 600), key=lambda row: (-row["createdOn"], row["id"]))
    page = await side.find.page(asked(sort=["-createdOn"]), 0, 40)
    assert (list(page.rows), page.total) == (newest[:40], len(newest))
    side.close()


def flipped_start(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[random.Random(1).randrange(4096)] ^= 0x10
    path.write_bytes(data)


def zeroed_headers(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[: 3 * 4096] = bytes(3 * 4096)
    path.write_bytes(data)


def log_of_another(path: Path) -> None:
    """A crash left a write-ahead log, and it came beside another file."""
    other = path.parent / "other"
    other.mkdir()
    left_by_a_crash(other / NAME, long_log(seed=8))
    (other / (NAME + ".wal")).rename(path.parent / (NAME + ".wal"))


def older_log(path: Path) -> None:
    """Of the same file, from before its last checkpoint."""
    other = path.parent / "other"
    other.mkdir()
    left_by_a_crash(other / NAME, Log(LOG.events[:200]))
    (other / (NAME + ".wal")).rename(path.parent / (NAME + ".wal"))


def garbage_log(path: Path) -> None:
    (path.parent / (NAME + ".wal")).write_bytes(random.Random(2).randbytes(5_000))


def no_checkpoint(path: Path) -> None:
    with duckdb.connect(str(path)) as connection:
        connection.execute("DELETE FROM checkpoint")


def rows_lost(path: Path) -> None:
    with duckdb.connect(str(path)) as connection:
        connection.execute("DELETE FROM orders_done WHERE done_position % 7 = 0")


def rows_doubled(path: Path) -> None:
    with duckdb.connect(str(path)) as connection:
        connection.execute("INSERT INTO order_events SELECT * FROM order_events LIMIT 1")


DAMAGES: list[Callable[[Path], None]] = [
    flipped_start, zeroed_headers, log_of_another, older_log, garbage_log, no_checkpoint, rows_lost,
    rows_doubled,
]  # fmt: skip

CRASHING = """
import os, sys
from pathlib import Path
from projections.archive import Archive
from projections.projector import Projector
from ledger.state import Fleet
from tests.projections.past import Log, long_log
path, seed, count, size = Path(sys.argv[1]), *map(int, sys.argv[2:])
log, archive = Log(long_log(seed=seed).events[:count]), Archive.open(path)
projector = Projector(log.fleet_at(archive.position))
for event in log.read(archive.position):
    projector.take(event)
    if len(projector.events) == size:
        archive.commit(projector)
        print(archive.position, flush=True)
archive.commit(projector)
os._exit(9)  # nothing is closed
"""


def left_by_a_crash(path: Path, log: Log) -> None:
    seed = 8 if log.events[2] != LOG.events[2] else 56
    arguments = [str(path), str(seed), str(len(log.events)), "50"]
    done = subprocess.run([sys.executable, "-c", CRASHING, *arguments], stdout=subprocess.DEVNULL)
    assert done.returncode == 9 and path.with_name(NAME + ".wal").exists()


@pytest.mark.parametrize("damage", DAMAGES)
def test_whatever_happens_to_the_file_the_history_is_whole(
    tmp_path: Path, damage: Callable[[Path], None]
) -> None:
    path = tmp_path / NAME
    opened(path)[0].close()
    damage(path)
    history, _ = opened(path)
    assert contents(history) == whole()
    history.close()


def test_without_its_write_ahead_log_it_goes_on_from_its_last_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / NAME
    opened(path, Log(LOG.events[:200]))[0].close()
    left_by_a_crash(path, LOG)
    path.with_name(NAME + ".wal").unlink()
    history, _ = opened(path)
    assert contents(history) == whole()
    history.close()


def test_a_rebuild_that_is_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    path, chance = tmp_path / NAME, random.Random(3)
    reached = 0
    for _ in range(3):
        arguments = [str(path), "56", str(len(LOG.events)), "10"]
        rebuild = subprocess.Popen(
            [sys.executable, "-c", CRASHING, *arguments], stdout=subprocess.PIPE, text=True
        )
        assert rebuild.stdout is not None
        for _ in range(chance.randrange(2, 15)):
            reached = int(rebuild.stdout.readline() or reached)
        rebuild.kill()
        rebuild.wait()
        rebuild.stdout.close()
    archive = Archive.open(path)
    assert reached <= archive.position < len(LOG.events)
    archive.close()
    history, _ = opened(path)
    assert contents(history) == whole()
    history.close()


class Faulty:
    """A connection that fails at chosen COMMITs, before or after DuckDB has done them."""

    def __init__(self, connection: duckdb.DuckDBPyConnection, faults: list[str]) -> None:
        self._connection, self._faults = connection, faults

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    def execute(self, sql: str, *parameters: Any) -> Any:
        fault = self._faults.pop(0) if sql == "COMMIT" and self._faults else ""
        if fault == "before":
            raise duckdb.Error("the disk has gone")
        done = self._connection.execute(sql, *parameters)
        if fault == "after":
            raise duckdb.Error("the disk has gone after all")
        return done


@pytest.mark.parametrize("seed", range(2))
def test_a_commit_that_fails_is_neither_lost_nor_done_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_batches: None, seed: int
) -> None:
    chance, connect = random.Random(seed), projections.archive._connect
    faults = chance.choices(["", "before", "after"], k=12)
    monkeypatch.setattr("projections.archive._connect", lambda path: Faulty(connect(path), faults))
    monkeypatch.setattr("projections.history.RETRY_S", 0.0)
    monkeypatch.setattr("projections.history.RETRY_S_MAX", 0.0)
    history, _ = opened(tmp_path / NAME)
    assert contents(history) == whole()
    assert not faults
    history.close()


async def test_damage_that_a_query_finds_is_mended_while_serving(tmp_path: Path) -> None:
    """Every block of the file is spoilt once: answers are right, or refused for a while."""
    source = tmp_path / "sound"
    source.mkdir()
    side = Side(source, LOG, 600)
    side.close()
    sound = (source / NAME).read_bytes()
    expected, refusals = truth(LOG, 600), 0
    for start in range(3 * 4096, len(sound), 256 * 1024):
        spoilt = bytearray(sound)
        spoilt[start + 100 : start + 3_000] = random.Random(start).randbytes(2_900)
        folder = tmp_path / str(start)
        folder.mkdir()
        (folder / NAME).write_bytes(spoilt)
        side = Side(folder, LOG, 600)
        for _ in range(100):
            try:
                assert await all_rows(side.find, asked()) == expected
                assert await side.reader.run(lambda cursor: rows(cursor)) == whole()[:2]
                break
            except Rebuilding:
                refusals += 1
                side.reach(600)
        assert contents(side.history) == whole()
        side.close()
    assert refusals  # or nothing was found at run time


async def test_a_query_under_way_does_not_keep_a_bad_file_open(tmp_path: Path) -> None:
    side = Side(tmp_path, LOG, 600)
    endless = "SELECT count(*) FROM range(1000000000000) numbers(i) WHERE sin(i) > 2"
    begun = asyncio.Event()
    loop = asyncio.get_running_loop()

    def query(cursor: duckdb.DuckDBPyConnection) -> None:
        loop.call_soon_threadsafe(begun.set)
        cursor.execute(endless)

    asking = asyncio.create_task(side.reader.run(query))
    await begun.wait()
    side.history.damaged(duckdb.IOException("Corrupt database file"))
    with pytest.raises(Rebuilding):
        await asking
    side.reach(600)
    assert contents(side.history) == whole()
    side.close()


def test_a_full_disk_does_not_cost_the_file(tmp_path: Path) -> None:
    assert not projections.archive.is_damage(duckdb.IOException("No space left on device"))
    assert projections.archive.is_damage(duckdb.IOException("Corrupt database file: checksum"))
    assert issubclass(Rebuilding, Refused)


def test_a_checkpoint_never_moves_from_elsewhere(tmp_path: Path) -> None:
    archive = Archive.open(tmp_path / NAME)
    projector = Projector(LOG.fleet_at(0))
    for event in LOG.events[:10]:
        projector.take(event)
    archive._connection.execute("UPDATE checkpoint SET position = 5")
    with pytest.raises(AssertionError, match="checkpoint"):
        archive.commit(projector)
    archive.close()
