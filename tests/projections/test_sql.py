"""One question over what is on disk, and nothing else."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import duckdb
import pytest

from ledger.errors import Refused
from ledger.events import OrderAssigned
from ledger.scan import read_folder
from ledger.store import FileLedger
from projections.analytics import Analytics
from projections.sql import FILE, Breaker, SqlAnswer, ask, run_sql
from projections.sql_views import VIEWS, views_page
from tests.projections.past import Log, all_orders, long_log

LOG = long_log()
UP_TO = 400  # of the tables that the server has left behind


def tables(path: Path | None, log: Log) -> Analytics:
    newest = len(log.events)
    made = Analytics.open(path, log.read, log.fleet_at, newest)
    made.catch_up(log.read, newest)
    return made


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a ledger of 600 events and tables of the first 400."""
    folder = tmp_path_factory.mktemp("data")
    ledger = FileLedger.open(folder / "ledger")
    for start in range(0, len(LOG.events), 50):
        ledger.append(LOG.events[start : start + 50], start)
    ledger.close()
    tables(folder / FILE, Log(LOG.events[:UP_TO])).close()
    return folder


def run(data: Path, statement: str) -> SqlAnswer:
    return run_sql(data, statement, partial(read_folder, data / "ledger"))


def put(analytics: Analytics, statement: str, **limits: float) -> SqlAnswer:
    cursor = analytics.cursor()
    seconds_max = limits.pop("seconds_max", 20.0)
    rows = {name: int(limit) for name, limit in limits.items()}
    return ask(cursor, statement, Breaker(cursor, seconds_max), seconds_max=seconds_max, **rows)


def check_all(data: Path) -> None:
    orders = all_orders(LOG)
    answer = run(data, "SELECT id, status FROM orders ORDER BY id")
    assert [column.name for column in answer.columns] == ["id", "status"]
    assert list(answer.rows) == [[id_, orders[id_].status.value] for id_ in sorted(orders)]
    assert answer.position == 600
    (row,) = run(data, "SELECT count(*), max(position) FROM events").rows
    assert row == [600, 600]
    (row,) = run(data, "SELECT count(*) FROM steps").rows
    assert row == [sum(len(order.steps) for order in orders.values())]
    fleet = LOG.fleet_at(600)
    answer = run(data, "SELECT name FROM robots WHERE online ORDER BY name")
    assert list(answer.rows) == sorted([r.name] for r in fleet.robots.values() if r.online)


def test_the_views_show_every_order_step_event_and_robot(data: Path) -> None:
    check_all(data)


def test_it_works_while_a_server_holds_the_tables(
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
    run(data, "SELECT 1")
    assert contents() == before


def test_a_folder_without_events_has_empty_views(tmp_path: Path) -> None:
    FileLedger.open(tmp_path / "ledger").close()
    assert run(tmp_path, "SELECT * FROM orders").rows == ()


@pytest.mark.parametrize("damage", [b"", b"not a database", b"\0" * 20_000])
def test_damaged_tables_are_made_anew(tmp_path: Path, damage: bytes) -> None:
    (tmp_path / FILE).write_bytes(damage)
    made = tables(tmp_path / FILE, LOG)
    assert put(made, "SELECT count(*) FROM events").rows == ([600],)
    made.close()


@pytest.mark.parametrize("other", [long_log(seed=8), Log(LOG.events[:100])], ids=["other", "older"])
def test_tables_of_another_ledger_are_made_anew(tmp_path: Path, other: Log) -> None:
    tables(tmp_path / FILE, LOG).close()
    made = tables(tmp_path / FILE, other)
    expected = len(other.events)
    assert put(made, "SELECT count(*), max(position) FROM events").rows == ([expected] * 2,)
    assert put(made, "SELECT count(*) FROM orders").rows == ([len(all_orders(other))],)
    made.close()


def test_tables_that_grew_by_pieces_are_those_made_at_once(tmp_path: Path) -> None:
    for until in (1, 57, 58, 311, len(LOG.events)):
        tables(tmp_path / FILE, Log(LOG.events[:until])).close()
    grown, whole = tables(tmp_path / FILE, LOG), tables(None, LOG)
    for view in VIEWS:
        statement = f"SELECT * FROM {view.name} ORDER BY ALL"
        assert put(grown, statement).rows == put(whole, statement).rows, view.name
    grown.close()
    whole.close()


@pytest.fixture(scope="module")
def whole() -> Iterator[Analytics]:
    made = tables(None, LOG)
    yield made
    made.close()


def test_every_candidate_of_an_assignment_is_a_row(whole: Analytics) -> None:
    assigned = [e for e in LOG.events if isinstance(e, OrderAssigned)]
    rows = put(
        whole, "SELECT position, robot, cost_s FROM allocations WHERE chosen ORDER BY position"
    ).rows
    assert list(rows) == [[e.position, e.robot, e.cost_s] for e in assigned]


def test_robots_are_in_one_state_at_a_time_without_a_gap(whole: Analytics) -> None:
    rows = put(
        whole,
        "SELECT robot, began_on, ended_on, lead(began_on) OVER "
        "(PARTITION BY scene_id, robot ORDER BY began_on, position) AS next FROM robot_states "
        "QUALIFY ended_on IS DISTINCT FROM next",
    ).rows
    assert rows == ()


def test_what_lasts_now_is_the_state_of_now(whole: Analytics) -> None:
    fleet = LOG.fleet_at(600)
    rows = put(
        whole,
        "SELECT robot, online, off_duty, disabled, orders FROM robot_states "
        "WHERE ended_on IS NULL ORDER BY robot",
    ).rows
    expected = sorted(
        [r.name, r.online, r.off_duty, r.config.disabled, len(r.orders)]
        for r in fleet.robots.values()
    )
    assert list(rows) == expected
    faulted = sorted([o.id] for o in fleet.orders.values() if o.fault_reason is not None)
    rows = put(
        whole, "SELECT order_id FROM faults WHERE ended_on IS NULL AND \"of\" = 'Order' ORDER BY 1"
    ).rows
    assert list(rows) == faulted
    waiting = sorted([o.id] for o in fleet.orders.values() if o.robot is None)
    rows = put(
        whole,
        "SELECT order_id FROM waits WHERE ended_on IS NULL AND phase = 'Assignment' ORDER BY 1",
    ).rows
    assert list(rows) == waiting
    rows = put(whole, "SELECT unit_id FROM reservations WHERE ended_on IS NULL ORDER BY 1").rows
    assert list(rows) == sorted([id_] for id_ in fleet.claims)


@pytest.mark.parametrize(
    ("expression", "type_", "value"),
    [
        ("TIMESTAMP '2026-11-22 10:00:00.5'", "TIMESTAMP", "2026-11-22T10:00:00.500000Z"),
        (
            "TIMESTAMPTZ '2026-11-22 10:00:00+02'",
            "TIMESTAMP WITH TIME ZONE",
            "2026-11-22T08:00:00Z",
        ),
        ("DATE '2026-11-22'", "DATE", "2026-11-22"),
        ("TIME '10:00:01'", "TIME", "10:00:01"),
        ("INTERVAL 90 MINUTE", "INTERVAL", "P0M0DT5400S"),
        ("1.25", "DECIMAL(3,2)", 1.25),
        ("12345678901234567890.25::DECIMAL(30,2)", "DECIMAL(30,2)", "12345678901234567890.25"),
        ("sum(1)", "HUGEINT", 1),
        ("'NaN'::DOUBLE", "DOUBLE", None),
        ("'-inf'::DOUBLE", "DOUBLE", None),
        ("[1.5::DOUBLE, 'NaN']", "DOUBLE[]", [1.5, None]),
        (
            "{'a': [TIMESTAMP '2026-11-22']}",
            "STRUCT(a TIMESTAMP[])",
            {"a": ["2026-11-22T00:00:00Z"]},
        ),
        ("MAP {'a': 1}", "MAP(VARCHAR, INTEGER)", {"a": 1}),
        ("'ab'::BLOB", "BLOB", "6162"),
        ("TIMESTAMP '290000-01-01'", "TIMESTAMP", "<value out of range: 9089348860800000000>"),
        ("[TIMESTAMP '290000-01-01']", "TIMESTAMP[]", "out of range"),
        ("'[1]'::JSON", "JSON", "[1]"),
        ("NULL", '"NULL"', None),
    ],
)
def test_values_are_safe_for_json(
    whole: Analytics, expression: str, type_: str, value: object
) -> None:
    answer = put(whole, f"SELECT {expression} AS x")
    assert (answer.columns[0].name, answer.columns[0].type) == ("x", type_)
    assert answer.rows == ([value],)


@pytest.mark.parametrize(
    "statement",
    [
        "EXPLAIN SELECT * FROM orders",
        "explain analyze SELECT count(*) FROM events",
        "DESCRIBE orders",
        "SUMMARIZE waits",
        "TABLE robots",
        "FROM orders",
        "VALUES (1)",
        "WITH a AS (SELECT 1 AS x), b AS (FROM a) FROM b JOIN a USING (x)",
        "WITH RECURSIVE t(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM t WHERE n < 5) FROM t",
        "SELECT * FROM (WITH a AS (SELECT 1) FROM a), LATERAL (SELECT 2)",
        "SELECT body ->> 'type' FROM events LIMIT 1",
        "UNPIVOT (SELECT 1 AS a, 2 AS b) ON a, b",
        "PIVOT orders ON status IN ('Done') USING count(*)",
        "SELECT * FROM main.orders -- a remark",
    ],
)
def test_questions_are_answered(whole: Analytics, statement: str) -> None:
    put(whole, statement)


@pytest.mark.parametrize(
    "statement",
    [
        "DELETE FROM events_all",
        "DROP TABLE events_all",
        "CREATE TABLE t AS SELECT 1",
        "CREATE TEMP MACRO m() AS 1",
        "INSERT INTO events_all SELECT * FROM events",
        "UPDATE checkpoint SET position = 1",
        "SELECT 1; SELECT 2",
        "SELECT 1; DROP TABLE events_all",
        "COPY events TO 'x.csv'",
        "COPY (SELECT 1) TO 'x.parquet'",
        "EXPLAIN COPY events TO 'x.csv'",
        "EXPORT DATABASE 'x'",
        "IMPORT DATABASE 'x'",
        "ATTACH 'x.db'",
        "DETACH memory",
        "USE memory",
        "SET threads = 1",
        "RESET threads",
        "PRAGMA version",
        "CALL pragma_version()",
        "INSTALL httpfs",
        "LOAD httpfs",
        "BEGIN",
        "COMMIT",
        "CHECKPOINT",
        "VACUUM",
        "PREPARE p AS SELECT 1",
        "EXECUTE p",
        "CREATE SECRET s (TYPE s3)",
        "SHOW TABLES",
        "SHOW ALL TABLES",
        "SHOW DATABASES",
        "",
        "SELECT * FROM orders_done",
        "SELECT * FROM checkpoint",
        "SELECT * FROM duckdb_settings()",
        "SELECT * FROM duckdb_settings",
        "SELECT * FROM duckdb_secrets()",
        "SELECT * FROM pragma_database_list",
        "SELECT * FROM information_schema.tables",
        "SELECT * FROM sqlite_master",
        "SELECT * FROM (WITH duckdb_settings AS (SELECT 1) FROM duckdb_settings), duckdb_settings",
        "WITH duckdb_settings AS (FROM duckdb_settings) FROM duckdb_settings",
        "SELECT current_setting('temp_directory')",
        "SELECT 'temp_directory'.current_setting()",
        "SELECT getvariable('x')",
        "SELECT pg_sleep(1)",
        "SELECT * FROM query('SELECT 1')",
        "SELECT * FROM query_table('orders_done')",
        "SELECT * FROM read_csv('/etc/passwd')",
        "SELECT * FROM read_text('/etc/passwd')",
        "SELECT * FROM '/etc/passwd'",
        "SELECT * FROM glob('/*')",
        "SELECT * FROM read_parquet('https://example.com/x.parquet')",
        "SELECT (SELECT count(*) FROM read_blob('/etc/passwd'))",
        "SELECT * FROM sniff_csv('/etc/passwd')",
        "FROM parquet_scan('x')",
        "SELECT * FROM LOG",
    ],
)
def test_all_else_is_not_allowed(whole: Analytics, statement: str) -> None:
    with pytest.raises(Refused) as refused:
        put(whole, statement)
    assert refused.value.code == "errSqlNotAllowed"


@pytest.mark.parametrize(
    "statement",
    ["SELECT nonsense", "SELEKT 1", "SELECT $1", "SELECT '\0'", "SELECT '\ud800'", "SELECT 1/'a'"],
)
def test_nonsense_is_refused_in_words_of_duckdb(whole: Analytics, statement: str) -> None:
    with pytest.raises(Refused) as refused:
        put(whole, statement)
    assert refused.value.code == "errSqlInvalid"


def test_the_database_itself_has_every_door_shut(whole: Analytics) -> None:
    cursor = whole.cursor()
    for statement in (
        "SELECT * FROM read_csv('/etc/passwd')",
        "COPY (SELECT 1) TO 'x.csv'",
        "ATTACH 'x.db'",
        "SET threads = 1",
        "SET enable_external_access = true",
        "INSTALL httpfs",
    ):
        with pytest.raises(duckdb.Error):
            cursor.execute(statement)
    cursor.execute("BEGIN TRANSACTION READ ONLY")
    with pytest.raises(duckdb.Error, match="read-only"):
        cursor.execute("DELETE FROM events_all")
    cursor.close()


def test_time_is_limited(whole: Analytics) -> None:
    with pytest.raises(Refused, match=r"longer than 0\.05 s"):
        put(
            whole,
            "SELECT count(*) FROM range(1000000000000) t(i) WHERE sin(i) > 2",
            seconds_max=0.05,
        )


def test_rows_and_bytes_are_limited(whole: Analytics) -> None:
    answer = put(whole, "FROM range(10)", rows_max=3)
    assert (answer.rows, answer.cut) == (([0], [1], [2]), True)
    assert not put(whole, "FROM range(3)", rows_max=3).cut
    assert put(whole, "FROM range(1000000000000)", rows_max=3).cut
    with pytest.raises(Refused, match="more than 1000 bytes"):
        put(whole, "FROM range(100000)", bytes_max=1000)


def test_every_view_and_column_is_documented_as_it_is(whole: Analytics) -> None:
    page = views_page()
    for view in VIEWS:
        assert f"## {view.name}" in page
        assert view.doc.endswith(".")
        described = put(whole, f"DESCRIBE {view.name}").rows
        assert [row[:2] for row in described] == [[c.name, c.type] for c in view.columns]
        for column in view.columns:
            assert f"| `{column.name}` |" in page
            assert column.doc.endswith(".")
