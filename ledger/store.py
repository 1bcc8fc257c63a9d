"""The ledger in files: append, read, and hear of what is on disk.

One committer thread turns whatever waits into one chunk, one write, one sync; so many waiting
clients share a sync. `append` only queues; `durable` and the listeners say what is safe.
"""

import threading
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Self

import structlog

from ledger.chunks import Tally
from ledger.damage import Progress, unseen
from ledger.disk import Disk
from ledger.errors import Conflict, LedgerBusy, LedgerError, Unknown, next_step
from ledger.events import AnyEvent
from ledger.lock import Lock
from ledger.port import Ledger, Listener, MemoryLedger, check_stamps
from ledger.recovery import Recovered, recover
from ledger.scan import events_between, read_segment
from ledger.sealed import is_sealed
from ledger.segment import (
    SEGMENT_BYTES_MAX,
    SEGMENT_CHUNKS_MAX,
    SegmentWriter,
    first_position,
)

__all__ = ["FileLedger", "Ledger", "Listener", "MemoryLedger"]

log = structlog.get_logger()

CHUNK_EVENTS_MAX = 512  # a commit takes no more commands once it has as many events
CHUNK_BYTES_MAX = 1024 * 1024  # or as many bytes
QUEUE_EVENTS_MAX = 65_536  # a few seconds of a slow disk

Rouse = Callable[[Callable[[], None]], None]  # called with what wakes the committer


class FileLedger:
    """A folder of segments, with a lock on it and a thread that commits.

    Without a thread it commits where somebody waits, and where `step` is called: one thread does
    everything, so the same calls meet the disk in the same order.
    """

    def __init__(
        self,
        directory: Path,
        disk: Disk,
        lock: Lock,
        found: Recovered,
        *,
        segment_bytes_max: int,
        segment_chunks_max: int,
        threaded: bool,
    ) -> None:
        """Go on where recovery says; use `open`."""
        self.position = found.position
        self.durable = found.position
        self._directory = directory
        self._disk = disk
        self._lock = lock
        self._bytes_max = segment_bytes_max
        self._chunks_max = segment_chunks_max
        self._paths = list(found.paths)  # finished segments, and the one being written
        self._firsts = [first_position(path) for path in self._paths]
        self._last_ns = found.last_ns
        self._predecessor = found.sha256
        self._writer: SegmentWriter | None = None  # made with the first commit
        self._queue: deque[Sequence[AnyEvent]] = deque()
        self._queued = 0  # events
        self._rouse: Rouse = lambda wake: wake()
        self._listeners: list[Listener] = []
        self._reports: list[Callable[[LedgerError], None]] = []
        self._failure: LedgerError | None = None
        self._closing = False
        self._ended = False  # nothing more will be written
        self._told = found.position  # newest that all listeners have heard
        self._filled = threading.Condition()  # guards queue, position, closing, failure
        self._synced = threading.Condition()  # guards told
        self._files = threading.Lock()  # guards paths, writer's index, durable
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._run, name="ledger-committer", daemon=True)
            self._thread.start()

    @classmethod
    def open(
        cls,
        directory: Path,
        *,
        segment_bytes_max: int = SEGMENT_BYTES_MAX,
        segment_chunks_max: int = SEGMENT_CHUNKS_MAX,
        disk: Disk | None = None,
        threaded: bool = True,
        snapshots: Path | None = None,
        progress: Progress = unseen,
    ) -> Self:
        """Lock the folder of segments (made if missing), mend a torn tail, be ready to append.

        Checks every byte of it first, and that the ledger reaches as far as the snapshots where
        their folder is given. Raises LedgerLocked, LedgerDamaged.
        """
        disk = disk or Disk()
        disk.make_folder(directory)
        lock = Lock(directory)
        try:
            disk.sync_folder(directory.parent)
            found = recover(disk, directory, snapshots, progress)
        except BaseException:
            lock.close()
            raise
        return cls(
            directory,
            disk,
            lock,
            found,
            segment_bytes_max=segment_bytes_max,
            segment_chunks_max=segment_chunks_max,
            threaded=threaded,
        )

    def append(self, events: Sequence[AnyEvent], expected: int) -> int:
        """Queue events; no more than a lock, for it runs on the thread that answers clients."""
        position = check_stamps(events, expected)
        with self._filled:
            if self._failure is not None:
                raise _again(self._failure)
            if self._closing:
                raise Unknown("the ledger is closed")
            if expected != self.position:
                raise Conflict(expected, self.position)
            if not events:
                return position
            if self._queued and self._queued + len(events) > QUEUE_EVENTS_MAX:
                raise LedgerBusy(f"{self._queued} events wait for the disk already")
            first = not self._queue
            self._queue.append(events)
            self._queued += len(events)
            self.position = position
        if first:
            self._rouse(self._wake)
        return position

    def _wake(self) -> None:
        with self._filled:
            self._filled.notify()

    def rouse_by(self, rouse: Rouse) -> None:
        """Let somebody else rouse the committer: soon, once what else is to be appended is."""
        self._rouse = rouse

    def listen(self, listener: Listener) -> None:
        """Hear of every commit from now on."""
        self._listeners.append(listener)

    def on_failure(self, report: Callable[[LedgerError], None]) -> None:
        """Hear of the failure that ends it; at once if there has been one."""
        self._reports.append(report)
        if self._failure is not None:
            report(self._failure)

    def wait(self, position: int, timeout_s: float) -> bool:
        """Wait for the listeners to have heard of a position."""
        while self._thread is None and self._told < position and self.step():
            pass
        with self._synced:
            done = self._synced.wait_for(
                lambda: self._told >= position or self._failure is not None, timeout_s
            )
            if self._told >= position:
                return True
        if self._failure is not None:
            raise _again(self._failure)
        return done

    def read(self, after: int, until: int | None = None) -> Iterator[AnyEvent]:
        """Read from the files, every CRC checked; raises LedgerDamaged."""
        with self._files:
            until = self.durable if until is None else min(until, self.durable)
            paths, firsts, writer = list(self._paths), list(self._firsts), self._writer
        for number in range(max(0, bisect_right(firsts, after + 1) - 1), len(paths)):
            if firsts[number] > until:
                return
            if writer is not None and paths[number] == writer.path:
                yield from self._read_live(writer, after, until)
            else:
                yield from read_segment(paths[number], after, until, newest=False)

    def _read_live(self, writer: SegmentWriter, after: int, until: int) -> Iterator[AnyEvent]:
        """Read committed chunks of the newest segment, from the one that is wanted."""
        with self._files:
            number = max(0, bisect_right(writer.index, after + 1) - 1)
            behind = bisect_right(writer.index, until)
            start = writer.offsets[number]
            end = writer.offsets[behind] if behind < len(writer.offsets) else writer.size
            sequence = writer.index[number] - writer.first
        with writer.path.open("rb") as file:
            swapped = is_sealed(file)  # since the caller began to read
            file.seek(start)
            data = file.read(end - start)
        if swapped:
            yield from read_segment(writer.path, after, until, newest=False)
            return
        tally = Tally(sequence=sequence)
        for events in events_between(writer.path, data, 0, len(data), tally, base=start):
            for event in events:
                if after < event.position <= until:
                    yield event

    def close(self) -> None:
        """Commit what is queued, finish the segment, release the folder; again does nothing."""
        with self._filled:
            self._closing = True
            self._filled.notify()
        if self._thread is threading.current_thread():
            return
        try:
            if self._thread is None:
                self._run()
            else:
                self._thread.join()
        finally:
            self._lock.close()

    def step(self) -> bool:
        """Make one commit of what is queued, in the caller's thread; False where nothing is.

        Only for a ledger without a thread of its own.
        """
        if self._ended or not self._queue:
            return False
        self._go_on()
        return not self._ended

    def _run(self) -> None:
        while not self._ended:
            self._go_on()

    def _go_on(self) -> None:
        """Make a commit, or after the last one the end."""
        try:
            if taken := self._take():
                self._commit(taken)
                return
            if self._writer is not None:
                self._writer.finish()
        except Exception as error:  # whatever it is, nothing may be acknowledged any more
            self._fail(error)
        self._ended = True

    def _take(self) -> list[Sequence[AnyEvent]]:
        """Wait for events; gives those of whole commands, nothing at the end."""
        with self._filled:
            while not self._queue and not self._closing:
                self._filled.wait()
            taken: list[Sequence[AnyEvent]] = []
            count = 0
            while self._queue and (not taken or count + len(self._queue[0]) <= CHUNK_EVENTS_MAX):
                taken.append(self._queue.popleft())
                count += len(taken[-1])
            self._queued -= count
            return taken

    def _commit(self, taken: list[Sequence[AnyEvent]]) -> None:
        written: list[AnyEvent] = []
        for events in taken:
            writer = self._writer_for(events[0].position)
            writer.add(events)
            written += events
            if writer.pending_bytes >= CHUNK_BYTES_MAX:
                self._sync(writer, written)
                written = []
        if written:
            self._sync(self._writer_for(written[0].position), written)

    def _writer_for(self, position: int) -> SegmentWriter:
        """Give the newest segment, a new one where it is full. Never between add and commit."""
        writer = self._writer
        if writer is not None and (
            writer.pending_bytes
            or (writer.size < self._bytes_max and len(writer.index) < self._chunks_max)
        ):
            return writer
        if writer is not None:
            self._last_ns = writer.last_ns
            self._predecessor = writer.finish()
        made = SegmentWriter(
            self._disk, self._directory, position, self._last_ns, self._predecessor
        )
        with self._files:
            self._writer = made
            self._paths.append(made.path)
            self._firsts.append(position)
        return made

    def _sync(self, writer: SegmentWriter, events: Sequence[AnyEvent]) -> None:
        writer.write()
        with self._files:
            writer.committed()
            self.durable = events[-1].position
        for listener in self._listeners:
            listener(events)
        with self._synced:
            self._told = events[-1].position
            self._synced.notify_all()
        writer.hash()

    def _fail(self, error: Exception) -> None:
        """Stop for good: after a failed sync nobody knows what the disk holds; never try again."""
        failure = Unknown(f"the ledger stopped at position {self.durable}: {error}")
        failure.__cause__ = error
        failure.hint = next_step(error) or failure.hint
        log.error("ledger failed", position=self.durable, error=repr(error))
        with self._filled:
            self._failure = failure
            self._queue.clear()
            self._queued = 0
        with self._synced:
            self._synced.notify_all()
        if self._writer is not None:
            self._writer.close()
        for report in self._reports:
            report(failure)


def _again(failure: LedgerError) -> Unknown:
    """Tell one more caller: an exception that is raised twice would keep both their frames."""
    told = Unknown(str(failure))
    told.hint, told.__cause__ = failure.hint, failure
    return told
