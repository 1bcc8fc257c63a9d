"""The DuckDB file of analytics: everything that can be asked in SQL, as of one position.

A read model of its own, apart from the history that queries of the API read: a statement of an
analyst may fill its memory and be killed with it, and nobody else notices. A cache, like the
history.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import duckdb
import msgspec
import structlog

from ledger.events import AnyEvent, OrderCancelled, OrderFinished
from ledger.events.orders import OfOrder
from ledger.events.robots import OfRobot
from ledger.events.scenes import SceneEvent
from ledger.evolve import evolve
from ledger.evolve_order import order_after
from ledger.ids import OrderId
from ledger.state import Fleet
from projections.analytics_tables import (
    ALLOCATIONS,
    ROBOT_WAITS,
    ROBOTS,
    SPANS,
    WAIT_CYCLES,
    Allocation,
    PlacedRobot,
    allocations_of,
    cycles_of,
    span_of,
    waits_of,
)
from projections.spans import Spans
from projections.sql_views import create_views
from projections.tables import EVENTS, ORDERS, STEPS, Column, Placed, arrow, ddl, steps_of

VERSION = 2  # of the tables; a file of another version is built anew
BATCH_EVENTS = 20_000  # in one transaction
THREADS = 2
MEMORY_MB_MAX = 1_000
SPILL_MAX = "4GB"  # of intermediate results on disk

Read = Callable[[int], Iterator[AnyEvent]]  # events behind a position, in order
ORDERS_LEAN = tuple(c for c in ORDERS if c.name != "body")
_LIVE: tuple[tuple[str, tuple[Column[Any], ...]], ...] = (
    ("orders_live", ORDERS_LEAN),
    ("steps_live", STEPS),
    ("robots_live", ROBOTS),
)
_GROWING: tuple[tuple[str, tuple[Column[Any], ...]], ...] = (
    ("orders_done", ORDERS_LEAN),
    ("steps_done", STEPS),
    ("events_all", EVENTS),
    ("allocations_all", ALLOCATIONS),
    ("robot_waits_all", ROBOT_WAITS),
    ("wait_cycles_all", WAIT_CYCLES),
)

log = structlog.get_logger()


class Analytics:
    """The open file, and the state at its position. One thread commits; readers take cursors."""

    def __init__(self, connection: duckdb.DuckDBPyConnection) -> None:
        """Take the tables; `resume` must follow where they are not empty."""
        self._connection = connection
        self.position, self._digest = _checkpoint(connection)
        self.fleet = Fleet()
        self._spans = Spans()
        self._events: list[AnyEvent] = []
        self._ended: list[Placed] = []
        self._allocations: list[Allocation] = []
        self._touched: set[OrderId] = set()
        self._robots_touched = False

    @classmethod
    def open(
        cls,
        path: Path | None,
        read: Read,
        fleet_at: Callable[[int], Fleet],
        newest: int,
        memory_mb: int = MEMORY_MB_MAX,
        spill: Path | None = None,
    ) -> "Analytics":
        """Open the file, or memory; what is unreadable or of another ledger is begun anew."""
        if path is not None and path.exists():
            try:
                analytics = cls(_connect(path, memory_mb, spill))
                try:
                    analytics._resume(read, fleet_at, newest)
                    return analytics
                except BaseException:
                    analytics.close()
                    raise
            except (duckdb.Error, _Unusable) as trouble:
                log.warning("analytics are built anew", path=str(path), reason=str(trouble))
        if path is not None:
            path.unlink(missing_ok=True)
            path.with_name(path.name + ".wal").unlink(missing_ok=True)
        connection = _connect(path, memory_mb, spill)
        statements = [ddl(table, columns) for table, columns in (*_LIVE, *_GROWING)]
        for name, columns in SPANS.values():
            statements += [ddl(f"{name}_live", columns), ddl(f"{name}_done", columns)]
        statements += [
            "CREATE TABLE checkpoint "
            "(version BIGINT, position BIGINT, at_ms BIGINT, digest VARCHAR)",
            f"INSERT INTO checkpoint VALUES ({VERSION}, 0, 0, '')",
            *create_views(),
        ]
        connection.execute("BEGIN; " + "; ".join(statements) + "; COMMIT")
        return cls(connection)

    def _resume(self, read: Read, fleet_at: Callable[[int], Fleet], newest: int) -> None:
        if self.position == 0:
            return
        event = next(read(self.position - 1), None) if self.position <= newest else None
        if event is None or _digest_of(event) != self._digest:
            raise _Unusable("it is not of this ledger")
        self.fleet = fleet_at(self.position)
        for kind, (name, _) in SPANS.items():
            rows = self._connection.execute(f"SELECT * FROM {name}_live").fetchall()
            self._spans.resume(span_of(kind, row) for row in rows)

    def take(self, event: AnyEvent) -> None:
        """Take in the next event."""
        assert event.position == self.fleet.position + 1, f"{event.position} is not next"
        before = None
        if isinstance(event, OfOrder):
            before = self.fleet.orders.get(event.order)
            self._touched.add(event.order)
            if isinstance(event, OrderFinished | OrderCancelled):
                assert before is not None, f"{event.order} has ended before"
                name = self.fleet.scenes[event.scene].name
                ended = order_after(before, event)
                self._ended.append(Placed(order=ended, scene_name=name, position=event.position))
            self._allocations.extend(allocations_of(event))
        if isinstance(event, OfOrder | OfRobot | SceneEvent):
            self._robots_touched = True
        evolve(self.fleet, event)
        self._spans.take(event, before, self.fleet)
        self._events.append(event)

    def catch_up(
        self,
        read: Read,
        until: int,
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> None:
        """Commit all up to a position, in transactions of so many events."""
        if self.position >= until:
            return
        for event in read(self.position):
            if event.position > until:
                break
            self.take(event)
            if len(self._events) == BATCH_EVENTS:
                self.commit()
                progress(self.position, until)
        self.commit()

    def commit(self) -> None:
        """Write what was taken in, and the checkpoint, in one transaction."""
        if not self._events:
            return
        newest = self._events[-1]
        digest = _digest_of(newest)
        self._connection.execute("BEGIN")
        try:
            self._write()
            self._connection.execute(
                "UPDATE checkpoint SET position = ?, at_ms = ?, digest = ?",
                [newest.position, newest.at_ms, digest],
            )
            self._connection.execute("COMMIT")
        except BaseException:
            self._connection.execute("ROLLBACK")
            raise
        self.position, self._digest = newest.position, digest
        self._spans.clear()
        self._events, self._ended, self._allocations = [], [], []
        self._touched, self._robots_touched = set(), False

    def _write(self) -> None:
        steps = [step for placed in self._ended for step in steps_of(placed)]
        waits = [wait for event in self._events for wait in waits_of(event)]
        cycles = [cycle for event in self._events for cycle in cycles_of(event)]
        rows: tuple[Sequence[Any], ...] = (
            self._ended,
            steps,
            self._events,
            self._allocations,
            waits,
            cycles,
        )
        for (table, columns), some in zip(_GROWING, rows, strict=True):
            self._append(table, columns, some)
        for kind, (name, columns) in SPANS.items():
            self._append(f"{name}_done", columns, self._spans.ended[kind])
            self._connection.execute(f"DELETE FROM {name}_live")
            self._append(f"{name}_live", columns, list(self._spans.open[kind].values()))
        self._write_live()

    def _write_live(self) -> None:
        touched = [list(self._touched)]
        orders, scenes = self.fleet.orders, self.fleet.scenes
        live = [
            Placed(order=orders[id_], scene_name=scenes[orders[id_].scene].name, position=0)
            for id_ in self._touched
            if id_ in orders
        ]
        execute = self._connection.execute
        execute("DELETE FROM orders_live WHERE id IN (SELECT unnest(?::VARCHAR[]))", touched)
        execute("DELETE FROM steps_live WHERE order_id IN (SELECT unnest(?::VARCHAR[]))", touched)
        self._append("orders_live", ORDERS_LEAN, live)
        execute("UPDATE orders_live SET done_position = NULL WHERE done_position = 0")
        self._append("steps_live", STEPS, [step for order in live for step in steps_of(order)])
        if self._robots_touched:
            groups = {(s.id, g.id): g.name for s in scenes.values() for g in s.groups}
            robots = [
                PlacedRobot(
                    robot=robot,
                    scene_name=scenes[robot.scene].name,
                    group=groups.get((robot.scene, robot.config.group), ""),
                )
                for robot in self.fleet.robots.values()
            ]
            execute("DELETE FROM robots_live")
            self._append("robots_live", ROBOTS, robots)

    def _append(self, table: str, columns: Sequence[Column[Any]], rows: Sequence[Any]) -> None:
        if rows:
            self._connection.register("fresh", arrow(columns, rows))
            self._connection.execute(f"INSERT INTO {table} SELECT * FROM fresh")
            self._connection.unregister("fresh")

    def cursor(self) -> duckdb.DuckDBPyConnection:
        """Give a reader of its own: a cursor must not be shared by threads."""
        return self._connection.cursor()

    def close(self) -> None:
        """Close the file."""
        self._connection.close()


class _Unusable(Exception):
    """Tables of another version of this program, or of another ledger."""


def _connect(path: Path | None, memory_mb: int, spill: Path | None) -> duckdb.DuckDBPyConnection:
    """Open the file with every door shut: no other file, no network, no settings."""
    config: dict[str, str | bool | int | float | list[str]] = {
        "threads": THREADS,
        "memory_limit": f"{memory_mb}MB",
        "python_enable_replacements": False,
        "enable_external_access": False,
        "autoinstall_known_extensions": False,
        "autoload_known_extensions": False,
        "max_temp_directory_size": SPILL_MAX,
    }
    if spill is not None:
        config["temp_directory"] = str(spill)
    connection = duckdb.connect(":memory:" if path is None else str(path), config=config)
    connection.execute("SET TimeZone = 'UTC'")
    connection.execute("SET lock_configuration = true")
    return connection


def _checkpoint(connection: duckdb.DuckDBPyConnection) -> tuple[int, str]:
    found = connection.execute("SELECT version, position, digest FROM checkpoint").fetchall()
    if len(found) != 1 or found[0][0] != VERSION:
        raise _Unusable(f"checkpoint {found}, tables of version {VERSION} are wanted")
    return int(found[0][1]), str(found[0][2])


def _digest_of(event: AnyEvent) -> str:
    return hashlib.sha256(msgspec.json.encode(event)).hexdigest()
