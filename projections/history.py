"""History: follows the durable events into DuckDB with one thread, some 100 ms behind."""

from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Condition, Lock, Thread
from typing import TypeAlias

import duckdb
import structlog

from ledger.events import AnyEvent
from ledger.state import Fleet
from projections.archive import Archive, Read
from projections.live import NEWEST_KEPT, Live
from projections.projector import Projector

BATCH_EVENTS = 1_000
BATCH_S = 0.1  # a batch waits so long for more
QUEUE_EVENTS_MAX = 20_000  # more are not kept here but read from the ledger again
RETRY_S = 1.0
FAILURES_MAX = 5  # in a row; then the thread gives up and ended orders stay in memory
CLOSE_S = 2.0

FleetAt: TypeAlias = Callable[[int], Fleet]  # the state at a position

log = structlog.get_logger()


class History:
    """The projector. It only ever sees durable events, so it is never ahead of the ledger."""

    def __init__(self, path: Path, live: Live) -> None:
        """Take the file, and what forgets ended orders once they are in it."""
        self._path = path
        self._live = live
        self._queue: deque[AnyEvent] = deque()
        self._newest = 0  # position known to be in the ledger
        self._changed = Condition()
        self.moved = Condition()  # told after each commit
        self._starting = Lock()
        self._stopped = False
        self._failed = False
        self._archive: Archive | None = None
        self._thread: Thread | None = None
        self._read: Read | None = None
        self._fleet_at: FleetAt | None = None

    def start(self, read: Read, fleet_at: FleetAt) -> None:
        """Catch up with the ledger, then follow it; must end before the first query is answered.

        A file that is missing, damaged, of another version or of another ledger is built anew.
        """
        with self._starting:
            self._start(read, fleet_at)

    def _start(self, read: Read, fleet_at: FleetAt) -> None:
        self._read, self._fleet_at = read, fleet_at
        archive = Archive.open(self._path)
        if archive.position > self._live.position or not archive.belongs_to(read):
            log.warning(
                "history is not of this ledger and is built anew",
                path=str(self._path),
                position=archive.position,
            )
            archive.close(delete=True)
            archive = Archive.open(self._path)
        self._archive = archive
        projector = self._projector()
        archive.catch_up(projector, read, stop=lambda: self._stopped)
        if self._stopped:
            return
        self._live.forget(archive.position)
        newest = archive.newest(NEWEST_KEPT + 1, self._live.position)
        self._live.seed(newest[:NEWEST_KEPT], are_all=len(newest) <= NEWEST_KEPT)
        self._thread = Thread(target=self._run, args=(projector,), name="history", daemon=True)
        self._thread.start()

    def follow(self, events: Sequence[AnyEvent]) -> None:
        """Take durable events, in order; returns at once."""
        if not events:
            return
        with self._changed:
            self._newest = events[-1].position
            idle = not self._queue
            if len(self._queue) + len(events) > QUEUE_EVENTS_MAX:
                self._queue.clear()  # the thread sees the gap and reads the ledger
            else:
                self._queue.extend(events)
            # a thread that waits for more of them wakes by its clock: waking it with each commit
            # took the interpreter's lock from those who answer clients
            if idle or len(self._queue) >= BATCH_EVENTS:
                self._changed.notify()

    @property
    def position(self) -> int:
        """Position of the newest event in the file."""
        return self._opened.position

    def cursor(self) -> duckdb.DuckDBPyConnection:
        """Give a reader of its own."""
        return self._opened.cursor()

    def damaged(self, reason: str) -> None:
        """Take note that a query could not read the file: the next start builds it anew."""
        self._failed = True
        log.error("history is damaged; restart the server, it will be built anew", reason=reason)

    def close(self) -> None:
        """Stop within two seconds; what is not yet in the file comes in at the next start."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        with self._starting:  # a rebuild ends after the batch it is at
            self._close()

    def _close(self) -> None:
        if self._thread is not None:
            self._thread.join(CLOSE_S / 2)
            if self._thread.is_alive():
                self._opened.interrupt()
                self._thread.join(CLOSE_S / 2)
        if self._archive is not None:
            self._archive.close(delete=self._failed)

    @property
    def _opened(self) -> Archive:
        assert self._archive is not None, "start the history before using it"
        return self._archive

    def _projector(self) -> Projector:
        assert self._fleet_at is not None
        position = self._opened.position
        if position == 0:
            return Projector(Fleet())
        if position == self._live.position:  # the usual case costs no fold
            return Projector(self._live.fleet)
        return Projector(self._fleet_at(position))

    def _run(self, projector: Projector) -> None:
        failures = 0
        while (batch := self._batch(projector.position)) is not None:
            try:
                self._commit(projector, batch)
                failures = 0
            except Exception as trouble:  # whatever it was, queries go on from memory
                if self._stopped:
                    return
                failures += 1
                log.exception("history falls behind", reason=str(trouble), failures=failures)
                if failures == FAILURES_MAX:
                    self._failed = True
                    log.error("history has stopped; restart the server, it will be built anew")
                    return
                with self._changed:
                    self._changed.wait_for(lambda: self._stopped, RETRY_S)
                assert self._fleet_at is not None
                projector = Projector(self._fleet_at(self._opened.position))

    def _batch(self, position: int) -> list[AnyEvent] | None:
        """Wait for events, and a little for more of them; an empty batch = read the ledger."""
        with self._changed:
            self._changed.wait_for(lambda: self._stopped or self._newest > position)
            self._changed.wait_for(
                lambda: self._stopped or len(self._queue) >= BATCH_EVENTS, BATCH_S
            )
            if self._stopped:
                return None
            while self._queue and self._queue[0].position <= position:
                self._queue.popleft()
            if not self._queue or self._queue[0].position != position + 1:
                return []
            return [self._queue.popleft() for _ in range(min(BATCH_EVENTS, len(self._queue)))]

    def _commit(self, projector: Projector, batch: Sequence[AnyEvent]) -> None:
        if batch:
            for event in batch:
                projector.take(event)
            self._opened.commit(projector)
        else:
            assert self._read is not None
            self._opened.catch_up(projector, self._read, stop=lambda: self._stopped)
        self._live.forget(self._opened.position)
        with self.moved:
            self.moved.notify_all()
