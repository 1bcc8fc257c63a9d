"""From the committer's thread to the event loop: what is on disk becomes visible, then known."""

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

from ledger.errors import LedgerError
from ledger.events import AnyEvent

Then: TypeAlias = Callable[[LedgerError | None], None]  # told of the failure, None = it is on disk


class Durability:
    """Applies each commit on the event loop, in order, and wakes those who wait for it.

    Queries see a commit before its own command is acknowledged: read your writes.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        position: int,
        apply: Callable[[Sequence[AnyEvent]], None],
    ) -> None:
        """Take the position on disk now and what to do with each commit."""
        self.position = position
        self._loop = loop
        self._apply = apply
        self._thread = threading.get_ident()  # the loop's, where this is made
        self._lock = threading.Lock()
        self._commits: deque[Sequence[AnyEvent]] = deque()
        self._woken = False
        self._waiters: deque[tuple[int, Then]] = deque()  # by position
        self._failure: LedgerError | None = None

    def gather(self, wake: Callable[[], None]) -> None:
        """Wake the committer once all calls that have come by now are decided.

        Woken by the first of them it took the interpreter's lock from the others, and synced a few
        at a time: a third more commits, a tenth more of a core an order (measured).
        """
        if threading.get_ident() == self._thread:
            self._loop.call_soon(wake)
        else:
            wake()

    def heard(self, events: Sequence[AnyEvent]) -> None:
        """Take a commit from the committer's thread; one wake-up serves many commits."""
        with self._lock:
            self._commits.append(events)
            wake, self._woken = not self._woken, True
        if wake:
            self._loop.call_soon_threadsafe(self._drain)

    def failed(self, failure: LedgerError) -> None:
        """Take bad news from the committer's thread: nothing more will reach the disk."""
        self._loop.call_soon_threadsafe(self._fail, failure)

    def _drain(self) -> None:
        with self._lock:
            commits, self._commits = self._commits, deque()
            self._woken = False
        for events in commits:
            self._apply(events)
            self.position = events[-1].position
        while self._waiters and self._waiters[0][0] <= self.position:
            self._waiters.popleft()[1](None)

    def _fail(self, failure: LedgerError) -> None:
        self._failure = failure
        waiters, self._waiters = self._waiters, deque()
        for _, then in waiters:
            then(failure)

    async def reached(self, position: int) -> None:
        """Wait until this position, which the ledger has given out, is on disk and visible."""
        if position <= self.position:
            return
        waiter: asyncio.Future[None] = self._loop.create_future()
        self.when(position, partial(_wake, waiter))
        await waiter

    def when(self, position: int, then: Then) -> None:
        """Call once this position is on disk and visible, or never will be; maybe at once."""
        if position <= self.position:
            then(None)
        elif self._failure is not None:
            then(self._failure)
        else:
            self._waiters.append((position, then))  # positions are given out in rising order

    @property
    def idle(self) -> bool:
        """Tell that nobody waits for the disk."""
        return not self._waiters


def _wake(waiter: "asyncio.Future[None]", failure: LedgerError | None) -> None:
    if waiter.done():  # its client may have gone
        return
    if failure is None:
        waiter.set_result(None)
    else:
        waiter.set_exception(failure)
