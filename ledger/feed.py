"""The ledger over the bus: the core serves it, other processes follow without a gap.

Messages may be lost, doubled, late or out of order, and either side may stall or start anew: each
message names the event behind which it stands, so a follower drops what it has, asks for what it
lacks, and notices a core whose history is not the one that it followed (a restored backup).
"""

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice

import msgspec

from ledger.bus import EVENTS_AFTER_KEY, EVENTS_KEY, STATE_KEY, Bus
from ledger.errors import LedgerDiverged
from ledger.events import AnyEvent
from ledger.ids import CommandId
from ledger.scene import Value
from ledger.state import Fleet
from ledger.store import Ledger

ANSWER_EVENTS = 100  # in one message of an answer (measured: 1.8 M events/s; 1000 are slower)
ANSWERS_MAX = 100  # messages in one answer; who is further behind asks again
DURABLE_WAIT_S = 5.0
ASK_TIMEOUT_S = 5.0
RETRY_S = 0.5  # how long a waiting follower trusts the live stream before it asks
BEAT_S = 1.0  # between two messages that say only where the ledger is
BUFFER_BYTES_MAX = 16 * 1024 * 1024  # received and not taken in; beyond, it is asked for again
READY_EVENTS_MAX = 20_000  # of one `drain`, or a few more: who is far behind catches up in parts


class Mark(Value, frozen=True, kw_only=True):
    """Which event stands at a position. Commands have ids of chance, so no two histories agree."""

    position: int = 0
    at_ms: int = 0
    command: CommandId | None = None  # None = not known

    def is_same(self, other: "Mark") -> bool:
        """Tell whether both are of one history, for all that is known."""
        known = self.command is not None and other.command is not None
        return (
            self.position == other.position
            and self.at_ms == other.at_ms
            and (not known or self.command == other.command)
        )


class Told(Value, frozen=True, kw_only=True):
    """Every message of the feed: events, perhaps none, and the one that they stand behind."""

    behind: Mark
    events: list[AnyEvent]


class EventsAfter(Value, frozen=True, kw_only=True):
    """The question under EVENTS_AFTER_KEY; answered by messages, the first behind `after`.

    Where the ledger ends before that position, the answer is without events, behind the newest.
    """

    after: int


_encode = msgspec.json.Encoder().encode
_told = msgspec.json.Decoder(Told)


def mark_of(event: AnyEvent) -> Mark:
    """Mark an event."""
    return Mark(position=event.position, at_ms=event.at_ms, command=event.command)


class FeedServer:
    """Publishes what is on disk and answers those who have missed something.

    `fleet` is called on a foreign thread and must hand over a copy of one moment; where that is
    ahead of the disk, the answer waits for the disk.
    """

    def __init__(self, bus: Bus, ledger: Ledger, fleet: Callable[[], Fleet]) -> None:
        """Serve from now on, for as long as bus and ledger live."""
        self._bus = bus
        self._ledger = ledger
        self._fleet = fleet
        self._newest: Mark | None = None  # published; None = nothing yet
        self._publishing = threading.Lock()  # messages leave in the order of positions
        ledger.listen(self._publish)
        bus.respond(EVENTS_AFTER_KEY, self._answer_events)
        bus.respond(STATE_KEY, self._answer_state)

    def _publish(self, events: Sequence[AnyEvent]) -> None:
        with self._publishing:
            behind = self._newest or self._mark_at(events[0].position - 1)
            self._newest = mark_of(events[-1])
            self._bus.publish(EVENTS_KEY, _encode(Told(behind=behind, events=list(events))))

    def beat(self) -> None:
        """Say where the ledger is, for whoever lost the last message; call it every BEAT_S."""
        with self._publishing:
            newest = self._newest or self._mark_at(self._ledger.durable)
            self._bus.publish(EVENTS_KEY, _encode(Told(behind=newest, events=[])))

    def _mark_at(self, position: int) -> Mark:
        event = next(self._ledger.read(position - 1, position), None) if position else None
        return Mark() if event is None else mark_of(event)

    def _answer_events(self, question: bytes) -> Iterator[bytes]:
        """Answer in batches; at least one, for an empty answer looks like none."""
        after = msgspec.json.decode(question, type=EventsAfter).after
        newest = self._ledger.durable
        behind = self._mark_at(min(after, newest))
        events = self._ledger.read(after, newest) if after < newest else iter(())
        for number in range(ANSWERS_MAX):
            batch = list(islice(events, ANSWER_EVENTS))
            if batch or not number:
                yield _encode(Told(behind=behind, events=batch))
            if len(batch) < ANSWER_EVENTS:
                return
            behind = mark_of(batch[-1])

    def _answer_state(self, question: bytes) -> Iterable[bytes]:
        fleet = self._fleet()
        if not self._ledger.wait(fleet.position, DURABLE_WAIT_S):
            return []  # the disk hangs: better no answer than one that may not survive
        return [_encode(fleet)]


class FeedFollower:
    """Keeps up with the core. Call its methods from one thread, never from a handler of the bus.

    Whatever asks raises TimeoutError while there is no core, and may be called again; and
    LedgerDiverged where the core's history is another one: then begin anew.
    """

    def __init__(self, bus: Bus, *, buffer_bytes: int = BUFFER_BYTES_MAX) -> None:
        """Nothing happens before `start` or `start_behind`."""
        self._bus = bus
        self._buffer_bytes = buffer_bytes
        self._arrived = threading.Condition()
        self._messages: deque[bytes] = deque()  # as received
        self._bytes = 0  # of them
        self._ready: deque[AnyEvent] = deque()  # in order, not yet drained
        self.newest = Mark()  # the newest event in `ready` or drained

    @property
    def position(self) -> int:
        """Newest position that is ready, or has been drained."""
        return self.newest.position

    def start(self) -> Fleet:
        """Begin to follow: gives the state, which the events of `drain` continue."""
        self._bus.subscribe(EVENTS_KEY, self._receive)
        answers = self._bus.ask(STATE_KEY, timeout_s=ASK_TIMEOUT_S)
        if not answers:
            raise TimeoutError("the core has no durable state to show yet")
        fleet = msgspec.json.decode(answers[0], type=Fleet)
        self.newest = Mark(position=fleet.position, at_ms=fleet.at_ms)
        return fleet

    def start_behind(self, newest: Mark) -> None:
        """Begin to follow behind an event that is known, or from the first one: `Mark()`.

        The mark is a whole one, as `newest` gives it: it tells this history from another.
        """
        self.newest = newest
        self._bus.subscribe(EVENTS_KEY, self._receive)
        self._ask()

    def _receive(self, key: str, payload: bytes) -> None:
        with self._arrived:
            if self._bytes + len(payload) > self._buffer_bytes:
                self._messages.clear()  # the newest one will show the gap
                self._bytes = 0
            self._messages.append(payload)
            self._bytes += len(payload)
            self._arrived.notify_all()

    def drain(self) -> list[AnyEvent]:
        """What has become known since the last call, in order and without a gap.

        Who is far behind gets a part; the next call gives the next one.
        """
        self._take_in(READY_EVENTS_MAX)
        events = list(self._ready)
        self._ready.clear()
        return events

    def wait(self, position: int, timeout_s: float) -> bool:
        """Wait until `drain` reaches a position, asking for it if it does not come by itself."""
        left_s = timeout_s
        while True:
            self._take_in(None)
            if self.position >= position:
                return True
            if left_s <= 0:
                return False
            pause_s = min(RETRY_S, left_s)
            with self._arrived:
                came = self._arrived.wait_for(lambda: bool(self._messages), pause_s)
            if not came:
                left_s -= pause_s
                while self.position < position and self._ask() > 0:
                    pass

    def catch_up(self) -> None:
        """Ask for what may have been missed without a later message to show it."""
        while len(self._ready) < READY_EVENTS_MAX and self._ask() > 0:
            pass

    def _take_in(self, events_max: int | None) -> None:
        """Sort what has arrived into `ready`; asks where positions are missing before it."""
        sure = False  # that the core has our history
        while events_max is None or len(self._ready) < events_max:
            with self._arrived:
                if not self._messages:
                    return
                payload = self._messages.popleft()
                self._bytes -= len(payload)
            told = _told.decode(payload)
            if told.behind.position > self.position:
                with self._arrived:  # for when the gap before it is filled
                    self._messages.appendleft(payload)
                    self._bytes += len(payload)
                self._fill(told)
                sure = True
            elif not self._join(told) and not sure:
                self._ask()  # it came late; or the core has lost what we have
                sure = True

    def _fill(self, told: Told) -> None:
        """Ask for events before those that have come."""
        if not self._ask():  # it has lost what it had published
            raise LedgerDiverged(told.behind.position, self.position)

    def _join(self, told: Told) -> bool:
        """Add the events that come next; False where the message ends before what is known.

        Where it overlaps, both must say the same.
        """
        newest = told.behind if not told.events else mark_of(told.events[-1])
        if newest.position < self.position:
            return False
        if told.behind.position == self.position:
            self._check(told.behind)
        for event in told.events:
            if event.position == self.position:
                self._check(mark_of(event))
            elif event.position == self.position + 1:
                self._ready.append(event)
                self.newest = mark_of(event)
        return True

    def _check(self, theirs: Mark) -> None:
        if not self.newest.is_same(theirs):
            raise LedgerDiverged(self.newest.position, theirs.position)
        self.newest = theirs

    def _ask(self) -> int:
        """Ask for what comes next; gives how many events did."""
        before = self.position
        question = _encode(EventsAfter(after=before))
        answers = self._bus.ask(EVENTS_AFTER_KEY, question, timeout_s=ASK_TIMEOUT_S)
        told = sorted(map(_told.decode, answers), key=lambda part: part.behind.position)
        if told[0].behind.position > before:
            raise TimeoutError("the first part of the core's answer was lost")
        self._check(told[0].behind)
        for part in told:
            self._join(part)
        return self.position - before
