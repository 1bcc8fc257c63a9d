"""The DuckDB file of ended orders, their steps and all events: a cache that may be deleted."""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from threading import Event as Flag
from time import monotonic
from typing import TypeAlias
from weakref import WeakSet

import duckdb
import msgspec
import structlog

from ledger.events import AnyEvent
from ledger.state import Order
from projections.projector import Projector
from projections.tables import EVENTS, ORDERS, SCHEMA_VERSION, STEPS, arrow, ddl, steps_of

CATCH_UP_EVENTS = 20_000  # in one transaction when rebuilding
LOCK_TRIES = 50  # `fleetledger sql` holds the file only while it copies it
LOCK_RETRY_S = 0.1
THREADS = 2
MEMORY_MAX = "2GB"
CLOSE_S = 2.0  # for queries under way to be broken off
CLOSE_RETRY_S = 0.005

Read: TypeAlias = Callable[[int], Iterator[AnyEvent]]  # events behind a position, in order

log = structlog.get_logger()


class Archive:
    """The open file. One thread commits; readers take a cursor each."""

    def __init__(self, connection: duckdb.DuckDBPyConnection, path: Path | None) -> None:
        self._connection = connection
        self._path = path
        self._cursors: WeakSet[duckdb.DuckDBPyConnection] = WeakSet()
        self.position, self._digest, self._orders = _checkpoint(connection)

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
                    "CREATE TABLE checkpoint "
                    "(version BIGINT, position BIGINT, digest VARCHAR, orders BIGINT)",
                    f"INSERT INTO checkpoint VALUES ({SCHEMA_VERSION}, 0, '', 0)",
                )
            )
            + "; COMMIT"
        )
        return cls(connection, path)

    def _check(self, path: Path) -> None:
        """Find what DuckDB itself finds only when it reads the block: a file cut short.

        And rows that do not fit the checkpoint, as after another file's write-ahead log.
        """
        one = self._connection.execute
        (size,) = one(
            "SELECT total_blocks * block_size FROM pragma_database_size()"
        ).fetchone() or (0,)
        if path.stat().st_size < size:
            raise _Unusable(f"{path.stat().st_size} bytes of {size} are left")
        for table, due in (("events", self.position), ("orders_done", self._orders)):
            (rows,) = one(f"SELECT count(*) FROM {table}").fetchone() or (0,)
            if rows != due:
                raise _Unusable(f"{table} has {rows} rows, not {due}, at {self.position}")
        newest = one("SELECT count(*) FROM events WHERE position = ?", [self.position])
        if self.position and newest.fetchone() != (1,):
            raise _Unusable(f"the event at {self.position} is missing")

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
                "UPDATE checkpoint SET position = ?, digest = ?, orders = orders + ? "
                "WHERE position = ?",
                [newest.position, digest, orders.num_rows, self.position],
            ).fetchone() or (0,)
            assert moved == 1, f"the checkpoint was not at {self.position}"
            connection.execute("COMMIT")
        except BaseException:
            connection.execute("ROLLBACK")
            raise
        self.position, self._digest = newest.position, digest
        self._orders += orders.num_rows
        projector.clear()

    def catch_up(
        self,
        projector: Projector,
        read: Read,
        stop: Callable[[], bool],
        told: Callable[[int], None] = lambda position: None,
    ) -> None:
        """Commit all that the ledger holds behind our position.

        `stop` is asked between batches; `told` hears how far each has come.
        """
        events = read(self.position)
        while not stop():
            batch = list(islice(events, CATCH_UP_EVENTS))
            if not batch:
                return
            for event in batch:
                projector.take(event)
            self.commit(projector)
            told(self.position)

    def newest(self, count: int, until: int) -> list[Order]:
        """Give the newest created orders of those that ended at a position or before."""
        found = self._connection.execute(
            "SELECT body FROM orders_done WHERE done_position <= ? "
            "ORDER BY created_on DESC, id LIMIT ?",
            [until, count],
        ).fetchall()
        return [msgspec.json.decode(body, type=Order) for (body,) in found]

    def cursor(self, need: int = 0) -> duckdb.DuckDBPyConnection:
        """Give a reader of its own: a cursor must not be shared by threads.

        What it needs is checked by who knows how far we ought to be.
        """
        cursor = self._connection.cursor()
        self._cursors.add(cursor)
        return cursor

    def interrupt(self) -> None:
        """Break off the commit that is running."""
        self._connection.interrupt()

    def close(self, *, delete: bool = False) -> None:
        """Close the file and every cursor; delete it where it has proved to be bad.

        A file that is still open must not be begun anew: the old one would end by deleting the
        write-ahead log of the new one.
        """
        until_s = monotonic() + CLOSE_S
        while True:
            try:
                self._connection.close()
                break
            except duckdb.ResourceInUseException:  # a query is under way
                if monotonic() > until_s:
                    raise
                self._break_off()
                Flag().wait(CLOSE_RETRY_S)  # nobody tells when a cursor is idle
        if delete and self._path is not None:
            _delete(self._path)

    def _break_off(self) -> None:
        for cursor in list(self._cursors):
            with suppress(duckdb.ConnectionException):  # it is closed
                cursor.interrupt()


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


def _checkpoint(connection: duckdb.DuckDBPyConnection) -> tuple[int, str, int]:
    (version,) = connection.execute("SELECT max(version) FROM checkpoint").fetchone() or (None,)
    if version != SCHEMA_VERSION:
        raise _Unusable(f"its tables have version {version}, {SCHEMA_VERSION} is wanted")
    found = connection.execute("SELECT position, digest, orders FROM checkpoint").fetchall()
    if len(found) != 1:
        raise _Unusable(f"it has {len(found)} checkpoints")
    return int(found[0][0]), str(found[0][1]), int(found[0][2])


def _digest_of(event: AnyEvent) -> str:
    return hashlib.sha256(msgspec.json.encode(event)).hexdigest()


def is_damage(trouble: duckdb.Error) -> bool:
    """Whether it says that the file cannot be read. A full disk, which it calls alike, is none."""
    if not isinstance(trouble, duckdb.IOException | duckdb.SerializationException):
        return False
    return not any(word in str(trouble) for word in ("space", "write"))


def _delete(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.with_name(path.name + ".wal").unlink(missing_ok=True)


def position_of(path: Path) -> int:
    """Tell how far a file that nobody has open follows its ledger; 0 where it does not say."""
    try:
        with duckdb.connect(str(path), read_only=True) as connection:
            found = connection.execute("SELECT position FROM checkpoint").fetchone()
    except duckdb.Error:
        return 0
    return 0 if found is None else int(found[0])
