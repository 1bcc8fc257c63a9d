"""The ledger over the bus: the core serves it, other processes follow without a gap.

A follower subscribes first and buffers, then asks for the state; what it already has is dropped by
position, and on any gap it asks. So neither a lost message nor a late start shows.
"""

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice

import msgspec

from ledger.bus import EVENTS_AFTER_KEY, EVENTS_KEY, STATE_KEY, Bus
from ledger.errors import LedgerError
from ledger.events import AnyEvent
from ledger.scene import Value
from ledger.state import Fleet
from ledger.store import Ledger

ANSWER_EVENTS = 100  # in one message of an answer (measured: 1.8 M events/s; 1000 are slower)
ANSWERS_MAX = 100  # messages in one answer; who is further behind asks again
DURABLE_WAIT_S = 5.0
ASK_TIMEOUT_S = 5.0
RETRY_S = 0.5  # how long a waiting follower trusts the live stream before it asks

_encode = msgspec.json.Encoder().encode
_events = msgspec.json.Decoder(list[AnyEvent])


class EventsAfter(Value, frozen=True, kw_only=True):
    """The question under EVENTS_AFTER_KEY."""

    after: int


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
        ledger.listen(self._publish)
        bus.respond(EVENTS_AFTER_KEY, self._answer_events)
        bus.respond(STATE_KEY, self._answer_state)

    def _publish(self, events: Sequence[AnyEvent]) -> None:
        self._bus.publish(EVENTS_KEY, _encode(list(events)))

    def _answer_events(self, question: bytes) -> Iterator[bytes]:
        """Answer in batches; at least one, for an empty answer looks like none."""
        after = msgspec.json.decode(question, type=EventsAfter).after
        events = self._ledger.read(after)
        for number in range(ANSWERS_MAX):
            batch = list(islice(events, ANSWER_EVENTS))
            if batch or not number:
                yield _encode(batch)
            if len(batch) < ANSWER_EVENTS:
                return

    def _answer_state(self, question: bytes) -> Iterable[bytes]:
        fleet = self._fleet()
        if not self._ledger.wait(fleet.position, DURABLE_WAIT_S):
            return []  # the disk hangs: better no answer than one that may not survive
        return [_encode(fleet)]


class FeedFollower:
    """Keeps up with the core. Call its methods from one thread, never from a handler of the bus."""

    def __init__(self, bus: Bus) -> None:
        """Nothing happens before `start`."""
        self._bus = bus
        self._arrived = threading.Condition()
        self._messages: deque[bytes] = deque()  # as received
        self._ready: deque[AnyEvent] = deque()  # in order, not yet drained
        self.position = 0  # of the newest event in `ready` or drained

    def start(self) -> Fleet:
        """Begin to follow: gives the state, which the events of `drain` continue.

        Raises TimeoutError while there is no core.
        """
        self._bus.subscribe(EVENTS_KEY, self._receive)
        answers = self._bus.ask(STATE_KEY, timeout_s=ASK_TIMEOUT_S)
        if not answers:
            raise TimeoutError("the core has no durable state to show yet")
        fleet = msgspec.json.decode(answers[0], type=Fleet)
        self.position = fleet.position
        return fleet

    def _receive(self, key: str, payload: bytes) -> None:
        with self._arrived:
            self._messages.append(payload)
            self._arrived.notify_all()

    def drain(self) -> list[AnyEvent]:
        """Everything that has become known since the last call, in order and without a gap."""
        self._take_in()
        events = list(self._ready)
        self._ready.clear()
        return events

    def wait(self, position: int, timeout_s: float) -> bool:
        """Wait until `drain` reaches a position, asking for it if it does not come by itself."""
        left_s = timeout_s
        while True:
            self._take_in()
            if self.position >= position:
                return True
            if left_s <= 0:
                return False
            pause_s = min(RETRY_S, left_s)
            with self._arrived:
                came = self._arrived.wait_for(lambda: bool(self._messages), pause_s)
            if not came:
                left_s -= pause_s
                self.catch_up()

    def catch_up(self) -> None:
        """Ask for what may have been missed without a later message to show it."""
        while self._ask() > 0:
            pass

    def _take_in(self) -> None:
        """Sort what has arrived into `ready`; asks where positions are missing before it."""
        while True:
            with self._arrived:
                if not self._messages:
                    return
                payload = self._messages.popleft()
            events = _events.decode(payload)
            while events and events[0].position > self.position + 1:
                if not self._ask():
                    raise LedgerError(
                        f"the core has events at {events[0].position}, "
                        f"but gives none after {self.position}"
                    )
            self._add(events)

    def _add(self, events: Sequence[AnyEvent]) -> int:
        """Add those that come next and drop those that are known; gives how many were new."""
        before = self.position
        for event in events:
            if event.position == self.position + 1:
                self._ready.append(event)
                self.position = event.position
        return self.position - before

    def _ask(self) -> int:
        question = _encode(EventsAfter(after=self.position))
        answers = self._bus.ask(EVENTS_AFTER_KEY, question, timeout_s=ASK_TIMEOUT_S)
        batches = sorted(
            (b for b in map(_events.decode, answers) if b), key=lambda b: b[0].position
        )
        return sum(self._add(batch) for batch in batches)
