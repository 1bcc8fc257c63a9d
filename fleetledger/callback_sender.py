"""Sends what waits in the outbox: in order for each order and address, again until accepted.

On a thread of its own: to prepare one request takes httpx about a millisecond, and to look a name
up may take seconds, which nobody who waits for the server's answers shall notice.
"""

import asyncio
import heapq
import threading
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import Future
from random import Random
from typing import Protocol
from urllib.parse import urlsplit

import msgspec
import structlog
from prometheus_client import Counter

from fleetledger.callback_post import NoSecret
from ledger.errors import LedgerError
from ledger.ids import OrderId
from projections.callbacks import Callback

SENDING_MAX = 8  # at once to one address; more orders wait their turn
RETRY_S_MAX = 60.0
DOUBLINGS_MAX = 16  # more do not change the delay, but numbers would overflow
HOLD_S = 1.0  # until it is tried again what was none of the receiver's fault
ERROR_CHARS_MAX = 200
STOP_S = 1.0  # for tries under way
JOIN_S = 1.0  # more; a name that is being looked up holds the thread, and is left behind

SENT = Counter("fleetledger_callbacks_sent", "Callbacks that were accepted")
FAILED = Counter("fleetledger_callbacks_failed", "Tries to send a callback that failed")
GIVEN_UP = Counter("fleetledger_callbacks_given_up", "Callbacks that were never accepted")

log = structlog.get_logger()


class Sends(Protocol):
    """One try; `fleetledger.callback_post.Post`, but for tests."""

    async def send(self, callback: Callback) -> str | None:
        """Send once. None = accepted; else what went wrong. Raises NoSecret."""

    async def close(self) -> None:
        """Let all connections go."""


class Notes(Protocol):
    """The outbox, as far as it is needed here."""

    def settle(self, number: int) -> "Future[None]":
        """Forget a callback; done once that is on disk."""

    def tried(self, callback: Callback) -> None:
        """Note that a try failed."""


class Address:
    """What one URL is to get: a lane for each order, of which only the first callback is tried."""

    def __init__(self) -> None:
        self.lanes: dict[OrderId, deque[Callback]] = {}
        self.ready: deque[OrderId] = deque()  # to be tried now
        self.later: list[tuple[float, int, OrderId]] = []  # a heap: due at, number, whose
        self.sending = 0
        self.timer: asyncio.TimerHandle | None = None

    def add(self, callback: Callback) -> None:
        """Put a callback behind the others of its order."""
        lane = self.lanes.get(callback.order)
        if lane is None:
            lane = self.lanes[callback.order] = deque()
            self.ready.append(callback.order)
        lane.append(callback)

    def put_off(self, order: OrderId, due_s: float) -> None:
        """Try this order's callback again, not before an instant."""
        heapq.heappush(self.later, (due_s, self.lanes[order][0].number, order))

    def settled(self, order: OrderId) -> None:
        """Go on with the next callback of the order."""
        lane = self.lanes[order]
        lane.popleft()
        if lane:
            self.ready.append(order)
        else:
            del self.lanes[order]

    def next(self, now_s: float) -> OrderId | None:
        """Give an order whose callback is to be tried now, those that waited longest first."""
        while self.later and self.later[0][0] <= now_s:
            self.ready.append(heapq.heappop(self.later)[2])
        return self.ready.popleft() if self.ready else None


class Sender:
    """The thread that sends. `hear` may be called from any thread once it is started."""

    def __init__(
        self,
        connect: Callable[[], Sends],
        give_up: Callable[[Callback], None],
        wanted: Callable[[Callback], bool],
        random: Random,
    ) -> None:
        """Take how to make the client, how to record that a callback is given up (it may wait for
        the disk), whether its address is still in the settings (else a try that fails is the last
        one: so operators end the wait for a receiver that is gone), and chance, by which retries
        do not come all at once."""
        self._connect = connect
        self._give_up = give_up
        self._wanted = wanted
        self._random = random
        self._outbox: Notes | None = None
        self._addresses: dict[str, Address] = {}
        self._tries: set[asyncio.Task[None]] = set()
        self._up = threading.Event()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="callbacks", daemon=True)

    def start(self, outbox: Notes) -> None:
        """Begin; the outbox hears what became of the callbacks that it hands over."""
        self._outbox = outbox
        self._thread.start()
        self._up.wait()

    def hear(self, callbacks: Sequence[Callback]) -> None:
        """Take callbacks that are in the outbox, in order."""
        if not self._stopping:
            self._loop.call_soon_threadsafe(self._take, callbacks)

    def ask_to_stop(self) -> None:
        """Begin nothing more, and end soon; returns at once."""
        begun = self._thread.is_alive() and not self._stopping
        self._stopping = True
        if begun:
            self._loop.call_soon_threadsafe(self._stop.set)

    def join(self) -> None:
        """Wait for the end after `ask_to_stop`: at most two seconds."""
        if self._thread.is_alive():
            self._thread.join(STOP_S + JOIN_S)

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        finally:
            self._up.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._stop = asyncio.Event()
        self._post = self._connect()
        self._up.set()
        await self._stop.wait()
        if self._tries:
            await asyncio.wait(self._tries, timeout=STOP_S)
        for task in tuple(self._tries):
            task.cancel()
        await asyncio.gather(*self._tries, return_exceptions=True)
        await self._post.close()

    def _take(self, callbacks: Sequence[Callback]) -> None:
        touched: dict[str, Address] = {}
        for callback in callbacks:
            address = self._addresses.get(callback.url)
            if address is None:
                address = self._addresses[callback.url] = Address()
            address.add(callback)
            touched[callback.url] = address
        for url, address in touched.items():
            self._pump(url, address)

    def _pump(self, url: str, address: Address) -> None:
        """Begin what can be begun, and come again when something is due."""
        if self._stopping:
            return
        if address.timer is not None:
            address.timer.cancel()
            address.timer = None
        while address.sending < SENDING_MAX:
            order = address.next(self._loop.time())
            if order is None:
                break
            address.sending += 1
            task = self._loop.create_task(self._try(url, address, order))
            self._tries.add(task)
            task.add_done_callback(self._tries.discard)
        if not address.lanes:
            self._addresses.pop(url, None)
        elif address.later and address.sending < SENDING_MAX:
            address.timer = self._loop.call_at(address.later[0][0], self._pump, url, address)

    async def _try(self, url: str, address: Address, order: OrderId) -> None:
        callback = address.lanes[order][0]
        try:
            await self._deliver(address, callback)
        except LedgerError as trouble:  # to give it up is to append, and the ledger takes nothing
            log.warning("callback held up", order=order, host=host_of(url), reason=str(trouble))
            address.put_off(order, self._loop.time() + RETRY_S_MAX)
        except Exception as trouble:  # whatever it was, the callback stays, and others go on
            log.exception("callback held up", order=order, host=host_of(url), reason=str(trouble))
            address.put_off(order, self._loop.time() + HOLD_S)
        finally:
            address.sending -= 1
            self._pump(url, address)

    async def _deliver(self, address: Address, callback: Callback) -> None:
        """The next one of the order goes only when it is on disk that this one is settled."""
        assert self._outbox is not None
        try:
            error = await self._post.send(callback)
        except NoSecret as trouble:
            self._again(address, callback, str(trouble), HOLD_S)  # no try of the receiver's
            return
        if error is None:
            SENT.inc()
            log.debug("callback accepted", order=callback.order, status=callback.status.value)
        else:
            FAILED.inc()
            failed = _failed(callback, error)
            log.debug("callback failed", order=callback.order, reason=error, tries=failed.tries)
            if failed.tries <= failed.retries_max and self._wanted(failed):
                self._again(address, failed, failed.error, self._delay_s(failed))
                return
            await asyncio.to_thread(self._give_up, failed)
            GIVEN_UP.inc()
            log.warning(
                "callback given up",
                order=callback.order,
                status=callback.status.value,
                host=host_of(callback.url),
                tries=failed.tries,
                reason=failed.error,
            )
        await _on_disk(self._outbox.settle(callback.number))
        address.settled(callback.order)

    def _again(self, address: Address, callback: Callback, error: str, delay_s: float) -> None:
        assert self._outbox is not None
        callback = msgspec.structs.replace(callback, error=error)
        address.lanes[callback.order][0] = callback
        self._outbox.tried(callback)
        address.put_off(callback.order, self._loop.time() + delay_s)

    def _delay_s(self, callback: Callback) -> float:
        """Doubles with each try up to a minute; up to half of it less, by chance."""
        doubled = callback.retry_s * (1 << min(callback.tries - 1, DOUBLINGS_MAX))
        return min(doubled, RETRY_S_MAX) * self._random.uniform(0.5, 1.0)


def host_of(url: str) -> str:
    """What of an address may be logged: the rest of it may hold tokens."""
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


def _failed(callback: Callback, error: str) -> Callback:
    return msgspec.structs.replace(
        callback, tries=callback.tries + 1, error=error[:ERROR_CHARS_MAX]
    )


def _on_disk(noted: "Future[None]") -> Awaitable[None]:
    return asyncio.wrap_future(noted)
