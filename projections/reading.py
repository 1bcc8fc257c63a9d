"""Reading DuckDB for queries: threads, a cursor for each query, and a limit on its time."""

import asyncio
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from threading import Lock
from typing import Any, Protocol, TypeAlias, TypeVar

import duckdb

from ledger.errors import Refused

READERS = 4  # threads; more queries wait
QUERY_S_MAX = 10.0
CHUNK_ROWS = 1_000
REBUILDING_WAIT_S = 5

T = TypeVar("T")
Select: TypeAlias = tuple[str, list[Any]]  # a statement and its parameters


class TooSlow(Refused):
    """The query took longer than queries may."""

    status = 504


class Rebuilding(Refused):
    """DuckDB does not have all the rows that the query needs: it is behind, or built anew."""

    status = 503
    wait_s = REBUILDING_WAIT_S

    def __init__(self, have: int, need: int) -> None:
        """Take how far it is and how far it must be, as positions of the ledger."""
        percent = 100 * have // max(need, have, 1)
        super().__init__(
            "errHistoryRebuilding",
            f"The history of ended orders is being rebuilt, {percent} % are done: try again later. "
            "Live orders, commands, robots and scenes are served.",
            percent,
        )


def is_broken(trouble: duckdb.Error) -> bool:
    """Whether the file, or DuckDB itself, is broken; not the statement."""
    broken = (
        duckdb.IOException,
        duckdb.SerializationException,
        duckdb.InternalException,
        duckdb.FatalException,
    )
    return type(trouble) is duckdb.Error or isinstance(trouble, broken)


class Cursors(Protocol):
    """Opens cursors on a history that has every row up to a position; raises Rebuilding."""

    def __call__(self, need: int = 0, /) -> duckdb.DuckDBPyConnection:
        """Open one."""


class Reader:
    """Runs queries beside the event loop."""

    def __init__(
        self,
        cursor: Cursors,
        damaged: Callable[[duckdb.Error], None] = lambda trouble: None,
        query_s_max: float = QUERY_S_MAX,
    ) -> None:
        """Take what opens cursors, and what is told when the file cannot be read."""
        self._cursor = cursor
        self._damaged = damaged
        self._query_s_max = query_s_max
        self._threads = ThreadPoolExecutor(READERS, thread_name_prefix="reader")

    async def run(self, work: Callable[[duckdb.DuckDBPyConnection], T], need: int = 0) -> T:
        """Do work with a cursor of its own on rows up to a position.

        Raises Rebuilding where they are not there, TooSlow when its time is up.
        """
        one = _One(self._cursor(need))
        try:
            return await self._limited(one, work)
        finally:
            self._threads.submit(one.close)

    async def stream(
        self, select: Callable[[duckdb.DuckDBPyConnection], Select], need: int = 0
    ) -> AsyncIterator[list[Any]]:
        """Give rows in chunks, so that an answer of any length needs little memory."""
        one = _One(self._cursor(need))
        try:
            await self._limited(one, lambda cursor: cursor.execute(*select(cursor)))
            while chunk := await self._limited(one, lambda c: c.fetchmany(CHUNK_ROWS)):
                yield chunk
        finally:
            self._threads.submit(one.close)

    async def _limited(self, one: "_One", work: Callable[[duckdb.DuckDBPyConnection], T]) -> T:
        loop = asyncio.get_running_loop()
        timer: asyncio.TimerHandle | None = None
        late = False

        def begin() -> None:  # waiting for a thread does not count
            nonlocal timer
            timer = loop.call_later(self._query_s_max, break_off)

        def break_off() -> None:
            nonlocal late
            late = True
            one.interrupt()

        def timed() -> T:
            loop.call_soon_threadsafe(begin)
            return one.do(work)

        try:
            return await loop.run_in_executor(self._threads, timed)
        except duckdb.InterruptException:
            if not late:  # not by us: the file is being closed under it
                raise Rebuilding(0, 0) from None
            raise TooSlow(
                "errQueryTooSlow",
                f"The query took longer than {self._query_s_max:g} s; narrow it down.",
                self._query_s_max,
            ) from None
        except duckdb.ConnectionException:  # closed already
            raise Rebuilding(0, 0) from None
        except duckdb.Error as trouble:
            if not is_broken(trouble):
                raise
            self._damaged(trouble)
            raise Rebuilding(0, 0) from trouble
        except asyncio.CancelledError:
            one.interrupt()  # the caller has gone
            raise
        finally:
            if timer is not None:
                timer.cancel()

    async def beside(self, work: Callable[[], T]) -> T:
        """Do other slow work, like folding a past state, in the same threads."""
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)

    def close(self) -> None:
        """Wait for the queries that are running."""
        self._threads.shutdown()


class _One:
    """A cursor, used by one thread after the other."""

    def __init__(self, cursor: duckdb.DuckDBPyConnection) -> None:
        self.cursor = cursor
        self._busy = Lock()

    def do(self, work: Callable[[duckdb.DuckDBPyConnection], T]) -> T:
        with self._busy:
            return work(self.cursor)

    def interrupt(self) -> None:
        with suppress(duckdb.ConnectionException):  # it is closed
            self.cursor.interrupt()

    def close(self) -> None:
        """Close it when the thread that uses it has finished."""
        with self._busy:
            self.cursor.close()
