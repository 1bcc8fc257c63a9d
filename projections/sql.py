"""Analytics: one question over documented views of what is in the ledger, within limits."""

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from shutil import copyfile
from threading import Event as Flag
from threading import Thread
from typing import Any, Protocol

import duckdb
import msgspec

from ledger.errors import Refused
from ledger.events import AnyEvent
from ledger.scene import Value
from ledger.snapshot import restore
from projections.analytics import Analytics
from projections.sql_policy import checked, invalid
from projections.sql_values import plain_column

SECONDS_MAX = 60.0
ROWS_MAX = 1_000_000
BYTES_MAX = 64_000_000  # of the rows, as JSON
BATCH_ROWS = 500
PRESS_S = 0.05  # a statement that is to stop is told so again and again: between steps it is deaf
FILE = "analytics.duckdb"

Read = Callable[[int], Iterator[AnyEvent]]  # events behind a position, in order


class Progress(Protocol):
    """Told how many events of how many are read."""

    def __call__(self, done: int, total: int, /) -> None:
        """Take the figures."""


class SqlColumn(Value, frozen=True, kw_only=True):
    """A column of an answer, with its type in DuckDB's words."""

    name: str
    type: str


class SqlAnswer(Value, frozen=True, kw_only=True):
    """Rows of a statement, safe for JSON; `cut` tells that there were more."""

    columns: tuple[SqlColumn, ...]
    rows: tuple[list[Any], ...]
    cut: bool = False
    position: int  # of the newest event that they know


class SqlTooSlow(Refused):
    """Its time is up."""

    status = 504


class Breaker:
    """Breaks a statement off when its time is up, or when told to."""

    def __init__(self, cursor: duckdb.DuckDBPyConnection, seconds_max: float) -> None:
        """Take who runs it; `with` is the time in which it runs."""
        self._cursor = cursor
        self._seconds_max = seconds_max
        self._wake, self._done = Flag(), Flag()
        self.broken = False

    def __enter__(self) -> "Breaker":
        Thread(target=self._watch, name="breaker", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._wake.set()

    def stop(self) -> None:
        """Nobody wants the answer any more."""
        self._wake.set()

    def _watch(self) -> None:
        self._wake.wait(self._seconds_max)
        while not self._done.is_set():
            self.broken = True
            self._cursor.interrupt()
            self._done.wait(PRESS_S)


def ask(
    cursor: duckdb.DuckDBPyConnection,
    statement: str,
    breaker: Breaker,
    *,
    rows_max: int = ROWS_MAX,
    bytes_max: int = BYTES_MAX,
    seconds_max: float = SECONDS_MAX,
) -> SqlAnswer:
    """Answer a statement as of one position, and close the cursor.

    Raises Refused that says what is wrong with the statement.
    """
    try:
        with breaker:
            question = checked(cursor, statement)
            cursor.execute("BEGIN TRANSACTION READ ONLY").fetchall()
            ((position,),) = cursor.execute("SELECT position FROM checkpoint").fetchall()
            return _answer(cursor, question, breaker, int(position), rows_max, bytes_max)
    except duckdb.InterruptException:
        raise SqlTooSlow(
            "errSqlTooSlow",
            f"The statement took longer than {seconds_max:g} s; narrow it down.",
            seconds_max,
        ) from None
    except (duckdb.OutOfMemoryException, MemoryError):
        words = "The statement takes more memory than statements get; narrow it down."
        raise Refused("errSqlTooLarge", words) from None
    except (duckdb.Error, UnicodeDecodeError) as trouble:
        raise invalid(str(trouble)) from None
    finally:
        cursor.close()  # and with it the transaction, and what nobody fetched


def _answer(
    cursor: duckdb.DuckDBPyConnection,
    question: duckdb.Statement,
    breaker: Breaker,
    position: int,
    rows_max: int,
    bytes_max: int,
) -> SqlAnswer:
    rows: list[list[Any]] = []
    size, cut = 0, False
    relation = cursor.sql(question)
    if relation is None:
        raise invalid("The statement gives no rows.")
    columns = tuple(
        SqlColumn(name=name, type=str(type_))
        for name, type_ in zip(relation.columns, relation.types, strict=True)
    )
    for batch in relation.to_arrow_reader(BATCH_ROWS):
        some = [list(row) for row in zip(*map(plain_column, batch.columns), strict=True)]
        size += len(msgspec.json.encode(some))
        rows += some
        if breaker.broken:
            raise duckdb.InterruptException
        if size > bytes_max:
            words = f"The rows are more than {bytes_max} bytes: ask for fewer, or for less of each."
            raise Refused("errSqlTooLarge", words, bytes_max)
        if len(rows) > rows_max:
            cut = True
            break
    return SqlAnswer(columns=columns, rows=tuple(rows[:rows_max]), cut=cut, position=position)


def run_sql(
    data: Path,
    statement: str,
    read: Read,
    progress: Progress = lambda done, total: None,
    *,
    seconds_max: float = SECONDS_MAX,
    rows_max: int = ROWS_MAX,
) -> SqlAnswer:
    """Answer one statement over a data folder, of a server that runs or not; changes nothing.

    `read` gives the events behind a position. The server's own tables are copied where it keeps
    some and does not hold them, and made anew in a temporary folder where it does.
    """
    with tempfile.TemporaryDirectory(prefix="fleetledger-sql-") as folder:
        newest = restore(data / "ledger", data / "snapshots").position
        fleet_at = partial(_fleet_at, data)
        copy = _copied(data / FILE, Path(folder))
        analytics = Analytics.open(copy, read, fleet_at, newest, spill=Path(folder) / "spill")
        try:
            analytics.catch_up(read, newest, progress)
            cursor = analytics.cursor()
            breaker = Breaker(cursor, seconds_max)
            return ask(cursor, statement, breaker, rows_max=rows_max, seconds_max=seconds_max)
        finally:
            analytics.close()


def _fleet_at(data: Path, position: int) -> Any:
    return restore(data / "ledger", data / "snapshots", position=position)


def _copied(path: Path, folder: Path) -> Path:
    """Give the place of a copy; there is none where the file is held, or is not there."""
    copy = folder / path.name
    try:
        with duckdb.connect(str(path), read_only=True):  # nobody writes while we hold it
            copyfile(path, copy)
            wal = path.with_name(path.name + ".wal")
            if wal.exists():
                copyfile(wal, copy.with_name(wal.name))
    except (duckdb.Error, OSError):
        copy.unlink(missing_ok=True)
    return copy
