"""Events as they happen, for whoever follows over HTTP: server-sent events, resumed by position.

A follower gets every event once and in order. It is read for only as fast as it takes what it is
sent: one that does not read holds what is on its way to it, and is let go after a while.
"""

import asyncio
from collections.abc import AsyncIterator, Callable

import msgspec
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from ledger.errors import Refused
from replay.source import Source

FOLLOWERS_MAX = 64
BATCH_EVENTS_MAX = 2_000  # read at once for one follower: some 1 MB
PACE_S = 0.05  # between two reads for one who keeps up: under load they are shared by many events
STALL_S_MAX = 30.0  # who takes longer for what it is sent is let go
ABORT = "fleetledger.abort"  # extension of the front door: closes a connection without waiting

_HEADERS = (
    (b"content-type", b"text/event-stream; charset=utf-8"),
    (b"cache-control", b"no-store"),
    (b"x-accel-buffering", b"no"),
)


class TooManyFollowers(Refused):
    """Each stream holds a connection and reads files; others wait their turn."""

    status = 503

    def __init__(self) -> None:
        """Say so."""
        words = f"{FOLLOWERS_MAX} streams are open already: close one, or read without a stream."
        super().__init__("errTooManyFollowers", words, FOLLOWERS_MAX)


class AheadOfLedger(Refused):
    """A follower has events that this ledger has not: others in their place would mix up."""

    status = 409

    def __init__(self, after: int, newest: int) -> None:
        """Take the position that was asked for, and the newest one there is."""
        words = (
            f"Position {after} is not in this ledger, which ends at {newest}: it was restored from "
            "a backup, or is another one. Throw away what you followed, and begin anew."
        )
        super().__init__("errAheadOfLedger", words, after, newest)


class Followers:
    """Those who follow now."""

    def __init__(self, source: Source, stall_s: float = STALL_S_MAX) -> None:
        """Take what is followed, and for how long a stalled one is waited for."""
        self._source = source
        self._stall_s = stall_s
        self.count = 0

    def follow(self, after: int) -> Response:
        """Answer a stream of the events behind a position."""
        if self.count >= FOLLOWERS_MAX:
            raise TooManyFollowers
        newest = self._source.live().position
        if after > newest:
            raise AheadOfLedger(after, newest)
        return Following(self, after, self._stall_s)

    async def texts(self, after: int) -> AsyncIterator[bytes]:
        """Give what is sent, piece by piece, for ever."""
        while True:
            newest = self._source.live().position
            text, last = await asyncio.to_thread(self._some, after, newest)
            if last > after:
                full = last < newest
                after = last
                yield text
                if not full:
                    await asyncio.sleep(PACE_S)
            elif not await self._source.comes(after + 1):
                yield b": nothing new\n\n"  # shows that the connection stands

    def _some(self, after: int, until: int) -> tuple[bytes, int]:
        """Read and write out events; gives the newest position among them too."""
        if after >= until:
            return b"", after
        events = list(self._source.read(after, min(until, after + BATCH_EVENTS_MAX)))
        lines = [
            b"id: %d\nevent: %s\ndata: %s\n\n"
            % (event.position, type(event).__name__.encode(), msgspec.json.encode(event))
            for event in events
        ]
        return b"".join(lines), events[-1].position


class Following(Response):
    """The answer to one follower; ends when it leaves, stalls, or the server stops."""

    def __init__(self, followers: Followers, after: int, stall_s: float) -> None:
        super().__init__()
        self._followers = followers
        self._after = after
        self._stall_s = stall_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until it ends."""
        self._followers.count += 1
        extension = scope.get("extensions", {}).get(ABORT, {})
        abort = extension.get("call", lambda: None)
        sending = asyncio.create_task(self._send(send, abort))
        leaving = asyncio.create_task(_left(receive))
        try:
            await asyncio.wait({sending, leaving}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            sending.cancel()
            leaving.cancel()
            ended = await asyncio.gather(sending, leaving, return_exceptions=True)
            self._followers.count -= 1
        for trouble in ended:
            if isinstance(trouble, Exception):
                raise trouble

    async def _send(self, send: Send, abort: Callable[[], None]) -> None:
        headers = list(_HEADERS)
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        async for text in self._followers.texts(self._after):
            try:
                async with asyncio.timeout(self._stall_s):
                    await send({"type": "http.response.body", "body": text, "more_body": True})
            except TimeoutError:
                abort()
                return


async def _left(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
