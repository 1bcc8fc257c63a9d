"""History: follows the durable events into DuckDB with one thread, some 100 ms behind.

Whatever is wrong with the file is mended while others are served: it is opened again, or built anew
from the ledger. Until it has the rows that a query needs, the query is refused.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Condition, Thread
from time import monotonic
from typing import TypeAlias

import duckdb
import structlog

from ledger.errors import LedgerError
from ledger.events import AnyEvent
from ledger.pace import GiveWay, at_once
from ledger.state import Fleet
from projections.archive import SLICE, Archive, Read, is_damage
from projections.live import NEWEST_KEPT, Live
from projections.projector import Projector
from projections.reading import Rebuilding, is_broken

BATCH_EVENTS = 1_000
BATCH_S = 0.1  # a batch waits so long for more
QUEUE_EVENTS_MAX = 20_000  # more are not kept here but read from the ledger again
START_WAIT_S = 1.0  # for a file that is nearly up to date, so that no first query is refused
RETRY_S, RETRY_S_MAX = 0.5, 30.0  # doubled by each failure in a row
FAILURES_MAX = 4  # in a row without a step forward; then the file is built anew
PROGRESS_S = 5.0  # between two lines of the log when rebuilding
CLOSE_S = 2.0

FleetAt: TypeAlias = Callable[[int], Fleet]  # the state at a position
Told: TypeAlias = Callable[[int, int], None]  # position reached, position to reach

log = structlog.get_logger()


class History:
    """The projector. It only ever sees durable events, so it is never ahead of the ledger."""

    def __init__(
        self,
        path: Path,
        live: Live,
        told: Told = lambda position, newest: None,
        give_way: GiveWay = at_once,
    ) -> None:
        """Take the file, what forgets ended orders once they are in it, and who hears of it.

        `give_way` is called about once a millisecond of work, to let others go first.
        """
        self._path = path
        self._live = live
        self._told = told
        self._give_way = give_way
        self._queue: deque[AnyEvent] = deque()
        self.newest = 0  # position known to be in the ledger
        self._changed = Condition()  # guards queue, newest, stopped, damage
        self.moved = Condition()  # told after each commit
        self._stopped = False
        self._damage: str | None = None
        self._archive: Archive | None = None  # None while it is opened
        self._due = 0  # newest position at start
        self._seeded = False  # it is reached
        self._known = Fleet()  # state at start: going on from there costs no fold
        self._thread: Thread | None = None
        self._read: Read
        self._fleet_at: FleetAt

    def start(self, read: Read, fleet_at: FleetAt, wait_s: float = START_WAIT_S) -> None:
        """Catch up with the ledger, then follow it, in a thread; waits a little for the first.

        A file that is missing, damaged, of another version or of another ledger is built anew.
        """
        self._read, self._fleet_at = read, fleet_at
        self._known = self._live.fleet.copy()
        self._due = self.newest = self._known.position
        self._thread = Thread(target=self._run, name="history", daemon=True)
        self._thread.start()
        with self.moved:
            self.moved.wait_for(lambda: self._seeded, wait_s)

    def follow(self, events: Sequence[AnyEvent]) -> None:
        """Take durable events, in order; returns at once."""
        if not events:
            return
        with self._changed:
            self.newest = events[-1].position
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
        """Position of the newest event in the file; 0 while it is opened."""
        archive = self._archive
        return 0 if archive is None else archive.position

    def cursor(self, need: int = 0) -> duckdb.DuckDBPyConnection:
        """Give a reader of its own on every row up to a position; raises Rebuilding.

        Ask for what the answer relies on: the file may be begun anew at any moment, but not under
        an open cursor.
        """
        archive = self._archive
        if archive is not None and archive.position >= need:
            try:
                return archive.cursor(need)
            except duckdb.ConnectionException:  # it is being closed
                pass
        raise Rebuilding(self.position, max(need, self.newest))

    @contextmanager
    def reading(self, need: int = 0) -> Iterator[duckdb.DuckDBPyConnection]:
        """Read in a thread of one's own; raises Rebuilding, for a file that is damaged too."""
        try:
            with self.cursor(need) as cursor:
                yield cursor
        except (duckdb.InterruptException, duckdb.ConnectionException):  # it is being closed
            raise Rebuilding(self.position, self.newest) from None
        except duckdb.Error as trouble:
            if not is_broken(trouble):
                raise
            self.damaged(trouble)
            raise Rebuilding(self.position, self.newest) from trouble

    def damaged(self, trouble: duckdb.Error) -> None:
        """Take note that a query could not read the file: it is opened again, or built anew."""
        with self._changed:
            if self._damage is None and not self._stopped:
                self._damage = str(trouble) if is_damage(trouble) else ""
                log.error("history cannot be read", reason=str(trouble))
                self._changed.notify()

    def close(self) -> None:
        """Stop within some seconds; what is not yet in the file comes in at the next start."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        if self._thread is None:
            return
        self._thread.join(CLOSE_S / 2)
        if self._thread.is_alive() and self._archive is not None:
            self._archive.interrupt()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        failures, failed_at, wait_s = 0, -1, RETRY_S
        while not self._stopped:
            try:
                self._open_and_follow()
                self._close(delete=bool(self._damage))
                continue
            except Exception as trouble:  # whatever it was, live orders are served meanwhile
                if self._stopped:
                    break
                failures = failures + 1 if self.position <= failed_at else 1
                failed_at = self.position
                wait_s = RETRY_S if failures == 1 else min(2 * wait_s, RETRY_S_MAX)
                ours = isinstance(trouble, duckdb.Error)
                words = {"reason": str(trouble), "failures": failures}
                log.error("history falls behind", **words, exc_info=not ours)
                elsewhere = isinstance(trouble, LedgerError | OSError | duckdb.IOException)
                hopeless = failures % FAILURES_MAX == 0 and not elsewhere
                self._close(delete=hopeless or is_damage(trouble))
            self._wait(lambda: self._stopped, wait_s)
        self._close(delete=bool(self._damage))

    def _close(self, *, delete: bool) -> None:
        archive, self._archive = self._archive, None
        if archive is None:
            return
        try:
            archive.close(delete=delete)
        except duckdb.Error as trouble:  # not written back: its write-ahead log has it
            log.warning("history was not closed well", reason=str(trouble))
        if delete:
            log.warning("history is built anew", path=str(self._path))

    def _open_and_follow(self) -> None:
        """Work on the open file until it is to be closed; raises what is in the way."""
        archive = Archive.open(self._path)
        if not archive.belongs_to(self._read):
            log.warning("history is of another ledger", position=archive.position)
            archive.close(delete=True)
            archive = Archive.open(self._path)
        self._archive, self._damage = archive, None
        same = archive.position == self._known.position
        projector = Projector(self._known if same else self._fleet_at(archive.position))
        self._known = Fleet()
        self._tell()
        while (batch := self._batch(projector.position)) is not None:
            if batch:
                for start in range(0, len(batch), SLICE):
                    projector.take_all(batch[start : start + SLICE])
                    self._give_way()
                archive.commit(projector, self._give_way)
            else:
                self._catch_up(archive, projector)
            self._committed(archive)

    def _catch_up(self, archive: Archive, projector: Projector) -> None:
        said_s = monotonic()
        since = archive.position

        def told(position: int) -> None:
            nonlocal said_s
            self._tell()
            if monotonic() - said_s > PROGRESS_S:
                said_s = monotonic()
                percent = 100 * position // max(self.newest, 1)
                log.info(
                    "history is being rebuilt",
                    percent=percent, position=position, of=self.newest, since=since,
                )  # fmt: skip

        archive.catch_up(projector, self._read, self._interrupted, told, self._give_way)
        if monotonic() - said_s > PROGRESS_S or since == 0:
            log.info("history is up to date", position=archive.position, since=since)

    def _committed(self, archive: Archive) -> None:
        self._live.forget(archive.position)
        if not self._seeded and archive.position >= self._due:
            newest = archive.newest(NEWEST_KEPT + 1, self._due)
            self._live.seed(newest[:NEWEST_KEPT], are_all=len(newest) <= NEWEST_KEPT)
            self._seeded = True
        self._tell()

    def _tell(self) -> None:
        self._told(self.position, self.newest)
        with self.moved:
            self.moved.notify_all()

    def _interrupted(self) -> bool:
        return self._stopped or self._damage is not None

    def _wait(self, until: Callable[[], bool], timeout_s: float | None = None) -> None:
        with self._changed:
            self._changed.wait_for(until, timeout_s)

    def _batch(self, position: int) -> list[AnyEvent] | None:
        """Wait for events, and a little for more of them; an empty batch = read the ledger.

        None where the file is to be closed.
        """
        with self._changed:
            if not self._seeded:
                return None if self._interrupted() else []
            self._changed.wait_for(lambda: self._interrupted() or self.newest > position)
            self._changed.wait_for(
                lambda: self._interrupted() or len(self._queue) >= BATCH_EVENTS, BATCH_S
            )
            if self._interrupted():
                return None
            while self._queue and self._queue[0].position <= position:
                self._queue.popleft()
            if not self._queue or self._queue[0].position != position + 1:
                return []
            return [self._queue.popleft() for _ in range(min(BATCH_EVENTS, len(self._queue)))]
