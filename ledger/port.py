"""What the rest of the program knows of the ledger, and the one in memory that tests run on."""

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from ledger.errors import Conflict, LedgerError
from ledger.events import AnyEvent

AT_MS_MAX = (2**63 - 1) // 1_000_000  # log times are nanoseconds

Listener = Callable[[Sequence[AnyEvent]], None]


class Ledger(Protocol):
    """What the rest of the program knows of the ledger. Append from one thread, read from any."""

    @property
    def position(self) -> int:
        """Newest appended, perhaps not yet on disk."""

    @property
    def durable(self) -> int:
        """Newest on disk."""

    def append(self, events: Sequence[AnyEvent], expected: int) -> int:
        """Queue the events of one command, stamped expected+1 …; they are kept or lost together.

        Gives the new position. Raises Conflict where somebody appended meanwhile, LedgerBusy where
        too much waits for the disk, Unknown after a failure and ever after.
        """

    def listen(self, listener: Listener) -> None:
        """Call with the events of each commit once they are on disk, in order, committer thread."""

    def on_failure(self, report: Callable[[LedgerError], None]) -> None:
        """Call once, committer thread, when the ledger has stopped accepting."""

    def read(self, after: int, until: int | None = None) -> Iterator[AnyEvent]:
        """Events on disk with after < position ≤ until, newest durable one if None."""

    def wait(self, position: int, timeout_s: float) -> bool:
        """Wait until on disk and heard by all listeners; Unknown where that will never be."""

    def close(self) -> None:
        """Put on disk what is queued, and finish."""


def check_stamps(events: Sequence[AnyEvent], expected: int) -> int:
    """Refuse events that are not stamped densely from expected+1; ValueError, for it is our bug."""
    position = expected
    for event in events:
        position += 1
        if event.position != position or not 0 <= event.at_ms <= AT_MS_MAX:
            name = type(event).__name__
            raise ValueError(
                f"{name} due at {position} is stamped {event.position}, at_ms {event.at_ms}"
            )
    return position


class MemoryLedger:
    """The ledger without a disk: all is durable at once, and heard in the caller's thread."""

    def __init__(self, events: Sequence[AnyEvent] = ()) -> None:
        """Begin with events that have happened before."""
        check_stamps(events, 0)
        self._events: list[AnyEvent] = list(events)
        self._listeners: list[Listener] = []

    @property
    def position(self) -> int:
        """Newest appended."""
        return len(self._events)

    @property
    def durable(self) -> int:
        """The same: nothing is ever under way."""
        return len(self._events)

    def append(self, events: Sequence[AnyEvent], expected: int) -> int:
        """Keep the events and tell the listeners before returning."""
        check_stamps(events, expected)
        if expected != len(self._events):
            raise Conflict(expected, len(self._events))
        self._events += events
        if events:
            for listener in self._listeners:
                listener(events)
        return len(self._events)

    def listen(self, listener: Listener) -> None:
        """Hear of every append from now on."""
        self._listeners.append(listener)

    def on_failure(self, report: Callable[[LedgerError], None]) -> None:
        """Nothing can fail here."""

    def read(self, after: int, until: int | None = None) -> Iterator[AnyEvent]:
        """Events with after < position ≤ until."""
        return iter(self._events[after:until])

    def wait(self, position: int, timeout_s: float) -> bool:
        """Nothing to wait for."""
        return position <= len(self._events)

    def close(self) -> None:
        """Nothing to finish."""
