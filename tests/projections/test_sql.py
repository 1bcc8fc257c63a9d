"""`fleetledger sql`: one SELECT over what is on disk, and nothing else."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import duckdb
import pytest

from ledger.errors import Refused
from ledger.scan import read_folder
from ledger.store import FileLedger
from projections.archive import Archive
from projections.history import History
from projections.live import Live
from projections.sql import SqlAnswer, query, run_sql
from projections.sql_views import VIEWS, views_page
from tests.projections.past import Log, all_orders, long_log

LOG = long_log()


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a ledger of 600 events and a history of the first 400."""
    folder = tmp_path_factory.mktemp("data")
    ledger = FileLedger.open(folder / "ledger")
    for start in range(0, len(LOG.events), 50):
        ledger.append(LOG.events[start : start + 50], start)
    ledger.close()
    part = Log(LOG.events[:400])
    history = History(folder / "history.duckdb", Live(part.fleet_at(400)))
    history.start(part.read, part.fleet_at)
    history.close()
    return folder


def ask(data: Path, statement: str) -> SqlAnswer:
    return run_sql(data, statement, partial(read_folder, data / "ledger"))


def check_all(data: Path) -> None:
    orders = all_orders(LOG)
    answer = ask(data, "SELECT id, status FROM orders ORDER BY id")
    assert answer.columns == ("id", "status")
    assert answer.rows == tuple((id_, orders[id_].status.value) for id_ in sorted(orders))
    (row,) = ask(data, "SELECT count(*), max(position) FROM events").rows
    assert row == (600, 600)
    (row,) = ask(data, "SELECT count(*) FROM steps").rows
    assert row == (sum(len(order.steps) for order in orders.values()),)
    fleet = LOG.fleet_at(600)
    answer = ask(data, "SELECT name FROM robots WHERE online ORDER BY name")
    assert answer.rows == tuple(sorted((r.name,) for r in fleet.robots.values() if r.online))


def test_the_views_show_every_order_step_event_and_robot(data: Path) -> None:
    check_all(data)


def test_it_works_while_a_server_holds_the_history(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = duckdb.connect

    def held(path: str, *args: object, **more: object) -> object:
        if str(data) in path:
            raise duckdb.IOException("Could not set lock on file")
        return real(path, *args, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(duckdb, "connect", held)
    check_all(data)


def test_nothing_in_the_folder_is_changed(data: Path) -> None:
    def contents() -> dict[str, bytes]:
        return {str(p): p.read_bytes() for p in data.rglob("*") if p.is_file()}

    before = contents()
    ask(data, "SELECT 1")
    assert contents() == before


def test_times_are_timestamps(data: Path) -> None:
    (row,) = ask(data, "SELECT min(created_on)::VARCHAR FROM orders").rows
    assert row[0].startswith("2026-09-21")


def test_a_folder_without_events_has_empty_views(tmp_path: Path) -> None:
    FileLedger.open(tmp_path / "ledger").close()
    assert ask(tmp_path, "SELECT * FROM orders").rows == ()


@pytest.fixture
def connection() -> Iterator[duckdb.DuckDBPyConnection]:
    archive = Archive.open(None)
    yield archive.cursor()
    archive.close()


@pytest.mark.parametrize(
    "statement",
    [
        "DELETE FROM events",
        "DROP TABLE events",
        "CREATE TABLE t AS SELECT 1",
        "INSERT INTO events SELECT * FROM events",
        "SELECT 1; SELECT 2",
        "COPY events TO 'x.csv'",
        "ATTACH 'x.db'",
        "SET threads = 1",
        "PRAGMA version",
        "CALL pragma_version()",
        "INSTALL httpfs",
        "",
    ],
)
def test_only_one_select_is_allowed(connection: duckdb.DuckDBPyConnection, statement: str) -> None:
    with pytest.raises(Refused) as refused:
        query(connection, statement)
    assert refused.value.code == "errSqlNotAllowed"


@pytest.mark.parametrize(
    "statement",
    [
        "SELECT * FROM read_csv('/etc/passwd')",
        "SELECT * FROM read_text('/etc/passwd')",
        "SELECT * FROM '/etc/passwd'",
        "SELECT * FROM glob('/*')",
        "SELECT * FROM read_parquet('https://example.com/x.parquet')",
        "SELECT nonsense",
        "SELEKT 1",
    ],
)
def test_files_network_and_nonsense_are_refused(
    connection: duckdb.DuckDBPyConnection, statement: str
) -> None:
    with pytest.raises(Refused) as refused:
        query(connection, statement)
    assert refused.value.code == "errSqlInvalid"


def test_python_variables_are_out_of_reach(connection: duckdb.DuckDBPyConnection) -> None:
    with pytest.raises(Refused):
        query(connection, "SELECT * FROM LOG")


def test_time_is_limited(connection: duckdb.DuckDBPyConnection) -> None:
    with pytest.raises(Refused, match=r"longer than 0\.05 s"):
        query(
            connection,
            "SELECT count(*) FROM range(1000000000000) t(i) WHERE sin(i) > 2",
            seconds_max=0.05,
        )


def test_rows_are_limited(connection: duckdb.DuckDBPyConnection) -> None:
    answer = query(connection, "FROM range(10)", rows_max=3)
    assert (answer.rows, answer.cut) == (((0,), (1,), (2,)), True)


def test_every_view_and_column_is_documented() -> None:
    page = views_page()
    for view in VIEWS:
        assert f"## {view.name}" in page
        assert view.doc.endswith(".")
        for column in view.columns:
            assert f"| `{column.name}` |" in page
            assert column.doc
