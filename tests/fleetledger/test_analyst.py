"""POST /api/sql of a real server: hostile statements end, and hurt nobody but themselves."""

import json
import os
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import hypothesis
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fleetledger.server import Server, serving, small_scene

SECONDS_MAX = 1.0
MEMORY_MB = 300
LIMITS = f"sql_seconds = {SECONDS_MAX}\nsql_memory_mb = {MEMORY_MB}\n"
STAGE_S = 40.0
ANSWER_S_MAX = 20.0  # on a busy machine; a statement itself has a second and some grace
ENDLESS = "SELECT count(*) FROM range(1000000000000) t(i) WHERE sin(i) > 2"
CANARY = "canary-4711"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("server")
    data = folder / "data"
    data.mkdir()
    (data / "config.toml").write_text(LIMITS)
    (folder / "canary.csv").write_text(f"{CANARY}\n")
    with serving(data, "--auth", "none", "--scene", str(small_scene(folder))) as running:
        yield running


def ask(server: Server, sql: str, **more: Any) -> httpx.Response:
    body = json.dumps({"sql": sql, **more}).encode("utf-8", "surrogatepass")
    headers = {"content-type": "application/json"}
    return server.client.post("/api/sql", content=body, headers=headers)


def answered(server: Server, sql: str, **more: Any) -> Any:
    """Ask until there is room, or the process is there again."""
    for _ in range(60):
        answer = ask(server, sql, **more)
        if answer.status_code != 503:
            break
        assert int(answer.headers["retry-after"]) > 0
        time.sleep(0.2)  # Retry-After, cut short: a client has nothing else to wait for
    assert answer.status_code == 200, answer.text
    return answer.json()


def scene_events(server: Server) -> int:
    return int(server.get("/api/ledger/position")["position"])


def test_an_answer_has_columns_rows_and_its_position(server: Server) -> None:
    found = answered(server, "SELECT count(*) AS n, max(position) AS newest FROM events")
    newest = found["position"]
    assert found == {
        "columns": [{"name": "n", "type": "BIGINT"}, {"name": "newest", "type": "BIGINT"}],
        "rows": [[newest, newest]],
        "cut": False,
        "position": newest,
    }
    cut = answered(server, "FROM range(10)", maxRows=3)
    assert (cut["rows"], cut["cut"]) == ([[0], [1], [2]], True)


def test_what_was_acknowledged_is_seen_at_once(server: Server) -> None:
    scene = server.scene
    for paused in (True, False) * 3:
        path = f"/api/fleet/scenes/{scene}/dispatch-pause"
        server.post(path, {"paused": paused})
        newest = scene_events(server)
        found = answered(server, "SELECT max(position) FROM events")
        assert found["rows"][0][0] >= newest


@pytest.mark.parametrize(
    ("sql", "status", "code"),
    [
        ("SELEKT", 400, "errSqlInvalid"),
        ("DROP VIEW orders", 400, "errSqlNotAllowed"),
        ("SELECT '\0'", 400, "errSqlInvalid"),
        ("SELECT '\ud800'", 400, "errBadJson"),
        ("x" * 30_000, 400, "errFieldInvalid"),
        (ENDLESS, 504, "errSqlTooSlow"),
        ("WITH RECURSIVE t(n) AS (SELECT 1 UNION ALL SELECT n FROM t) FROM t WHERE n = 2", 504, ""),
        ("SELECT length(repeat('x', 2000000000))", 400, "errSqlTooLarge"),
        ("SELECT max(length(repeat('x', 20000000) || i)) FROM range(300) t(i)", 400, ""),
        ("SELECT length(range(200000000))", 400, "errSqlTooLarge"),
        ("SELECT repeat('x', 20000000)", 400, "errSqlTooLarge"),
        ("SELECT length(string_agg(repeat('x', 1000))) FROM range(900000)", 400, ""),
    ],
)
def test_no_statement_takes_more_than_it_gets(
    server: Server, sql: str, status: int, code: str
) -> None:
    answered(server, "SELECT 1")
    answer = ask(server, sql)
    assert answer.status_code in (status, 504), answer.text
    assert answer.json()["code"].startswith(code if answer.status_code == status else "")
    answered(server, "SELECT 1")


@pytest.mark.parametrize("body", [b"", b"[]", b'{"sql": 5}', b'{"sql": "SELECT 1", "maxRows": 0}'])
def test_what_is_no_question_is_refused(server: Server, body: bytes) -> None:
    answer = server.client.post("/api/sql", content=body)
    assert answer.status_code == 400
    assert answer.json()["code"].startswith("err")


def test_a_statement_deaf_to_interrupts_is_killed_and_the_next_is_answered(server: Server) -> None:
    """DuckDB binds this for half a minute, and takes a gigabyte, before it hears anything."""
    answered(server, "SELECT 1")
    began = time.monotonic()
    answer = ask(server, "SELECT a" + ".a" * 9_900)
    assert answer.status_code in (400, 504), answer.text
    assert time.monotonic() - began < ANSWER_S_MAX + 20
    answered(server, "SELECT 1")


def test_two_run_and_a_third_is_told_to_come_again(server: Server) -> None:
    answered(server, "SELECT 1")
    found: list[httpx.Response] = []
    threads = [
        threading.Thread(target=lambda: found.append(ask(server, ENDLESS))) for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    codes = sorted(answer.json()["code"] for answer in found)
    assert codes == ["errSqlBusy", "errSqlTooSlow", "errSqlTooSlow"], [a.text for a in found]


def test_commands_and_other_queries_go_on_beside_it(server: Server) -> None:
    answered(server, "SELECT 1")
    slow = threading.Thread(target=ask, args=(server, ENDLESS))
    slow.start()
    asked = 0
    while slow.is_alive():
        server.post("/api/entity/find/many", {"entityName": "TransportOrder"})
        asked += 1
    assert asked > 10
    slow.join()


def test_the_tables_go_on_after_the_process_was_killed(server: Server) -> None:
    """Whoever kills it: no rows are lost or doubled."""
    before = answered(server, "SELECT count(*) FROM events")
    ask(server, "SELECT length(repeat('x', 2000000000))")
    found = answered(server, "SELECT count(*), count(DISTINCT position), max(position) FROM events")
    assert len(set(found["rows"][0])) == 1
    assert found["rows"][0][0] >= before["rows"][0][0]


def analysts(server: Server) -> list[int]:
    """Process ids of the server's analyst: none, or one."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:  # it has ended meanwhile
            continue
        if b"analyst" in words and str(server.data).encode() in words:
            found.append(int(folder.name))
    return found


def test_who_asks_at_the_moment_of_its_death_is_answered_or_told_to_come_again(
    server: Server,
) -> None:
    for _ in range(5):
        answered(server, "SELECT 1")
        for process in analysts(server):
            os.kill(process, signal.SIGKILL)
        with ThreadPoolExecutor(4) as threads:
            answers = list(threads.map(lambda _: ask(server, "SELECT 1"), range(20)))
        # 400: the only statement that ran counts as what broke it
        assert {answer.status_code for answer in answers} <= {200, 400, 503}, answers


TABLES = st.sampled_from(
    [
        *("orders", "steps", "events", "robots", "allocations", "waits", "faults"),
        *("orders_done", "events_all", "checkpoint", "duckdb_settings()", "duckdb_secrets()"),
        *("'../canary.csv'", "read_csv('canary.csv')", "read_text('{}')", "glob('/*')"),
        *("'{}'", "read_blob('{}')", "sniff_csv('{}')", "read_json('{}')", "parquet_scan('{}')"),
        *("read_csv('https://example.com/a.csv')", "'s3://bucket/x.parquet'", "pragma_version()"),
        *("range(1000000000000)", "range(10)", "query('FROM orders')", "information_schema.tables"),
        *("json_execute_serialized_sql('{{}}')", "duckdb_logs()", "which_secret('a', 'b')"),
        *("duckdb_functions()", "pragma_database_size()", "duckdb_temporary_files()"),
    ]
)
VALUES = st.sampled_from(
    [
        *("1", "*", "count(*)", "'x'", "NULL", "now()", "getenv('HOME')", "version()", "$1", "?"),
        *("current_setting('temp_directory')", "repeat('x', 100000000)", "pg_sleep(10)"),
        *("regexp_matches(repeat('a', 100000), '(a*)*b')", "repeat('(', 1000)::JSON", "[[[[1]]]]"),
        *("error('no')", "1 / 0", "9223372036854775807 + 1", "'a'::INT", "'\0'", "chr(0)", "''"),
        *("list(i)", "(SELECT 1 FROM orders)", "EXISTS (FROM '{}')", "COLUMNS(*)", "x -> 'y'"),
        *("write_log('x')", "format('{{:1000000000}}', 1)", "sum(1) OVER ()", "unnest([1, 2])"),
        *("nextval('s')", "TRY_CAST('1e400' AS DOUBLE)", "INTERVAL 1 YEAR", "'😀'", "uuid()"),
    ]
)
FRAMES = st.sampled_from(
    [
        *("{}", "EXPLAIN {}", "EXPLAIN ANALYZE {}", "SELECT * FROM ({})", "WITH a AS ({}) FROM a"),
        *("WITH RECURSIVE a AS ({} UNION ALL FROM a) FROM a", "COPY ({}) TO '{{}}'", "{}; {}"),
        *("CREATE TABLE t AS {}", "INSERT INTO events_all {}", "DESCRIBE {}", "SUMMARIZE {}"),
        *("PREPARE p AS {}", "CREATE VIEW v AS {}", "ATTACH '{{}}' AS z; {}", "SET threads=1; {}"),
        *("PRAGMA threads=1; {}", "INSTALL httpfs; {}", "LOAD httpfs; {}", "PIVOT ({}) ON a"),
        *(
            "{} UNION ALL {}",
            "{} ORDER BY random() LIMIT 5",
            "/* {} */",
            "-- {}",
            "(({}))",
            "{} $$",
        ),
        *(
            "CREATE SECRET s (TYPE s3)",
            "EXPORT DATABASE '{{}}'",
            "CALL pragma_version()",
            "CHECKPOINT",
        ),
    ]
)


@st.composite
def hostile(draw: st.DrawFn, place: str) -> str:
    """A statement made of what DuckDB knows to touch the outside, settings, time and memory."""
    parts = draw(st.lists(VALUES, min_size=1, max_size=3))
    inner = f"SELECT {', '.join(parts)} FROM {draw(TABLES)}"
    if draw(st.booleans()):
        inner += f" WHERE {draw(VALUES)} = {draw(VALUES)}"
    for _ in range(draw(st.integers(1, 2))):
        frame = draw(FRAMES)
        inner = frame.replace("{{}}", "\x01").replace("{}", inner).replace("\x01", "{}")
    statement = inner.replace("{}", place)
    if draw(st.integers(0, 9)) == 0:  # and garbled at one place
        at = draw(st.integers(0, len(statement)))
        statement = statement[:at] + draw(st.text(max_size=3)) + statement[at + 1 :]
    return statement


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(choices=st.data())
def test_hostile_statements_are_refused_or_answered(server: Server, choices: st.DataObject) -> None:
    throw(server, choices)


def throw(server: Server, choices: st.DataObject) -> None:
    """Never a 500, never a file read or written, never longer or larger than allowed."""
    folder = server.data.parent
    canary = folder / "canary.csv"
    sql = choices.draw(hostile(str(canary)))
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    answer = ask(server, sql, maxRows=10)
    if answer.status_code == 503:  # the one before broke the process
        answered(server, "SELECT 1")
        answer = ask(server, sql, maxRows=10)
    assert answer.status_code in (200, 400, 504), answer.text
    assert answer.elapsed.total_seconds() < ANSWER_S_MAX
    if answer.status_code == 200:
        assert CANARY not in json.dumps(answer.json()["rows"])
        assert len(answer.json()["rows"]) <= 10
    else:
        assert answer.json()["code"].startswith("err")
    unlike = {p: p.stat().st_mtime_ns for p in folder.iterdir() if p.name != "data.log"}
    before = {path: mtime for path, mtime in before.items() if path.name != "data.log"}
    assert unlike.keys() == before.keys()
    assert unlike[canary] == before[canary]


@pytest.fixture(scope="module")
def patient(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server that would let statements run for minutes."""
    folder = tmp_path_factory.mktemp("patient")
    data = folder / "data"
    data.mkdir()
    (data / "config.toml").write_text("sql_seconds = 300.0\n")
    with serving(data, "--auth", "none", "--scene", str(small_scene(folder))) as running:
        yield running


def test_a_statement_ends_when_its_client_hangs_up(patient: Server) -> None:
    """Both places are taken by clients who leave; soon after there is room again."""
    answered(patient, "SELECT 1")
    body = json.dumps({"sql": ENDLESS}).encode()
    head = f"POST /api/sql HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {len(body)}\r\n\r\n"
    for _ in range(2):
        left: list[socket.socket] = []
        while ask(patient, "SELECT 1").status_code == 200:  # until two are running
            left.append(socket.create_connection(("127.0.0.1", patient.port)))
            left[-1].sendall(head.encode() + body)
        for connection in left:
            connection.close()
        answered(patient, "SELECT 1")
    assert "did not end" not in patient.log.read_text()  # it listened, and was not killed


def test_after_a_restart_the_tables_are_there(patient: Server) -> None:
    asked = answered(patient, "SELECT count(*) FROM events")["position"]
    assert patient.stop() == 0
    assert (patient.data / "analytics.duckdb").stat().st_size > 0
    with serving(patient.data, "--auth", "none") as running:
        found = answered(running, "SELECT count(*), max(position) FROM events")
        assert found["rows"][0] == [found["position"]] * 2
        assert found["position"] >= asked
        assert running.stop() == 0


def stage(seed: int) -> None:
    """Throw thousands of hostile statements at a server: for the soak, within a minute."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        data = folder / "data"
        data.mkdir()
        (data / "config.toml").write_text(LIMITS)
        (folder / "canary.csv").write_text(f"{CANARY}\n")
        with serving(data, "--auth", "none", "--scene", str(small_scene(folder))) as running:
            until = time.monotonic() + STAGE_S
            while time.monotonic() < until:
                thrown = given(choices=st.data())(lambda choices: throw(running, choices))
                more = settings(max_examples=200, deadline=None, database=None)
                hypothesis.seed(seed)(more(thrown))()
                seed += 1_000_003
