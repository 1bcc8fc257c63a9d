"""The DuckDB file of ended orders, and the events of all: a cache that may be deleted."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from threading import Event as Flag
from time import monotonic
from typing import TypeAlias, TypeVar
from weakref import WeakSet

import duckdb
import msgspec
import pyarrow as pa
import structlog

from ledger.events import AnyEvent
from ledger.events.orders import OfOrder
from ledger.pace import GiveWay, at_once
from ledger.scene import Value
from ledger.state import Order
from projections.order_keys import key_of
from projections.projector import Projector
from projections.tables import (
    KEYS,
    ORDER_EVENTS,
    ORDERS,
    SCHEMA_VERSION,
    ddl,
    event_rows,
    order_rows,
)

CATCH_UP_EVENTS = 20_000  # in one transaction when rebuilding
SLICE = 64  # rows made in one go
LOCK_TRIES = 50  # `fleetledger sql` holds the file only while it copies it
LOCK_RETRY_S = 0.1
THREADS = 2
MEMORY_MAX = "320MB"  # of DuckDB's own; what is larger goes to disk, or is read again
CLOSE_S = 2.0  # for queries under way to be broken off
CLOSE_RETRY_S = 0.005

Read: TypeAlias = Callable[[int], Iterator[AnyEvent]]  # events behind a position, in order

R = TypeVar("R")  # what rows are made of

log = structlog.get_logger()


class Checkpoint(Value, frozen=True):
    """How far the file is, and what it has to hold then."""

    position: int
    digest: str  # of the event there, to know the ledger by
    orders: int  # rows
    events: int  # rows
    odd_ids: int  # orders whose id is not of our pattern


class Archive:
    """The open file. One thread commits; readers take a cursor each."""

    def __init__(self, connection: duckdb.DuckDBPyConnection, path: Path | None) -> None:
        self._connection = connection
        self._path = path
        self._cursors: WeakSet[duckdb.DuckDBPyConnection] = WeakSet()
        self._at = _checkpoint(connection)

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
                    ddl("orders_done", (*ORDERS, *KEYS)),
                    ddl("order_events", ORDER_EVENTS),
                    "CREATE TABLE checkpoint (version BIGINT, position BIGINT, digest VARCHAR, "
                    "orders BIGINT, events BIGINT, odd_ids BIGINT)",
                    f"INSERT INTO checkpoint VALUES ({SCHEMA_VERSION}, 0, '', 0, 0, 0)",
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
        at = self._at
        for table, due in (("order_events", at.events), ("orders_done", at.orders)):
            (rows,) = one(f"SELECT count(*) FROM {table}").fetchone() or (0,)
            if rows != due:
                raise _Unusable(f"{table} has {rows} rows, not {due}, at {self.position}")

    def belongs_to(self, read: Read) -> bool:
        """Whether the ledger holds, at our checkpoint, the very event we stopped at."""
        if self.position == 0:
            return True
        event = next(read(self.position - 1), None)
        return event is not None and digest_of(event) == self._at.digest

    @property
    def position(self) -> int:
        """Position of the newest event that is taken in."""
        return self._at.position

    def commit(self, projector: Projector, give_way: GiveWay = at_once) -> None:
        """Append what the projector has gathered, and the checkpoint, in one transaction.

        `give_way` is called between slices of making rows: a millisecond of Python each, in which
        whoever answers clients waits.
        """
        if not projector.events:
            return
        newest = projector.events[-1]
        orders = _sliced(order_rows, projector.ended, give_way)
        of_orders = [e for e in projector.events if isinstance(e, OfOrder)]
        events = _sliced(event_rows, of_orders, give_way)
        at = Checkpoint(
            position=newest.position,
            digest=digest_of(newest),
            orders=self._at.orders + orders.num_rows,
            events=self._at.events + events.num_rows,
            odd_ids=self._at.odd_ids + sum(key_of(p.order.id) is None for p in projector.ended),
        )
        connection = self._connection
        connection.execute("BEGIN")
        try:
            for table, rows in (("orders_done", orders), ("order_events", events)):
                if rows.num_rows:
                    connection.register("fresh", rows)
                    connection.execute(f"INSERT INTO {table} SELECT * FROM fresh")
                    connection.unregister("fresh")
            (moved,) = connection.execute(
                "UPDATE checkpoint SET position = ?, digest = ?, orders = ?, events = ?, "
                "odd_ids = ? WHERE position = ?",
                [at.position, at.digest, at.orders, at.events, at.odd_ids, self._at.position],
            ).fetchone() or (0,)
            assert moved == 1, f"the checkpoint was not at {self._at.position}"
            connection.execute("COMMIT")
        except BaseException:
            with suppress(duckdb.Error):  # a failed COMMIT has rolled back
                connection.execute("ROLLBACK")
            raise
        self._at = at
        projector.clear()

    def catch_up(
        self,
        projector: Projector,
        read: Read,
        stop: Callable[[], bool],
        told: Callable[[int], None] = lambda position: None,
        give_way: GiveWay = at_once,
    ) -> None:
        """Commit all that the ledger holds behind our position.

        `stop` is asked between batches; `told` hears how far each has come.
        """
        events = read(self.position)
        while not stop():
            while (room := CATCH_UP_EVENTS - len(projector.events)) > 0:
                some = list(islice(events, min(SLICE, room)))
                if not some:
                    break
                projector.take_all(some)
                give_way()
            if not projector.events:
                return
            self.commit(projector, give_way)
            told(self.position)

    def newest(self, count: int, until: int) -> list[tuple[Order, str]]:
        """Give the newest created orders of those that ended at a position or before, each with
        the name of its scene.
        """
        found = self._connection.execute(
            "SELECT body, scene_name FROM orders_done WHERE done_position <= ? "
            "ORDER BY created_on DESC, id LIMIT ?",
            [until, count],
        ).fetchall()
        return [(msgspec.json.decode(body, type=Order), name) for body, name in found]

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


def _sliced(
    make: Callable[[Sequence[R]], pa.Table], of: Sequence[R], give_way: GiveWay
) -> pa.Table:
    tables = []
    for start in range(0, max(len(of), 1), SLICE):
        tables.append(make(of[start : start + SLICE]))
        give_way()
    return pa.concat_tables(tables)


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


def _checkpoint(connection: duckdb.DuckDBPyConnection) -> Checkpoint:
    (version,) = connection.execute("SELECT max(version) FROM checkpoint").fetchone() or (None,)
    if version != SCHEMA_VERSION:
        raise _Unusable(f"its tables have version {version}, {SCHEMA_VERSION} is wanted")
    names = ", ".join(Checkpoint.__struct_fields__)
    found = connection.execute(f"SELECT {names} FROM checkpoint").fetchall()
    if len(found) != 1:
        raise _Unusable(f"it has {len(found)} checkpoints")
    return Checkpoint(*found[0])


def digest_of(event: AnyEvent) -> str:
    """Give what an event is known by."""
    return hashlib.sha256(msgspec.json.encode(event)).hexdigest()


def is_damage(trouble: Exception) -> bool:
    """Whether it says that the file cannot be read. A full disk, which it calls alike, is none."""
    if isinstance(trouble, duckdb.IOException | duckdb.SerializationException):
        return not any(word in str(trouble) for word in ("space", "write"))
    return isinstance(trouble, duckdb.Error) and "orrupt" in str(trouble)  # of no class of its own


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
