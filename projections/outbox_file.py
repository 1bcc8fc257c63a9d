"""The SQLite file of callbacks that are still to be delivered, and how far the ledger is followed.

Callbacks and position change in one transaction, synced: after a crash at any instant the file
holds exactly what the events up to its position led to, less what was settled.
"""

import os
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

import structlog

from ledger.callbacks import CallbackStatus
from ledger.ids import OrderId, SceneId
from projections.callbacks import Callback

VERSION = 1  # of the tables; a file of another version is set aside
MODE = 0o600  # addresses may hold tokens
ASIDE = ".aside"
BUSY_S = 5.0  # somebody else looks into the file
COMPANIONS = ("", "-wal", "-shm")

TABLES = """
CREATE TABLE followed (position INTEGER NOT NULL, mark TEXT NOT NULL);
CREATE TABLE callbacks (
    number INTEGER PRIMARY KEY, id TEXT NOT NULL, scene TEXT NOT NULL, url TEXT NOT NULL,
    order_id TEXT NOT NULL, status TEXT NOT NULL, position INTEGER NOT NULL,
    at_ms INTEGER NOT NULL, retries_max INTEGER NOT NULL, retry_s REAL NOT NULL,
    body BLOB NOT NULL, tries INTEGER NOT NULL, error TEXT NOT NULL
);
"""
COLUMNS = (
    "number, id, scene, url, order_id, status, position, at_ms, retries_max, retry_s, body, "
    "tries, error"
)
INSERT = f"INSERT INTO callbacks ({COLUMNS}) VALUES ({', '.join('?' * 13)})"

log = structlog.get_logger()


class OutboxFile:
    """The open file. One thread at a time uses it; raises sqlite3.Error and OSError."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        """Take a connection to a file with our tables; use `open`."""
        self._connection = connection
        self._path = path
        found = connection.execute("SELECT position, mark FROM followed").fetchone()
        self.position: int | None = None if found is None else found[0]  # None = a new file
        self.mark: str = "" if found is None else found[1]  # of the event at the position

    @classmethod
    def open(cls, path: Path) -> "OutboxFile":
        """Open the file or begin one; one that cannot be read is set aside."""
        if path.exists():
            try:
                return cls._known(path)
            except (sqlite3.DatabaseError, _Unusable) as trouble:
                _set_aside(path, str(trouble))
        return cls._new(path)

    @classmethod
    def _known(cls, path: Path) -> "OutboxFile":
        connection = _connect(path)
        try:
            (sound,) = connection.execute("PRAGMA quick_check(1)").fetchone()
            (version,) = connection.execute("PRAGMA user_version").fetchone()
            if sound != "ok":
                raise _Unusable(sound)
            if version not in (0, VERSION):
                raise _Unusable(f"it is of version {version}, this program knows {VERSION}")
            if version == 0:  # the crash came before its tables
                _make_tables(connection)
            return cls(connection, path)
        except BaseException:
            connection.close()
            raise

    @classmethod
    def _new(cls, path: Path) -> "OutboxFile":
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, MODE))
        connection = _connect(path)
        _make_tables(connection)
        return cls(connection, path)

    def begun_anew(self, reason: str) -> "OutboxFile":
        """Set this file aside, for it tells of another ledger, and give an empty one."""
        self.close()
        _set_aside(self._path, reason)
        return self._new(self._path)

    def waiting(self) -> list[Callback]:
        """Read all that is to be delivered, oldest first."""
        rows = self._connection.execute(f"SELECT {COLUMNS} FROM callbacks ORDER BY number")
        return [_callback(row) for row in rows]

    def cut(self, position: int, mark: str) -> int:
        """Forget callbacks of events behind a position, and go back to it; gives how many."""
        with closing(self._connection.cursor()) as cursor:
            cursor.execute("BEGIN IMMEDIATE")
            try:
                gone = cursor.execute("DELETE FROM callbacks WHERE position > ?", [position])
                count = gone.rowcount
                self._follow(cursor, position, mark)
                cursor.execute("COMMIT")
            except BaseException:
                self._connection.rollback()
                raise
        self.position, self.mark = position, mark
        return count

    def commit(
        self,
        position: int,
        mark: str,
        *,
        fresh: Iterable[Callback] = (),
        settled: Iterable[int] = (),
        tried: Iterable[Callback] = (),
    ) -> None:
        """Write what is new, forget what is settled, note tries, move on: all or nothing."""
        with closing(self._connection.cursor()) as cursor:
            cursor.execute("BEGIN IMMEDIATE")
            try:
                cursor.executemany(INSERT, [_row(callback) for callback in fresh])
                numbers = [(number,) for number in settled]
                cursor.executemany("DELETE FROM callbacks WHERE number = ?", numbers)
                cursor.executemany(
                    "UPDATE callbacks SET tries = ?, error = ? WHERE number = ?",
                    [(callback.tries, callback.error, callback.number) for callback in tried],
                )
                self._follow(cursor, position, mark)
                cursor.execute("COMMIT")
            except BaseException:
                self._connection.rollback()
                raise
        self.position, self.mark = position, mark

    def _follow(self, cursor: sqlite3.Cursor, position: int, mark: str) -> None:
        cursor.execute("DELETE FROM followed")
        cursor.execute("INSERT INTO followed VALUES (?, ?)", (position, mark))

    def close(self) -> None:
        """Let the file go."""
        self._connection.close()


class _Unusable(Exception):
    """The file can be read, but not by us."""


def _connect(path: Path) -> sqlite3.Connection:
    # opened by the thread that starts the server, used by the one that follows
    connection = sqlite3.connect(
        path, timeout=BUSY_S, isolation_level=None, check_same_thread=False
    )
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    return connection


def _make_tables(connection: sqlite3.Connection) -> None:
    connection.executescript(f"BEGIN; {TABLES} PRAGMA user_version = {VERSION}; COMMIT;")


def _set_aside(path: Path, reason: str) -> None:
    aside = path.with_name(path.name + ASIDE)
    for companion in COMPANIONS:
        source = path.with_name(path.name + companion)
        target = aside.with_name(aside.name + companion)
        target.unlink(missing_ok=True)
        if source.exists():
            source.rename(target)
    log.error("outbox set aside; what waited in it is not delivered", path=str(aside), why=reason)


def _row(callback: Callback) -> tuple[Any, ...]:
    return (
        callback.number,
        callback.id,
        callback.scene,
        callback.url,
        callback.order,
        callback.status.value,
        callback.position,
        callback.at_ms,
        callback.retries_max,
        callback.retry_s,
        callback.body,
        callback.tries,
        callback.error,
    )


def _callback(row: tuple[Any, ...]) -> Callback:
    return Callback(
        number=row[0],
        id=row[1],
        scene=SceneId(row[2]),
        url=row[3],
        order=OrderId(row[4]),
        status=CallbackStatus(row[5]),
        position=row[6],
        at_ms=row[7],
        retries_max=row[8],
        retry_s=row[9],
        body=row[10],
        tries=row[11],
        error=row[12],
    )
