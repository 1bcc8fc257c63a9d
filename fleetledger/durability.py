"""From the committer's thread to the event loop: what is on disk becomes visible, then known."""

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Sequence

from ledger.errors import LedgerError
from ledger.events import AnyEvent


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
        self._lock = threading.Lock()
        self._commits: deque[Sequence[AnyEvent]] = deque()
        self._woken = False
        self._waiters: deque[tuple[int, asyncio.Future[None]]] = deque()  # by position
        self._failure: LedgerError | None = None

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
            waiter = self._waiters.popleft()[1]
            if not waiter.done():  # its client may have gone
                waiter.set_result(None)

    def _fail(self, failure: LedgerError) -> None:
        self._failure = failure
        for _, waiter in self._waiters:
            if not waiter.done():
                waiter.set_exception(failure)
        self._waiters.clear()

    async def reached(self, position: int) -> None:
        """Wait until this position, which the ledger has given out, is on disk and visible."""
        if position <= self.position:
            return
        if self._failure is not None:
            raise self._failure
        waiter: asyncio.Future[None] = self._loop.create_future()
        self._waiters.append((position, waiter))  # positions are given out in rising order
        await waiter

    @property
    def idle(self) -> bool:
        """Tell that nobody waits for the disk."""
        return not self._waiters
