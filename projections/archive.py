"""The DuckDB file of ended orders, their steps and all events: a cache that may be deleted."""

import hashlib
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from threading import Event as Flag
from typing import TypeAlias

import duckdb
import msgspec
import structlog

from ledger.events import AnyEvent
from ledger.state import Order
from projections.projector import Projector
from projections.tables import EVENTS, ORDERS, SCHEMA_VERSION, STEPS, arrow, ddl, steps_of

CATCH_UP_EVENTS = 20_000  # in one transaction when rebuilding
PROGRESS_EVENTS = 200_000  # between two lines of the log when rebuilding
LOCK_TRIES = 50  # `fleetledger sql` holds the file only while it copies it
LOCK_RETRY_S = 0.1
THREADS = 2
MEMORY_MAX = "2GB"

Read: TypeAlias = Callable[[int], Iterator[AnyEvent]]  # events behind a position, in order

log = structlog.get_logger()


class Archive:
    """The open file. One thread commits; readers take a cursor each."""

    def __init__(self, connection: duckdb.DuckDBPyConnection, path: Path | None) -> None:
        self._connection = connection
        self._path = path
        self.position, self._digest = _checkpoint(connection)

    @classmethod
    def open(cls, path: Path | None) -> "Archive":
        """Open the file, or memory; what cannot be read is deleted and begun anew."""
        if path is None or not path.exists():
            return cls._new(path)
        try:
            connection = _connect(path)
            try:
                archive = cls(connection, path)
                archive._check(path)
                return archive
            except BaseException:
                connection.close()
                raise
        except (duckdb.Error, _Unusable) as trouble:
            log.warning("history is built anew", path=str(path), reason=str(trouble))
            _delete(path)
            return cls._new(path)

    @classmethod
    def _new(cls, path: Path | None) -> "Archive":
        if path is not None:
            _delete(path)  # a write-ahead log without its file
        connection = _connect(path)
        connection.execute(
            "BEGIN;"
            + ";".join(
                (
                    ddl("orders_done", ORDERS),
                    ddl("steps_done", STEPS),
                    ddl("events", EVENTS),
                    "CREATE TABLE checkpoint (version BIGINT, position BIGINT, digest VARCHAR)",
                    f"INSERT INTO checkpoint VALUES ({SCHEMA_VERSION}, 0, '')",
                )
            )
            + "; COMMIT"
        )
        return cls(connection, path)

    def _check(self, path: Path) -> None:
        """Find what DuckDB itself finds only when it reads the block: a file cut short."""
        (size,) = self._connection.execute(
            "SELECT total_blocks * block_size FROM pragma_database_size()"
        ).fetchone() or (0,)
        if path.stat().st_size < size:
            raise _Unusable(f"{path.stat().st_size} bytes of {size} are left")
        events = self._connection.execute("SELECT count(*), coalesce(max(position), 0) FROM events")
        if events.fetchone() != (self.position, self.position):
            raise _Unusable(f"events are missing before position {self.position}")

    def belongs_to(self, read: Read) -> bool:
        """Whether the ledger holds, at our checkpoint, the very event we stopped at."""
        if self.position == 0:
            return True
        event = next(read(self.position - 1), None)
        return event is not None and _digest_of(event) == self._digest

    def commit(self, projector: Projector) -> None:
        """Append what the projector has gathered, and the checkpoint, in one transaction."""
        if not projector.events:
            return
        orders = arrow(ORDERS, projector.ended)
        steps = arrow(STEPS, [step for placed in projector.ended for step in steps_of(placed)])
        events = arrow(EVENTS, projector.events)
        newest = projector.events[-1]
        digest = _digest_of(newest)
        connection = self._connection
        connection.execute("BEGIN")
        try:
            for table, rows in (("orders_done", orders), ("steps_done", steps), ("events", events)):
                if rows.num_rows:
                    connection.register("fresh", rows)
                    connection.execute(f"INSERT INTO {table} SELECT * FROM fresh")
                    connection.unregister("fresh")
            (moved,) = connection.execute(
                "UPDATE checkpoint SET position = ?, digest = ? WHERE position = ?",
                [newest.position, digest, self.position],
            ).fetchone() or (0,)
            assert moved == 1, f"the checkpoint was not at {self.position}"
            connection.execute("COMMIT")
        except BaseException:
            connection.execute("ROLLBACK")
            raise
        self.position, self._digest = newest.position, digest
        projector.clear()

    def catch_up(self, projector: Projector, read: Read, stop: Callable[[], bool]) -> None:
        """Commit all that the ledger holds behind our position; `stop` is asked between batches."""
        begin = told = self.position
        events = read(self.position)
        while not stop():
            batch = list(islice(events, CATCH_UP_EVENTS))
            if not batch:
                return
            for event in batch:
                projector.take(event)
            self.commit(projector)
            if self.position - told >= PROGRESS_EVENTS:
                told = self.position
                log.info("history is being rebuilt", position=told, since=begin)

    def newest(self, count: int, until: int) -> list[Order]:
        """Give the newest created orders of those that ended at a position or before."""
        found = self._connection.execute(
            "SELECT body FROM orders_done WHERE done_position <= ? "
            "ORDER BY created_on DESC, id LIMIT ?",
            [until, count],
        ).fetchall()
        return [msgspec.json.decode(body, type=Order) for (body,) in found]

    def cursor(self) -> duckdb.DuckDBPyConnection:
        """Give a reader of its own: a cursor must not be shared by threads."""
        return self._connection.cursor()

    def interrupt(self) -> None:
        """Break off the commit that is running."""
        self._connection.interrupt()

    def close(self, *, delete: bool = False) -> None:
        """Close the file; delete it where it has proved to be bad."""
        self._connection.close()
        if delete and self._path is not None:
            _delete(self._path)


class _Unusable(Exception):
    """Tables of another version of this program, or not all of them."""


def _connect(path: Path | None) -> duckdb.DuckDBPyConnection:
    config: dict[str, str | bool | int | float | list[str]] = {
        "threads": THREADS,
        "memory_limit": MEMORY_MAX,
        "python_enable_replacements": False,
    }
    for _ in range(LOCK_TRIES):
        try:
            return duckdb.connect(":memory:" if path is None else str(path), config=config)
        except duckdb.IOException as trouble:
            if "lock" not in str(trouble):
                raise
            Flag().wait(LOCK_RETRY_S)
    raise TimeoutError(f"another process holds {path}; stop it, or delete the file")


def _checkpoint(connection: duckdb.DuckDBPyConnection) -> tuple[int, str]:
    found = connection.execute("SELECT version, position, digest FROM checkpoint").fetchall()
    if len(found) != 1 or found[0][0] != SCHEMA_VERSION:
        raise _Unusable(f"checkpoint {found}, tables of version {SCHEMA_VERSION} are wanted")
    return int(found[0][1]), str(found[0][2])


def _digest_of(event: AnyEvent) -> str:
    return hashlib.sha256(msgspec.json.encode(event)).hexdigest()


def _delete(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.with_name(path.name + ".wal").unlink(missing_ok=True)
