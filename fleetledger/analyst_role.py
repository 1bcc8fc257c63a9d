"""The analyst: a process of its own that answers SQL, so that no statement can hurt the core.

DuckDB does not count the memory of long texts and lists against its limit, and binds a hostile
statement for half a minute without hearing that it should stop (both measured). Here the system
sets the limit, and the core kills who does not listen.
"""

import os
import resource
import shutil
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from threading import Condition, Lock, Thread

import msgspec
import structlog

from fleetledger.analyst_frames import Answered, Asked, Dropped, Grown, answer, read
from fleetledger.logs import configure
from ledger.errors import Refused
from ledger.scan import read_folder
from ledger.snapshot import restore
from ledger.state import Fleet
from projections.analytics import Analytics
from projections.sql import FILE, Breaker, SqlAnswer, ask

NICE = 10  # commands and other queries go first
STATEMENTS_MAX = 2  # at once
CATCH_UP_S_MAX = 5.0  # a statement waits so long for the tables; then its caller comes again
BYTES_MAX = 16_000_000  # of an answer
FAILED, RETIRED = 4, 5  # exit codes

log = structlog.get_logger()


class NotReady(Refused):
    """The tables do not hold yet what the statement is to see."""

    status = 503


class AnalystRole:
    """Follows the ledger's files into its own tables, and answers statements over them."""

    def __init__(
        self, data: Path, seconds_max: float, memory_mb: int, send: Callable[[bytes], None]
    ) -> None:
        """Take the data folder, the limits, and what takes answers from any thread."""
        self._data, self._memory_mb, self._send = data, memory_mb, send
        self._seconds_max = seconds_max
        self._read = partial(read_folder, data / "ledger")
        self._moved = Condition()
        self._wanted, self._reached = 0, 0
        self._bytes_idle = 0  # what the process has when no statement runs
        self._analytics: Analytics | None = None
        self._running: dict[int, Breaker] = {}
        self._pending: set[int] = set()  # asked, and not answered
        self._dropped: set[int] = set()
        self._threads = ThreadPoolExecutor(STATEMENTS_MAX, thread_name_prefix="statement")

    def take(self, message: Asked | Dropped | Grown) -> None:
        """Take a message of the core; returns at once."""
        if isinstance(message, Dropped):
            with self._moved:
                breaker = self._running.get(message.number)
                if message.number in self._pending:
                    self._dropped.add(message.number)
                    self._moved.notify_all()
            if breaker is not None:
                breaker.stop()
            return
        with self._moved:
            self._wanted = max(self._wanted, message.position)
            if isinstance(message, Asked):
                self._pending.add(message.number)
            self._moved.notify_all()
        if isinstance(message, Asked):
            self._threads.submit(self._answer, message)

    def follow(self) -> None:
        """Keep the tables at the position that is wanted, for good."""
        with self._moved:
            self._moved.wait_for(lambda: self._wanted > 0)
            newest = self._wanted
        spill = self._data / "analytics.spill"
        shutil.rmtree(spill, ignore_errors=True)  # what a process that was killed has left
        analytics = Analytics.open(
            self._data / FILE, self._read, self._fleet_at, newest, self._memory_mb // 2, spill
        )
        self._bytes_idle = _data_bytes()
        _limit_memory(self._bytes_idle + self._memory_mb * 1_000_000)
        self._analytics = analytics
        while True:
            self._tell(self._analytics.position)
            with self._moved:
                self._moved.wait_for(lambda: self._wanted > self._reached)
                wanted = self._wanted
            self._analytics.catch_up(self._read, wanted, progress=lambda done, _: self._tell(done))

    def _fleet_at(self, position: int) -> Fleet:
        return restore(self._data / "ledger", self._data / "snapshots", position=position)

    def _tell(self, position: int) -> None:
        with self._moved:
            self._reached = position
            self._moved.notify_all()

    def _answer(self, asked: Asked) -> None:
        status, position = 200, self._reached
        try:
            found = self._ask(asked)
            position, body = found.position, msgspec.json.encode(found)
        except Refused as no:
            status, words = no.status, {"code": no.code, "message": no.message}
            body = msgspec.json.encode(words | {"args": list(no.arguments)})
        except BaseException as trouble:  # out of memory, or a bug: only a new process is sure
            log.exception("statement failed", reason=str(trouble))
            os._exit(FAILED)
        with self._moved:
            self._pending.discard(asked.number)
            self._dropped.discard(asked.number)
            idle = not self._pending
        answered = Answered(number=asked.number, status=status, position=position, body=body)
        self._send(answer(answered))
        if idle and _data_bytes() > self._bytes_idle + self._memory_mb * 1_000_000 // 2:
            os._exit(RETIRED)  # what a statement left behind would be missing to the next

    def _ask(self, asked: Asked) -> SqlAnswer:
        with self._moved:
            ready = self._moved.wait_for(
                lambda: self._reached >= asked.position or asked.number in self._dropped,
                CATCH_UP_S_MAX,
            )
        if not ready or self._analytics is None:
            percent = 100 * self._reached // max(1, asked.position)
            words = f"The tables for SQL are being made: {percent} % are there. Try again."
            raise NotReady("errHistoryRebuilding", words, percent)
        cursor = self._analytics.cursor()
        breaker = Breaker(cursor, self._seconds_max)
        with self._moved:
            self._running[asked.number] = breaker
            dropped = asked.number in self._dropped
        if dropped:
            breaker.stop()
        try:
            return ask(
                cursor,
                asked.sql,
                breaker,
                rows_max=asked.rows_max,
                bytes_max=BYTES_MAX,
                seconds_max=self._seconds_max,
            )
        finally:
            with self._moved:
                del self._running[asked.number]


def run_analyst(data: Path, seconds_max: float, memory_mb: int) -> None:
    """Be the analyst's process; ends when standard input closes."""
    configure(process="analyst", as_json=not sys.stderr.isatty())
    os.nice(NICE)
    out, lock = sys.stdout.buffer, Lock()

    def send(answered: bytes) -> None:
        with lock:
            out.write(answered)
            out.flush()

    role = AnalystRole(data, seconds_max, memory_mb, send)
    Thread(target=_follow, args=(role,), name="follow", daemon=True).start()
    while (message := read(sys.stdin.buffer)) is not None:
        role.take(message)
    os._exit(0)  # DuckDB's own log of changes is on disk


def _follow(role: AnalystRole) -> None:
    try:
        role.follow()
    except BaseException as trouble:  # a loop's last resort: the core starts a new process
        log.exception("analytics failed", reason=str(trouble))
        os._exit(FAILED)


def _data_bytes() -> int:
    """Give how much memory for data the process has; 0 where the system does not tell."""
    status = Path("/proc/self/status")
    if not status.exists():  # not Linux: DuckDB's own limit is left
        return 0
    fields = dict(line.split(":", 1) for line in status.read_text().splitlines() if ":" in line)
    return int(fields["VmData"].split()[0]) * 1024


def _limit_memory(limit_bytes: int) -> None:
    """Have the system refuse memory beyond it."""
    if _data_bytes():
        resource.setrlimit(resource.RLIMIT_DATA, (limit_bytes, limit_bytes))
