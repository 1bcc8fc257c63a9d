"""Analytics: one SELECT over documented views of orders, steps, events and robots.

It works on a copy of its own, so it may run beside the server, can change nothing, and sees every
event that is on disk. The statement has no access to files or network, and limited time and rows.
"""

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from threading import Timer
from typing import Any, Protocol

import duckdb

from ledger.errors import Refused
from ledger.events import AnyEvent
from ledger.scene import Value
from ledger.snapshot import restore
from ledger.state import Fleet
from projections.archive import CATCH_UP_EVENTS, Archive
from projections.projector import Projector
from projections.sql_views import ROBOTS, VIEWS, PlacedRobot, shown
from projections.tables import ORDERS, STEPS, Column, Placed, arrow, ddl, steps_of

SECONDS_MAX = 60.0
ROWS_MAX = 1_000_000
MEMORY_MAX = "2GB"

ALLOWED = ("SELECT", "EXPLAIN")


class Progress(Protocol):
    """Told how many events of how many are read."""

    def __call__(self, done: int, total: int, /) -> None:
        """Take the figures."""


class SqlAnswer(Value, frozen=True, kw_only=True):
    """Rows of a statement; `cut` tells that there were more."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    cut: bool = False


def run_sql(
    data: Path,
    statement: str,
    read: Callable[[int], Iterator[AnyEvent]],
    progress: Progress = lambda done, total: None,
    *,
    seconds_max: float = SECONDS_MAX,
    rows_max: int = ROWS_MAX,
) -> SqlAnswer:
    """Answer one SELECT over a data folder; raises Refused that says what is wrong with it.

    `read` gives the events behind a position. The history file is copied where no server holds
    it, and made anew in memory where one does.
    """
    with tempfile.TemporaryDirectory(prefix="fleetledger-sql-") as folder:
        fleet = restore(data / "ledger", data / "snapshots")
        archive = _copied(data / "history.duckdb", Path(folder), read, fleet)
        try:
            projector = Projector(
                restore(data / "ledger", data / "snapshots", position=archive.position)
                if archive.position
                else Fleet()
            )
            _catch_up(archive, projector, read, fleet.position, progress)
            cursor = archive.cursor()
            _fill(cursor, fleet)
            return query(cursor, statement, seconds_max=seconds_max, rows_max=rows_max)
        finally:
            archive.close()


def query(
    connection: duckdb.DuckDBPyConnection,
    statement: str,
    *,
    seconds_max: float = SECONDS_MAX,
    rows_max: int = ROWS_MAX,
) -> SqlAnswer:
    """Lock the database down, and run a statement on it."""
    connection.execute(f"SET memory_limit = '{MEMORY_MAX}'")
    connection.execute("SET enable_external_access = false")
    connection.execute("SET lock_configuration = true")
    timer = Timer(seconds_max, connection.interrupt)
    try:
        parsed = connection.extract_statements(statement)
        if len(parsed) != 1 or parsed[0].type.name not in ALLOWED:
            kinds = ", ".join(p.type.name for p in parsed) or "none"
            raise Refused("errSqlNotAllowed", f"Give one SELECT statement, not: {kinds}.", kinds)
        timer.start()
        found = connection.execute(parsed[0])
        columns = tuple(str(column[0]) for column in found.description or ())
        rows = found.fetchmany(rows_max + 1)
    except duckdb.InterruptException:
        raise Refused(
            "errQueryTooSlow", f"The statement took longer than {seconds_max:g} s.", seconds_max
        ) from None
    except duckdb.Error as trouble:
        raise Refused("errSqlInvalid", str(trouble)) from None
    finally:
        timer.cancel()
    return SqlAnswer(columns=columns, rows=tuple(rows[:rows_max]), cut=len(rows) > rows_max)


def _copied(
    path: Path, folder: Path, read: Callable[[int], Iterator[AnyEvent]], fleet: Fleet
) -> Archive:
    """Give a copy of the history if it can be had and is of this ledger, or an empty one."""
    try:
        with duckdb.connect(str(path), read_only=True):  # no server writes while we hold it
            copy = folder / path.name
            shutil.copyfile(path, copy)
            wal = path.with_name(path.name + ".wal")
            if wal.exists():
                shutil.copyfile(wal, copy.with_name(wal.name))
    except (duckdb.Error, OSError):
        return Archive.open(None)
    archive = Archive.open(copy)
    if archive.position <= fleet.position and archive.belongs_to(read):
        return archive
    archive.close()
    return Archive.open(None)


def _catch_up(
    archive: Archive,
    projector: Projector,
    read: Callable[[int], Iterator[AnyEvent]],
    until: int,
    progress: Progress,
) -> None:
    for event in read(archive.position):
        if event.position > until:
            break
        projector.take(event)
        if len(projector.events) == CATCH_UP_EVENTS:
            archive.commit(projector)
            progress(archive.position, until)
    archive.commit(projector)


def _fill(cursor: duckdb.DuckDBPyConnection, fleet: Fleet) -> None:
    """Add what is live, and define the views."""
    names = {scene.id: scene.name for scene in fleet.scenes.values()}
    groups = {(s.id, g.id): g.name for s in fleet.scenes.values() for g in s.groups}
    placed = [
        Placed(order=order, scene_name=names[order.scene], position=0)
        for order in fleet.orders.values()
    ]
    robots = [
        PlacedRobot(
            robot=robot,
            scene_name=names[robot.scene],
            group=groups.get((robot.scene, robot.config.group), ""),
        )
        for robot in fleet.robots.values()
    ]
    cursor.execute("ALTER TABLE events RENAME TO events_all")
    _put(cursor, "orders_live", ORDERS, placed)
    cursor.execute("UPDATE orders_live SET done_position = NULL")
    _put(cursor, "steps_live", STEPS, [step for order in placed for step in steps_of(order)])
    _put(cursor, "robots_live", ROBOTS, robots)
    for view in VIEWS:
        columns = ", ".join(shown(column) for column in view.columns)
        parts = (f"SELECT {columns} FROM {table}" for table in view.tables)
        cursor.execute(f"CREATE VIEW {view.name} AS {' UNION ALL '.join(parts)}")
        cursor.execute(f"COMMENT ON VIEW {view.name} IS '{view.doc}'")


def _put(
    cursor: duckdb.DuckDBPyConnection,
    table: str,
    columns: Sequence[Column[Any]],
    rows: Sequence[Any],
) -> None:
    cursor.execute(ddl(table, columns))
    if rows:
        cursor.register("fresh", arrow(columns, rows))
        cursor.execute(f"INSERT INTO {table} SELECT * FROM fresh")
        cursor.unregister("fresh")
