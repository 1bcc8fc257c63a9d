"""The RDSCore dialect: `GET /robotsStatus`, and the same pushed ten times a second by WebSocket.

Both are one application; the front door serves it on two ports, as the vendor's are 8088 and 8089.
A tick is encoded once for all clients, and only while there are any. It must not be compressed for
each client either: serve it with uvicorn's `ws_per_message_deflate=False`.
"""

import asyncio
from collections.abc import Awaitable, Callable

import msgspec
import structlog
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from ledger.errors import Refused
from ledger.moment import parse_time
from projections.api.rdscore_filter import selected, tree
from projections.api.rdscore_status import DEVICES, Past, Status, envelope, parsed
from projections.live import Live

TICK_S = 0.1
CLIENTS_MAX = 100
SEND_S_MAX = 30.0  # a client that takes longer for one frame is let go
TRY_AGAIN_LATER = 1013

UNSUPPORTED_DEVICE = 50002
REJECTED = 50001

log = structlog.get_logger()


def app(
    live: Live,
    now_ms: Callable[[], int],
    tick_s: float = TICK_S,
    past: Callable[[int], Awaitable[Past]] | None = None,
) -> Starlette:
    """Give the application; `tick_s` is the pace of the WebSocket in seconds of the wall.

    With `past`, `asOf` asks for a past moment, as in the M4 dialect; the vendor has nothing alike.
    """
    status, since_ms = Status(live, now_ms()), now_ms()
    push = Push(lambda: status.encoded(now_ms()), tick_s)

    async def robots_status(request: Request) -> Response:
        try:
            at_ms = _as_of(request)
            if at_ms is None or past is None:
                return _json(_answer(status, request, now_ms()), 200)
            then = Status(await past(at_ms), min(since_ms, at_ms))
            return _json(_answer(then, request, at_ms), 200)
        except Refused as trouble:
            code = int(trouble.code) if trouble.code.isdecimal() else REJECTED
            body = envelope(code, trouble.message, now_ms())
            return _json(msgspec.json.encode(body, order="sorted"), 400)

    async def pushed(socket: WebSocket) -> None:
        await push.serve(socket)

    return Starlette(
        routes=[Route("/robotsStatus", robots_status), WebSocketRoute("/robotsStatus", pushed)]
    )


def _as_of(request: Request) -> int | None:
    asked = request.query_params.get("asOf") or request.headers.get("asOf")
    return None if asked is None else parse_time(asked)


def _answer(status: Status, request: Request, now_ms: int) -> bytes:
    devices = parsed(request.query_params.get("devices"))
    for device in devices:
        if device not in DEVICES:
            raise Refused(str(UNSUPPORTED_DEVICE), f"don't support device {device[:100]}")
    asked = request.query_params.get("vehicles")
    names = None if asked is None else frozenset(parsed(asked))
    paths = parsed(request.query_params.get("paths"))
    if not paths:
        return status.encoded(now_ms, devices, names)
    wanted = tree(paths)
    found = selected(status.whole(now_ms, devices, names), wanted)
    return msgspec.json.encode(found | envelope(0, "ok", now_ms), order="sorted")


def _json(body: bytes, code: int) -> Response:
    return Response(body, code, media_type="application/json")


class Push:
    """Sends every tick to all who listen; who is slow skips ticks and holds up nobody."""

    def __init__(self, encode: Callable[[], bytes], tick_s: float) -> None:
        self._encode = encode
        self._tick_s = tick_s
        self._clients = 0
        self._ticker: asyncio.Task[None] | None = None
        self._newest = ""
        self._number = 0  # of the newest tick
        self._ticked = asyncio.Condition()

    async def serve(self, socket: WebSocket) -> None:
        """Serve one client until it leaves."""
        if self._clients >= CLIENTS_MAX:
            await socket.close(TRY_AGAIN_LATER, f"{CLIENTS_MAX} clients are served already")
            return
        await socket.accept()
        self._clients += 1
        if self._ticker is None:
            self._ticker = asyncio.create_task(self._tick())
        sending = asyncio.create_task(self._send(socket))
        leaving = asyncio.create_task(_until_it_leaves(socket))
        try:
            await asyncio.wait({sending, leaving}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            sending.cancel()
            leaving.cancel()
            await asyncio.gather(sending, leaving, return_exceptions=True)
            self._clients -= 1
            if self._clients == 0 and self._ticker is not None:
                self._ticker.cancel()
                self._ticker = None

    async def _send(self, socket: WebSocket) -> None:
        seen = self._number
        while True:
            async with self._ticked:
                while self._number == seen:
                    await self._ticked.wait()
                seen, frame = self._number, self._newest
            try:
                async with asyncio.timeout(SEND_S_MAX):
                    await socket.send({"type": "websocket.send", "text": frame})
            except (TimeoutError, WebSocketDisconnect, RuntimeError, OSError) as trouble:
                log.info("listener left", dialect="rdscore", reason=str(trouble))
                return

    async def _tick(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            try:
                frame = self._encode().decode()
            except Exception as trouble:  # the next tick may do better
                log.exception("no frame", dialect="rdscore", reason=str(trouble))
            else:
                async with self._ticked:
                    self._newest, self._number = frame, self._number + 1
                    self._ticked.notify_all()
            due = max(due + self._tick_s, loop.time())  # what was missed is not made up for
            await asyncio.sleep(due - loop.time())


async def _until_it_leaves(socket: WebSocket) -> None:
    """Read, and leave unread, what the client says: nothing is asked of it."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
