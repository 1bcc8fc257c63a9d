"""What happens around every HTTP call: who asks, how much may be sent, and what is counted."""

import time
from collections.abc import Awaitable, Callable

import structlog
from prometheus_client import Counter, Histogram
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fleetledger.access import APP_ID_HEADER, APP_KEY_HEADER, Keys
from fleetledger.http import BODY_BYTES_MAX, SCENE_BYTES_MAX, error

log = structlog.get_logger()

POSITION_HEADER = "X-Ledger-Position"
WAIT_HEADER = "X-Wait-Position"
SCENE_IMPORT_PATH = "/api/fleet/scenes/import"
OPEN_PATHS = (
    "/",
    "/api/ping",
    "/favicon.ico",
    "/docs",
    "/openapi.json",
)  # tell nothing of the plant
OPEN_FOLDERS = ("/console/", "/static-offline-docs/")

CALLS = Counter("fleetledger_http_calls", "HTTP calls", ["method", "route", "status"])
SECONDS = Histogram(
    "fleetledger_http_seconds",
    "Time to answer",
    ["route"],
    buckets=(0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1, 5),
)


class Gate:
    """Check keys and sizes, wait for a position if asked, and name the position in every answer."""

    def __init__(
        self,
        app: ASGIApp,
        *,
        keys: Keys | None,
        position: Callable[[], int],
        wait: Callable[[int], Awaitable[bool]],
    ) -> None:
        """Take the app, the keys (None = open), the readable position, and how to wait for one."""
        self._app = app
        self._keys = keys
        self._position = position
        self._wait = wait
        self._figures: dict[tuple[str, str, int], tuple[Counter, Histogram]] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the call on, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began = time.perf_counter()
        status = 500

        async def send_with_position(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                if POSITION_HEADER not in headers:
                    headers[POSITION_HEADER] = str(self._position())
            await send(message)

        try:
            await self._pass_or_refuse(scope, receive, send_with_position)
        finally:
            route = getattr(scope.get("route"), "path", "other")
            calls, seconds = self._figures_of(scope["method"], route, status)
            calls.inc()
            seconds.observe(time.perf_counter() - began)

    def _figures_of(self, method: str, route: str, status: int) -> tuple[Counter, Histogram]:
        key = (method, route, status)  # finding a labelled child costs more than counting
        if key not in self._figures:
            self._figures[key] = (
                CALLS.labels(method, route, str(status)),
                SECONDS.labels(route),
            )
        return self._figures[key]

    async def _pass_or_refuse(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope)
        path: str = scope["path"]
        caller = self._caller(headers)
        if caller is None and not _is_open(path):
            answer = error(
                401,
                "errNotSignedIn",
                f"Send the headers {APP_ID_HEADER} and {APP_KEY_HEADER} of a key pair; "
                "the first one was printed when the server first started.",
            )
            await answer(scope, receive, send)
            return
        scope.setdefault("state", {})["user"] = caller or ""
        wanted = headers.get(WAIT_HEADER)
        if wanted is not None:
            if not wanted.isdecimal():
                answer = error(400, "errFieldInvalid", f"{WAIT_HEADER} must be a position.")
                await answer(scope, receive, send)
                return
            if not await self._wait(int(wanted)):
                answer = error(504, "errPositionNotReached", f"Position {wanted} did not come.")
                await answer(scope, receive, send)
                return
        limit = SCENE_BYTES_MAX if path == SCENE_IMPORT_PATH else BODY_BYTES_MAX
        length = headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > limit:
            answer = error(413, "errBodyTooLarge", f"The body may have {limit} bytes.", (limit,))
            await answer(scope, receive, send)
            return
        if "transfer-encoding" in headers:
            receive = _limited(receive, limit)
        try:
            await self._app(scope, receive, send)
        except BodyTooLarge:
            answer = error(413, "errBodyTooLarge", f"The body may have {limit} bytes.", (limit,))
            await answer(scope, receive, send)
        except Exception:
            # the last resort: a bug of ours must not cost other clients their server
            log.exception("call failed", method=scope["method"], path=path, caller=caller)
            answer = error(500, "errServerBug", "This is a bug of the server; its log has more.")
            await answer(scope, receive, send)

    def _caller(self, headers: Headers) -> str | None:
        if self._keys is None:
            return headers.get(APP_ID_HEADER, "anonymous")[:100]
        app_id, key = headers.get(APP_ID_HEADER), headers.get(APP_KEY_HEADER)
        if app_id is None or key is None:
            return None
        return self._keys.caller(app_id, key)


class BodyTooLarge(Exception):
    """A body without a declared length grew beyond the limit."""


def _limited(receive: Receive, limit: int) -> Receive:
    seen = 0

    async def receive_limited() -> Message:
        nonlocal seen
        message = await receive()
        seen += len(message.get("body", b""))
        if seen > limit:
            raise BodyTooLarge
        return message

    return receive_limited


def _is_open(path: str) -> bool:
    return path in OPEN_PATHS or path.startswith(OPEN_FOLDERS)
