"""The core's side of SQL: starts the analyst's process when first asked, kills it if need be."""

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable
from itertools import count
from typing import NamedTuple

import structlog

from fleetledger.analyst_frames import (
    HEAD_BYTES,
    Answered,
    Asked,
    Dropped,
    Grown,
    ToAnalyst,
    head,
    written,
)
from fleetledger.analyst_role import CATCH_UP_S_MAX, RETIRED, STATEMENTS_MAX
from fleetledger.config import Settings
from fleetledger.http import Later
from ledger.errors import Refused

GRACE_S = 2.0  # beyond its time, or after its asker has gone; then the process is killed
START_S = 10.0  # for the process to come up
FOLLOW_S = 30.0  # between two looks at what has been added while nobody asks
STOP_S = 1.0
# Arrow's own allocator maps a gigabyte at once, which would count as if a statement had taken it.
PLAIN_MEMORY = {"ARROW_DEFAULT_MEMORY_POOL": "system"}
RETRY_S = 2

log = structlog.get_logger()


class SqlBusy(Later):
    """As many statements run as may, or the process had to be started anew."""

    status = 503


class SqlTooSlow(Refused):
    """Its time is up, and it did not listen."""

    status = 504


class _Waiting(NamedTuple):
    """A statement on its way, and which process has it; None until it is sent."""

    future: "asyncio.Future[Answered]"
    process: asyncio.subprocess.Process | None = None


class Analyst:
    """Answers statements; all of it runs on the event loop."""

    def __init__(self, settings: Settings, position: Callable[[], int]) -> None:
        """Take folder and limits, and what tells the newest position on disk."""
        self._data, self._position = settings.data, position
        self._seconds_max, self._memory_mb = settings.sql_seconds, settings.sql_memory_mb
        self._numbers = count(1)
        self._waiting: dict[int, _Waiting] = {}
        self._starting = asyncio.Lock()
        self._process: asyncio.subprocess.Process | None = None
        self._tasks: list[asyncio.Task[None]] = []

    async def ask(self, sql: str, rows_max: int) -> Answered:
        """Answer a statement, as of everything that is on disk now; raises Refused."""
        if len(self._waiting) >= STATEMENTS_MAX:
            words = f"{STATEMENTS_MAX} statements are running: try again."
            raise SqlBusy("errSqlBusy", words, RETRY_S)
        number = next(self._numbers)
        future: asyncio.Future[Answered] = asyncio.get_running_loop().create_future()
        self._waiting[number] = _Waiting(future)
        process = None
        try:
            process = await self._started()
            self._waiting[number] = _Waiting(future, process)
            position = self._position()
            asked = Asked(number=number, sql=sql, rows_max=rows_max, position=position)
            self._send(process, asked)
            until_s = self._seconds_max + CATCH_UP_S_MAX + START_S + GRACE_S
            async with asyncio.timeout(until_s):
                return await asyncio.shield(future)
        except TimeoutError:
            log.warning("statement did not end", seconds=until_s)
            assert process is not None
            self._kill(process)
            words = f"The statement took longer than {self._seconds_max:g} s, and was killed."
            raise SqlTooSlow("errSqlTooSlow", words, self._seconds_max) from None
        except asyncio.CancelledError:
            if process is not None and not future.done():
                self._send(process, Dropped(number=number))
                loop = asyncio.get_running_loop()
                loop.call_later(GRACE_S, self._unheard, number, process)
                future.add_done_callback(_seen)
                number = 0  # its place is free once it has really ended
            raise
        finally:
            self._waiting.pop(number, None)

    def _unheard(self, number: int, process: asyncio.subprocess.Process) -> None:
        if number in self._waiting:
            log.warning("statement of a caller who has gone did not end")
            self._kill(process)

    async def _started(self) -> asyncio.subprocess.Process:
        async with self._starting:
            if self._process is None:
                self._process = await asyncio.create_subprocess_exec(
                    sys.executable,
                    *("-m", "fleetledger", "role", "analyst", "--data", str(self._data)),
                    *("--seconds-max", str(self._seconds_max)),
                    *("--memory-mb", str(self._memory_mb)),
                    stdin=asyncio.subprocess.PIPE,
                    stdout=asyncio.subprocess.PIPE,
                    env=os.environ | PLAIN_MEMORY,
                    start_new_session=True,
                )
                self._tasks = [
                    asyncio.create_task(self._listen(self._process), name="analyst"),
                    asyncio.create_task(self._feed(self._process), name="analyst's feed"),
                ]
            return self._process

    def _send(self, process: asyncio.subprocess.Process, message: ToAnalyst) -> None:
        assert process.stdin is not None
        if not process.stdin.is_closing():  # else it has ended, and `_listen` tells who waits
            process.stdin.write(written(message))

    async def _feed(self, process: asyncio.subprocess.Process) -> None:
        """Have the tables grow while nobody asks, so that whoever asks next need not wait."""
        told = 0
        while self._process is process:
            await asyncio.sleep(FOLLOW_S)
            if self._process is process and self._position() > told:
                told = self._position()
                self._send(process, Grown(position=told))

    async def _listen(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        with contextlib.suppress(asyncio.IncompleteReadError):
            while True:
                raw = await process.stdout.readexactly(HEAD_BYTES)
                number, status, position, length = head(raw)
                body = await process.stdout.readexactly(length)
                if number in self._waiting:
                    answered = Answered(number=number, status=status, position=position, body=body)
                    self._settle(number, answered)
        code = await process.wait()
        lost = [number for number, one in self._waiting.items() if one.process is process]
        if self._process is process:  # nobody told it to
            self._process = None
            if code != RETIRED:
                log.error("analyst ended", exit_code=code, statements=len(lost))
        alone = len(lost) == 1 and code != RETIRED
        for number in lost:
            self._settle(number, _broken(self._memory_mb) if alone else _restarted())

    def _settle(self, number: int, outcome: Answered | Refused) -> None:
        future = self._waiting.pop(number).future
        if future.done():
            return
        if isinstance(outcome, Refused):
            future.set_exception(outcome)
        else:
            future.set_result(outcome)

    def _kill(self, process: asyncio.subprocess.Process) -> None:
        if self._process is process:  # who asks next gets another
            self._process = None
        with contextlib.suppress(ProcessLookupError):
            process.kill()

    async def close(self) -> None:
        """End the process; statements that run are given up."""
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        process.stdin.close()
        try:
            await asyncio.wait_for(process.wait(), STOP_S)
        except TimeoutError:
            self._kill(process)
            await process.wait()
        for task in self._tasks:
            task.cancel()


def _broken(memory_mb: int) -> Refused:
    words = f"The statement needs more than statements get ({memory_mb} MB, or DuckDB's own limits)"
    return Refused("errSqlTooLarge", f"{words}; write it otherwise.", memory_mb)


def _restarted() -> Refused:
    return SqlBusy("errSqlBusy", "Another statement broke this one off: try again.", RETRY_S)


def _seen(future: "asyncio.Future[Answered]") -> None:
    """Take note of a failure that nobody waits for any more."""
    if not future.cancelled():
        future.exception()
