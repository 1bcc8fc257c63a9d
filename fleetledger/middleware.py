"""What happens around every HTTP call: who asks, how much may be sent, and what is counted."""

import time
from collections.abc import Awaitable, Callable

import structlog
from prometheus_client import Counter, Histogram
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fleetledger.access import APP_ID_HEADER, APP_KEY_HEADER, Keys
from fleetledger.http import BODY_BYTES_MAX, SCENE_BYTES_MAX, error

log = structlog.get_logger()

POSITION_HEADER = "X-Ledger-Position"
WAIT_HEADER = "X-Wait-Position"
APP_ID_CHARS_MAX = 100
POSITION_DIGITS_MAX = 18
SCENE_IMPORT_PATH = "/api/fleet/scenes/import"
OPEN_PATHS = (
    "/",
    "/api/ping",
    "/favicon.ico",
    "/docs",
    "/openapi.json",
)  # tell nothing of the plant
OPEN_FOLDERS = ("/console/", "/static-offline-docs/")

# as they come in the scope; every call is looked at, so no object is made of its headers
_POSITION, _WAIT = POSITION_HEADER.lower().encode(), WAIT_HEADER.lower().encode()
_APP_ID, _APP_KEY = APP_ID_HEADER.encode(), APP_KEY_HEADER.encode()

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
                headers = message["headers"]
                if all(name != _POSITION for name, _ in headers):
                    headers.append((_POSITION, b"%d" % self._position()))
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
        headers: dict[bytes, bytes] = dict(scope["headers"])
        path: str = scope["path"]
        caller = self._caller(headers)
        limit = SCENE_BYTES_MAX if path == SCENE_IMPORT_PATH else BODY_BYTES_MAX
        refusal = None
        if caller is None and not _is_open(path):
            refusal = _not_signed_in()
        elif not _at_most(headers.get(b"content-length", b"0"), limit):
            refusal = _too_large(limit)
        elif (wanted := headers.get(_WAIT)) is not None:
            refusal = await self._waited(wanted)
        if refusal is not None:
            await refusal(scope, receive, send)
            return
        scope.setdefault("state", {})["user"] = caller or ""
        if b"transfer-encoding" in headers:
            receive = _limited(receive, limit)
        try:
            await self._app(scope, receive, send)
        except BodyTooLarge:
            await _too_large(limit)(scope, receive, send)
        except Exception:
            # the last resort: a bug of ours must not cost other clients their server
            log.exception("call failed", method=scope["method"], path=path, caller=caller)
            answer = error(500, "errServerBug", "This is a bug of the server; its log has more.")
            await answer(scope, receive, send)

    async def _waited(self, wanted: bytes) -> Response | None:
        """Wait for a position; gives the refusal if that is none, or does not come."""
        if not wanted.isdigit() or len(wanted) > POSITION_DIGITS_MAX:
            return error(400, "errFieldInvalid", f"Header '{WAIT_HEADER}' must be a position.")
        if not await self._wait(int(wanted)):
            return error(504, "errPositionNotReached", f"Position {int(wanted)} did not come.")
        return None

    def _caller(self, headers: dict[bytes, bytes]) -> str | None:
        app_id, key = headers.get(_APP_ID), headers.get(_APP_KEY)
        if self._keys is None:
            return "anonymous" if app_id is None else app_id.decode("latin-1")[:APP_ID_CHARS_MAX]
        if app_id is None or key is None:
            return None
        return self._keys.caller(app_id.decode("latin-1"), key.decode("latin-1"))


def _not_signed_in() -> Response:
    return error(
        401,
        "errNotSignedIn",
        f"Send the headers {APP_ID_HEADER} and {APP_KEY_HEADER} of a key pair; "
        "the first one was printed when the server first started.",
    )


def _too_large(limit: int) -> Response:
    return error(413, "errBodyTooLarge", f"The body may have {limit} bytes.", (limit,))


def _at_most(length: bytes, limit: int) -> bool:
    return length.isdigit() and int(length) <= limit


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
