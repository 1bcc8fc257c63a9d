"""The outbox: follows the durable events with one thread and keeps what is to be told to whom.

A callback is in the file, with the position of its event, before anybody may send it, and stays
there until it was accepted or given up: a crash at any instant loses none.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from itertools import islice
from pathlib import Path
from threading import Condition, Thread
from typing import TypeAlias

import msgspec
import structlog

from ledger.events import AnyEvent, CallbacksConfigured
from ledger.state import Fleet
from projections.callbacks import Callback, Telling
from projections.outbox_file import OutboxFile

BATCH_EVENTS = 1_000
BATCH_S = 0.05  # a batch waits so long for more events; what was accepted is noted at once
QUEUE_EVENTS_MAX = 20_000  # more are not kept here but read from the ledger again
# with so many callbacks waiting no more events are followed until some are settled: they are safe
# in the ledger, and neither memory nor disk grows
CALLBACKS_MAX = 50_000
POSITIONS_APART = 10_000  # the position alone is written so seldom: events found again do no harm
RETRY_S, RETRY_S_MAX = 1.0, 60.0  # after a failure of the disk
CLOSE_S = 1.0

Read: TypeAlias = Callable[[int], Iterator[AnyEvent]]  # events behind a position, in order
FleetAt: TypeAlias = Callable[[int], Fleet]  # the state at a position
Hear: TypeAlias = Callable[[Sequence[Callback]], None]  # may be called on any thread

log = structlog.get_logger()


class Outbox:
    """What waits to be delivered. Every method may be called on every thread."""

    def __init__(self, path: Path, hear: Hear, *, callbacks_max: int = CALLBACKS_MAX) -> None:
        """Take the file, and who sends: it hears of every callback that is in the file."""
        self._path = path
        self._hear = hear
        self._callbacks_max = callbacks_max
        self._changed = Condition()  # guards all below that both sides use
        self._queue: deque[AnyEvent] = deque()
        self._newest = 0  # position known to be in the ledger
        self._waiting: dict[int, Callback] = {}
        self._settled: dict[int, Future[None]] = {}  # not yet noted
        self._tried: dict[int, Callback] = {}
        self._stopped = False
        # the rest is the thread's own
        self._thread: Thread | None = None
        self._file: OutboxFile | None = None
        self._read: Read | None = None
        self._fleet_at: FleetAt | None = None
        self._position, self._mark = 0, ""
        self._last_number = 0
        self._telling: Telling | None = None  # None while nobody wants to hear anything
        self._folded = False  # whether the telling is of our position
        self._source: Iterator[AnyEvent] | None = None  # the ledger, read from our position
        self._told_full = False

    def start(self, read: Read, fleet_at: FleetAt, fleet: Fleet) -> None:
        """Open the file, hand over what waits in it, and follow the ledger, whose newest state
        is given.

        A file that is missing or damaged begins at the newest position; one that is ahead of the
        ledger, for that was restored from a backup, goes back to where that ends.
        """
        self._read, self._fleet_at = read, fleet_at
        self._file = self._opened(read, fleet)
        assert self._file.position is not None
        self._position, self._mark = self._file.position, self._file.mark
        if self._position == fleet.position:  # the usual case costs no fold
            self._begin_from(fleet)
        waiting = self._file.waiting()
        self._waiting = {callback.number: callback for callback in waiting}
        self._last_number = max(self._waiting, default=0)
        with self._changed:
            self._newest = max(self._newest, fleet.position)
        if waiting:
            log.info("callbacks wait to be delivered", count=len(waiting))
            self._hear(waiting)
        self._thread = Thread(target=self._run, name="outbox", daemon=True)
        self._thread.start()

    def _opened(self, read: Read, fleet: Fleet) -> OutboxFile:
        file = OutboxFile.open(self._path)
        newest = fleet.position
        if file.position is not None and file.position <= newest:
            if file.mark == _mark_at(read, file.position):
                return file
            file = file.begun_anew("the ledger is another one")
        mark = _mark_at(read, newest)
        if file.position is None:
            if any(scene.callbacks.enabled for scene in fleet.scenes.values()):
                log.warning(
                    "outbox begins at the newest event; callbacks of earlier ones are not sent",
                    path=str(self._path),
                    position=newest,
                )
            file.commit(newest, mark)
        else:
            was = file.position
            gone = file.cut(newest, mark)
            log.error(
                "the ledger ends before the outbox: was a backup restored? "
                "callbacks of events that it lacks are not sent",
                ledger=newest,
                outbox=was,
                callbacks=gone,
            )
        return file

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
            if idle or len(self._queue) >= BATCH_EVENTS:
                self._changed.notify()

    def settle(self, number: int) -> "Future[None]":
        """Forget a callback that was accepted or given up; done once that is on disk."""
        with self._changed:
            noted = self._settled.get(number)
            if noted is None:
                noted = self._settled[number] = Future()
                noted.set_running_or_notify_cancel()  # who waits may go away, the note is made
                self._changed.notify()
            return noted

    def tried(self, callback: Callback) -> None:
        """Note that a try failed, soon: a crash may forget tries, never callbacks."""
        with self._changed:
            if callback.number in self._waiting:
                self._waiting[callback.number] = self._tried[callback.number] = callback

    def waiting(self) -> list[Callback]:
        """Give all that is to be delivered, oldest first."""
        with self._changed:
            return list(self._waiting.values())

    @property
    def count(self) -> int:
        """How many wait."""
        return len(self._waiting)

    @property
    def behind(self) -> int:
        """How many events are not followed yet."""
        return max(0, self._newest - self._position)

    def close(self) -> None:
        """Note what is settled, and end; what is not followed yet comes in at the next start."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(CLOSE_S)

    def _run(self) -> None:
        pause_s = RETRY_S
        while not self._stopped:
            try:
                self._step()
                pause_s = RETRY_S
            except Exception as trouble:  # whatever it was, the ledger holds what is to be told
                if self._stopped:
                    break
                log.exception("outbox falls behind", reason=str(trouble), again_in_s=pause_s)
                self._begin_again()
                with self._changed:
                    self._changed.wait_for(lambda: self._stopped, pause_s)
                pause_s = min(2 * pause_s, RETRY_S_MAX)
        assert self._file is not None
        try:
            if self._folded:
                self._commit((), everything=True)
            self._file.close()
        except Exception as trouble:  # nothing is lost, but some may be sent twice
            log.warning("outbox not closed cleanly", reason=str(trouble))

    def _begin_again(self) -> None:
        """Go back to what is surely in the file."""
        assert self._file is not None
        assert self._file.position is not None
        self._position, self._mark = self._file.position, self._file.mark
        self._telling, self._folded, self._source = None, False, None

    def _begin_from(self, fleet: Fleet) -> None:
        telling = Telling(fleet)
        self._telling = telling if telling.wanted else None
        self._folded = True

    def _step(self) -> None:
        if not self._folded:
            assert self._fleet_at is not None
            self._begin_from(self._fleet_at(self._position) if self._position else Fleet())
        events = self._next()
        fresh: list[Callback] = []
        for event in events:
            fresh.extend(self._take(event))
        self._commit(fresh)

    def _take(self, event: AnyEvent) -> tuple[Callback, ...]:
        setting = event if isinstance(event, CallbacksConfigured) else None
        if self._telling is None and setting is not None and setting.callbacks.enabled:
            assert self._fleet_at is not None
            self._telling = Telling(self._fleet_at(event.position - 1))
        told: tuple[Callback, ...] = ()
        if self._telling is not None:
            told = self._telling.take(event)
            if not self._telling.wanted:
                self._telling = None
        self._position, self._mark = event.position, _mark(event)
        return told

    def _next(self) -> Sequence[AnyEvent]:
        """Wait for something to do; gives the events to take in, none where others are to write."""
        with self._changed:
            self._changed.wait_for(lambda: self._stopped or self._settled or self._has_events())
            self._changed.wait_for(
                lambda: self._stopped or self._settled or len(self._queue) >= BATCH_EVENTS, BATCH_S
            )
            if self._stopped or not self._has_events():
                return ()
            while self._queue and self._queue[0].position <= self._position:
                self._queue.popleft()
            if self._queue and self._queue[0].position == self._position + 1:
                self._source = None
                return [self._queue.popleft() for _ in range(min(BATCH_EVENTS, len(self._queue)))]
        if self._source is None:
            assert self._read is not None
            self._source = self._read(self._position)
        events = list(islice(self._source, BATCH_EVENTS))
        if len(events) < BATCH_EVENTS:
            self._source = None  # it saw what was durable when it began
        return events

    def _has_events(self) -> bool:
        full = len(self._waiting) >= self._callbacks_max
        if full and not self._told_full:
            log.error(
                "too many callbacks wait: no more orders are told of until some are accepted",
                waiting=len(self._waiting),
            )
        self._told_full = full
        return not full and self._newest > self._position

    def _commit(self, fresh: Sequence[Callback], everything: bool = False) -> None:
        assert self._file is not None
        assert self._file.position is not None
        with self._changed:
            settled, tried = dict(self._settled), dict(self._tried)
        moved = self._position - self._file.position
        if not (fresh or settled or moved >= POSITIONS_APART or (everything and (moved or tried))):
            return
        fresh = [
            msgspec.structs.replace(callback, number=number)
            for number, callback in enumerate(fresh, self._last_number + 1)
        ]
        self._file.commit(
            self._position,
            self._mark,
            fresh=fresh,
            settled=settled,
            tried=[callback for number, callback in tried.items() if number not in settled],
        )
        self._last_number += len(fresh)
        with self._changed:
            for callback in fresh:
                self._waiting[callback.number] = callback
            for number in settled:
                self._waiting.pop(number, None)
                del self._settled[number]
            for number, callback in tried.items():
                if self._tried.get(number) is callback:
                    del self._tried[number]
        for noted in settled.values():
            noted.set_result(None)
        if fresh:
            self._hear(fresh)


def _mark(event: AnyEvent) -> str:
    """Tell this event from another one with its position, in another ledger."""
    return f"{event.at_ms}/{event.command}"


def _mark_at(read: Read, position: int) -> str:
    event = next(read(position - 1), None) if position else None
    return "" if event is None else _mark(event)
