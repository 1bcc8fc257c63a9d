"""Reading DuckDB for queries: threads, a cursor for each query, and a limit on its time."""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import Any, TypeVar

import duckdb

from ledger.errors import Refused

READERS = 4  # threads; more queries wait
QUERY_S_MAX = 10.0
CHUNK_ROWS = 1_000

T = TypeVar("T")


class TooSlow(Refused):
    """The query took longer than queries may."""

    status = 504


class Unreadable(Refused):
    """The file of the history is damaged."""

    status = 503


class Reader:
    """Runs queries beside the event loop."""

    def __init__(
        self,
        cursor: Callable[[], duckdb.DuckDBPyConnection],
        damaged: Callable[[str], None] | None = None,
        query_s_max: float = QUERY_S_MAX,
    ) -> None:
        """Take what opens cursors, and what is told when the file cannot be read."""
        self._cursor = cursor
        self._damaged = damaged
        self._query_s_max = query_s_max
        self._threads = ThreadPoolExecutor(READERS, thread_name_prefix="reader")

    async def run(self, work: Callable[[duckdb.DuckDBPyConnection], T]) -> T:
        """Do work with a cursor of its own; raises TooSlow when its time is up."""
        one = _One(self._cursor())
        try:
            return await self._limited(one, work)
        finally:
            self._threads.submit(one.close)

    async def stream(self, sql: str, parameters: Sequence[Any]) -> AsyncIterator[list[Any]]:
        """Give rows in chunks, so that an answer of any length needs little memory."""
        one = _One(self._cursor())
        try:
            await self._limited(one, lambda cursor: cursor.execute(sql, list(parameters)))
            while chunk := await self._limited(one, lambda c: c.fetchmany(CHUNK_ROWS)):
                yield chunk
        finally:
            self._threads.submit(one.close)

    async def _limited(self, one: "_One", work: Callable[[duckdb.DuckDBPyConnection], T]) -> T:
        loop = asyncio.get_running_loop()
        timer: asyncio.TimerHandle | None = None

        def begin() -> None:  # waiting for a thread does not count
            nonlocal timer
            timer = loop.call_later(self._query_s_max, one.cursor.interrupt)

        def timed() -> T:
            loop.call_soon_threadsafe(begin)
            return one.do(work)

        try:
            return await loop.run_in_executor(self._threads, timed)
        except duckdb.InterruptException:
            raise TooSlow(
                "errQueryTooSlow",
                f"The query took longer than {self._query_s_max:g} s; narrow it down.",
                self._query_s_max,
            ) from None
        except (duckdb.IOException, duckdb.InternalException, duckdb.FatalException) as trouble:
            if self._damaged is not None:
                self._damaged(str(trouble))
            raise Unreadable(
                "errHistoryUnreadable",
                "Ended orders cannot be read now; the next start of the server mends that.",
            ) from trouble
        except asyncio.CancelledError:
            one.cursor.interrupt()  # the caller has gone
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

    def close(self) -> None:
        """Close it when the thread that uses it has finished."""
        with self._busy:
            self.cursor.close()
