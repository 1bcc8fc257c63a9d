"""The DuckDB file follows the log, and may be lost at any time."""

from pathlib import Path

import duckdb
import pytest

from ledger.events.orders import OfOrder
from projections.history import QUEUE_EVENTS_MAX, History
from projections.live import Live
from tests.projections.past import Log, all_orders, long_log

LOG = long_log()
PATIENCE_S = 20.0
ENDED = sorted(id_ for id_, order in all_orders(LOG).items() if order.terminal)


def opened(path: Path, log: Log = LOG) -> tuple[History, Live]:
    live = Live(log.fleet_at(len(log.events)))
    history = History(path, live)
    history.start(log.read, log.fleet_at, PATIENCE_S)
    return history, live


def contents(history: History) -> tuple[list[str], list[int], int]:
    return *rows(history.cursor()), history.position


def rows(cursor: duckdb.DuckDBPyConnection) -> tuple[list[str], list[int]]:
    ids = cursor.execute("SELECT id FROM orders_done ORDER BY id").fetchall()
    events = cursor.execute("SELECT position FROM order_events ORDER BY position").fetchall()
    return [id_ for (id_,) in ids], [position for (position,) in events]


def whole(log: Log = LOG) -> tuple[list[str], list[int], int]:
    ended = sorted(str(id_) for id_, order in all_orders(log).items() if order.terminal)
    of_orders = [event.position for event in log.events if isinstance(event, OfOrder)]
    return ended, of_orders, len(log.events)


WHOLE = whole()


def test_a_missing_file_is_built_from_the_log(tmp_path: Path) -> None:
    history, _ = opened(tmp_path / "history.duckdb")
    assert contents(history) == WHOLE
    history.close()


def test_a_restart_goes_on_from_the_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "history.duckdb"
    part = Log(LOG.events[:311])
    history, _ = opened(path, part)
    history.close()
    live = Live(LOG.fleet_at(len(LOG.events)))
    history = History(path, live)
    asked: list[int] = []

    def read(after: int) -> object:
        asked.append(after)
        return LOG.read(after)

    history.start(read, LOG.fleet_at)  # type: ignore[arg-type]
    assert contents(history) == WHOLE
    assert min(asked) == 310  # one before the checkpoint, to see that the log is the same
    history.close()


@pytest.mark.parametrize("damage", [b"", b"not a database", b"\0" * 20_000])
def test_a_damaged_file_is_built_anew(tmp_path: Path, damage: bytes) -> None:
    path = tmp_path / "history.duckdb"
    path.write_bytes(damage)
    history, _ = opened(path)
    assert contents(history) == WHOLE
    history.close()


def test_a_file_cut_short_is_built_anew(tmp_path: Path) -> None:
    path = tmp_path / "history.duckdb"
    history, _ = opened(path)
    history.close()
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    history, _ = opened(path)
    assert contents(history) == WHOLE
    history.close()


def test_a_file_ahead_of_the_log_is_built_anew(tmp_path: Path) -> None:
    path = tmp_path / "history.duckdb"
    history, _ = opened(path)
    history.close()
    part = Log(LOG.events[:100])
    history, _ = opened(path, part)
    assert contents(history) == whole(part)
    history.close()


def test_a_file_of_another_log_is_built_anew(tmp_path: Path) -> None:
    path = tmp_path / "history.duckdb"
    history, _ = opened(path, long_log(seed=8))
    history.close()
    history, _ = opened(path)
    assert contents(history) == WHOLE
    history.close()


def test_a_file_of_another_version_is_built_anew(tmp_path: Path) -> None:
    path = tmp_path / "history.duckdb"
    history, _ = opened(path)
    history.close()
    with duckdb.connect(str(path)) as connection:
        connection.execute("UPDATE checkpoint SET version = 0")
    history, _ = opened(path)
    assert contents(history) == WHOLE
    history.close()


def test_the_followed_file_is_the_rebuilt_file(tmp_path: Path) -> None:
    start = Log(LOG.events[:3])
    history, live = opened(tmp_path / "history.duckdb", start)
    for first in range(3, len(LOG.events), 40):
        events = LOG.events[first : first + 40]
        start.events += events
        live.apply(events)
        history.follow(events)
    history.close()
    history, _ = opened(tmp_path / "history.duckdb")
    history_rows = history.cursor().execute("SELECT * FROM orders_done ORDER BY id").fetchall()
    history.close()
    other, _ = opened(tmp_path / "other.duckdb")
    assert other.cursor().execute("SELECT * FROM orders_done ORDER BY id").fetchall() == (
        history_rows
    )
    other.close()


def test_live_forgets_ended_orders_once_they_are_committed(tmp_path: Path) -> None:
    start = Log(LOG.events[:3])
    history, live = opened(tmp_path / "history.duckdb", start)
    start.events = list(LOG.events)
    live.apply(LOG.events[3:])
    assert sorted(live.finished) == ENDED
    history.follow(LOG.events[3:])
    wait_for(history, len(LOG.events))
    assert not live.finished
    assert contents(history) == WHOLE
    history.close()


def test_events_that_overflow_the_queue_are_read_from_the_log(tmp_path: Path) -> None:
    start = Log(LOG.events[:3])
    history, live = opened(tmp_path / "history.duckdb", start)
    start.events = list(LOG.events)
    live.apply(LOG.events[3:])
    many = LOG.events[3:] * (QUEUE_EVENTS_MAX // (len(LOG.events) - 3) + 1)
    history.follow(many)
    wait_for(history, len(LOG.events))
    assert contents(history) == WHOLE
    history.close()


def wait_for(history: History, position: int) -> None:
    with history.moved:
        assert history.moved.wait_for(lambda: history.position >= position, timeout=20)
