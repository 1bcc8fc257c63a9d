"""What happens around every call: who asks, whether it may, how much, and what is counted."""

import time
from collections.abc import Awaitable, Callable, Mapping
from typing import NamedTuple, TypeAlias

import structlog
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fleetledger.access.callers import (
    APP_ID_HEADER,
    APP_KEY_HEADER,
    SAFE_METHODS,
    Caller,
    Callers,
    Headers,
    claimed,
    from_own_page,
)
from fleetledger.access.roles import OPEN, RANK, Policy
from fleetledger.call_figures import FIGURES
from fleetledger.durability import Then
from fleetledger.http import (
    BODY_BYTES_MAX,
    EXPECTED,
    SCENE_BYTES_MAX,
    Head,
    Quick,
    answer_to,
    error,
)
from ledger.errors import LedgerError

log = structlog.get_logger()

POSITION_HEADER = "X-Ledger-Position"
WAIT_HEADER = "X-Wait-Position"
POSITION_DIGITS_MAX = 18
SCENE_IMPORT_PATH = "/api/fleet/scenes/import"
SIGN_IN_PATH = "/api/sign-in"
UNDER_WAY_MAX = 1024  # calls at once, followers of streams among them
HEAD_BYTES_MAX = 32_768  # of a call's path, query and headers
BUSY_WAIT_S = 1

# as they come in the scope; every call is looked at, so no object is made of its headers
_POSITION, _WAIT = POSITION_HEADER.lower().encode(), WAIT_HEADER.lower().encode()

# of every answer: nothing may guess at types, frame a page, or learn what was asked here
_ALWAYS = ((b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"no-referrer"))
_POLICY = b"content-security-policy"
# of pages without a policy of their own, which are those about the API: their script is inline
_PAGES_POLICY = (
    b"default-src 'self'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; "
    b"img-src 'self' data:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    b"frame-ancestors 'none'"
)

Refusing = Callable[[str, str, str, str], None]  # caller as claimed, address, call, code
RawHeaders: TypeAlias = list[tuple[bytes, bytes]]
Give: TypeAlias = Callable[[int, bytes, bytes], None]  # status, header lines and body, once


class Barred(NamedTuple):
    """Why a call is refused."""

    status: int
    code: str
    words: str
    arguments: tuple[object, ...] = ()
    noted: bool = True  # in the audit


def header_lines(headers: RawHeaders) -> bytes:
    """Give headers as they are sent."""
    return b"".join([b"%b: %b\r\n" % header for header in headers])


# of a quick call's answer; to be filled in: length and position
_EMPTY_LINES = b"content-length: %d\r\nx-ledger-position: %d\r\n" + header_lines([*_ALWAYS])
_JSON_LINES = _EMPTY_LINES + b"content-type: application/json\r\n"


class Gate:
    """Check who asks and how much, wait for a position if asked, name it in every answer."""

    def __init__(
        self,
        app: ASGIApp,
        *,
        callers: Callers,
        policy: Policy,
        refused: Refusing,
        position: Callable[[], int],
        wait: Callable[[int], Awaitable[bool]],
        quick: Mapping[tuple[str, str], Quick],
        when: Callable[[int, Then], None],
    ) -> None:
        """Take who calls, what they may, who hears of refusals, the position and its coming.

        `quick` are the calls that need no coroutine, `when` tells when a position is on disk.
        """
        self._app = app
        self._callers = callers
        self._policy = policy
        self._refused = refused
        self._under_way = 0
        self._position = position
        self._wait = wait
        self._when = when
        self._quick = {
            (method.encode(), path.encode()): quick for (method, path), quick in quick.items()
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the call on, or refuse it."""
        if scope["type"] != "http":
            if scope["type"] == "websocket":
                self._name_follower(scope)
            await self._app(scope, receive, send)
            return
        began = time.perf_counter()
        status = 500

        async def send_with_position(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                self._complete(message["headers"], scope["path"])
            await send(message)

        self._under_way += 1
        try:
            await self._pass_or_refuse(scope, receive, send_with_position)
        finally:
            self._under_way -= 1
            self._count(scope, status, began)

    def is_quick(self, method: bytes, target: bytes) -> bool:
        """Tell whether `take` may be asked."""
        return (method, target) in self._quick

    def take(self, scope: Scope, body: bytes, give: Give) -> bool:
        """Serve a quick call: no coroutine, no task, one wake-up of many by the disk.

        The ordinary way takes 100 µs more a call (measured), half of what an order costs. False =
        it would be refused before it is decided, or must wait: nothing has happened, and the
        ordinary way says so.
        """
        began = time.perf_counter()
        headers: dict[bytes, bytes] = dict(scope["headers"])
        caller = self._callers.caller(headers)
        if _WAIT in headers or self._barred(scope, headers, caller) is not None:
            return False
        scope["route"], decide = self._quick[scope["method"].encode(), scope["raw_path"]]
        _introduce(scope, caller)

        def answered(response: Response) -> None:
            self._complete(response.raw_headers, scope["path"])
            give(response.status_code, header_lines(response.raw_headers), bytes(response.body))
            self._count(scope, response.status_code, began)

        try:
            ready = decide(Head(scope), body)
        except EXPECTED as trouble:
            answer = answer_to(trouble)
            assert answer is not None
            answered(answer)
            return True
        except Exception:
            answered(_our_bug(scope, caller))
            return True
        self._under_way += 1

        def durable(failure: LedgerError | None) -> None:
            self._under_way -= 1
            if failure is not None:
                answer = answer_to(failure)
                assert answer is not None
                answered(answer)
                return
            lines = _JSON_LINES if ready.body else _EMPTY_LINES
            give(ready.status, lines % (len(ready.body), ready.position), ready.body)
            self._count(scope, ready.status, began)

        self._when(ready.position, durable)
        return True

    def _complete(self, headers: RawHeaders, path: str) -> None:
        """Add what every answer says."""
        headers.extend(_ALWAYS)
        names = [name for name, _ in headers]
        if _POSITION not in names:
            headers.append((_POSITION, b"%d" % self._position()))
        if _POLICY not in names and not path.startswith("/api/"):
            headers.append((_POLICY, _PAGES_POLICY))

    def _count(self, scope: Scope, status: int, began: float) -> None:
        route = getattr(scope.get("route"), "path", "other")
        FIGURES.count(scope["method"], route, status, time.perf_counter() - began)

    async def _pass_or_refuse(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers: dict[bytes, bytes] = dict(scope["headers"])
        path: str = scope["path"]
        caller = self._callers.caller(headers)
        limit = SCENE_BYTES_MAX if path == SCENE_IMPORT_PATH else BODY_BYTES_MAX
        barred = self._barred(scope, headers, caller)
        refusal = None
        if barred is not None:
            refusal = self._refusal(scope, headers, barred)
        elif not _at_most(headers.get(b"content-length", b"0"), limit):
            refusal = _too_large(limit)
        elif (wanted := headers.get(_WAIT)) is not None:
            refusal = await self._waited(wanted)
        if refusal is not None:
            await refusal(scope, receive, send)
            return
        _introduce(scope, caller)
        if b"transfer-encoding" in headers:
            receive = _limited(receive, limit)
        try:
            await self._app(scope, receive, send)
        except BodyTooLarge:
            await _too_large(limit)(scope, receive, send)
        except Exception:
            await _our_bug(scope, caller)(scope, receive, send)

    def _barred(self, scope: Scope, headers: Headers, caller: Caller | None) -> Barred | None:
        """Bar whom nobody knows, who may not, and who comes from another's page."""
        if self._under_way > UNDER_WAY_MAX:
            words = f"{UNDER_WAY_MAX} calls are under way: try again."
            return Barred(503, "errBusy", words, noted=False)
        if _head_bytes(scope) > HEAD_BYTES_MAX:
            words = f"Path, query and headers may have {HEAD_BYTES_MAX} bytes."
            return Barred(431, "errHeadTooLarge", words, (HEAD_BYTES_MAX,), noted=False)
        method, path = scope["method"], scope["path"]
        rank = self._policy.rank(method, path)
        if caller is None:
            if rank != OPEN:
                return Barred(401, "errNotSignedIn", _NOT_SIGNED_IN)
        elif RANK[caller.role] < rank:
            words = f"Role '{caller.role}' of '{caller.name}' does not suffice for this call."
            return Barred(403, "errForbidden", words)
        if not self._callers.host_is_known(headers):
            return Barred(403, "errHostUnknown", _HOST_UNKNOWN)
        ambient = path == SIGN_IN_PATH if caller is None else caller.ambient
        if ambient and method not in SAFE_METHODS and not from_own_page(headers):
            return Barred(403, "errOtherSite", _OTHER_SITE)
        return None

    def _refusal(self, scope: Scope, headers: Headers, barred: Barred) -> Response:
        if barred.noted:
            call = f"{scope['method']} {scope['path']}"
            self._refused(claimed(headers), _address(scope), call, barred.code)
        answer = error(barred.status, barred.code, barred.words, barred.arguments)
        if barred.code == "errBusy":
            answer.headers["Retry-After"] = str(BUSY_WAIT_S)
        return answer

    def _name_follower(self, scope: Scope) -> None:
        """Tell a WebSocket's endpoint who it is, or that nobody is; it words the refusal.

        Browsers let every page open one to anywhere, cookies included: so it must be our own.
        """
        headers: dict[bytes, bytes] = dict(scope["headers"])
        caller = self._callers.caller(headers)
        code = ""
        if caller is None:
            code = "errNotSignedIn"
        elif not self._callers.host_is_known(headers):
            code = "errHostUnknown"
        elif caller.ambient and not from_own_page(headers):
            code = "errOtherSite"
        if code:
            call = f"WebSocket {scope['path']}"
            self._refused(claimed(headers), _address(scope), call, code)
        _introduce(scope, None if code else caller)

    async def _waited(self, wanted: bytes) -> Response | None:
        """Wait for a position; gives the refusal if that is none, or does not come."""
        if not wanted.isdigit() or len(wanted) > POSITION_DIGITS_MAX:
            return error(400, "errFieldInvalid", f"Header '{WAIT_HEADER}' must be a position.")
        if not await self._wait(int(wanted)):
            return error(504, "errPositionNotReached", f"Position {int(wanted)} did not come.")
        return None


def _our_bug(scope: Scope, caller: Caller | None) -> Response:
    """Answer the exception of the moment: the last resort, or one bug would stop the server."""
    name = caller and caller.name
    log.exception("call failed", method=scope["method"], path=scope["path"], caller=name)
    return error(500, "errServerBug", "This is a bug of the server; its log has more.")


def _introduce(scope: Scope, caller: Caller | None) -> None:
    """Tell the endpoints who calls."""
    state = scope.setdefault("state", {})
    state["caller"] = caller
    state["user"] = "" if caller is None else caller.name
    state["role"] = None if caller is None else caller.role


_NOT_SIGNED_IN = (
    f"Sign in by POST {SIGN_IN_PATH}, or send the headers {APP_ID_HEADER} and {APP_KEY_HEADER} "
    "of a key pair; the first one was printed when the server first started."
)
_HOST_UNKNOWN = (
    "Without access control this server answers to the names of this machine only: use 127.0.0.1."
)
_OTHER_SITE = "A page of another site may not do this in your name."


def _address(scope: Scope) -> str:
    client = scope.get("client")
    return client[0] if client else ""


def _head_bytes(scope: Scope) -> int:
    size = len(scope.get("raw_path") or scope["path"]) + len(scope["query_string"])
    for name, value in scope["headers"]:
        size += len(name) + len(value)
    return size


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
