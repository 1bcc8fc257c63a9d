"""HTTP for all dialects: thin documented routes, one shape of error, limits on bodies."""

import asyncio
import inspect
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, NamedTuple, Protocol, get_type_hints

import msgspec
from fastapi import APIRouter, FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel, Field, TypeAdapter, ValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from ledger.errors import LedgerError, Refused

BODY_BYTES_MAX = 1_000_000  # of an ordinary request
SCENE_BYTES_MAX = 64_000_000  # of an imported scene file
LEDGER_WAIT_S = "5"  # until who could not be served may try again
BODY_S_MAX = 30  # for a body to come, of whatever size

Handle = Callable[[Request], Coroutine[Any, Any, Response]]


class Ready(Protocol):
    """An answer that may be given once its position is on disk."""

    @property
    def position(self) -> int:
        """Of the newest event that it rests on or states."""

    @property
    def status(self) -> int:
        """Status."""

    @property
    def body(self) -> bytes:
        """JSON, or nothing."""


class Head(Request):
    """A request of which all has been read; Starlette's own takes longer to be made."""

    def __init__(self, scope: Scope) -> None:
        """Take the scope alone."""
        self.scope = scope


class Quick(NamedTuple):
    """A call whose answer only waits for the disk: deciding it needs no coroutine."""

    route: "ThinRoute"
    decide: Callable[[Request, bytes], Ready]


class ThinRoute(APIRoute):
    """A route that FastAPI documents and that does nothing else between body and endpoint.

    The endpoint takes `request`, and `query: Annotated[Model, Query()]` and `body: Model` if it
    wants them, and answers a Response. FastAPI's own handling costs 75 µs a request, which halves
    the rate of the hot calls (measured).
    An endpoint that wraps a plain function which gives a Ready is a `quick` one.
    """

    def quick(self) -> Quick | None:
        """Give what decides the call from its body, without a coroutine; None = it needs one."""
        decide = inspect.unwrap(self.endpoint)
        if inspect.iscoroutinefunction(decide):
            return None
        body: TypeAdapter[Any] = TypeAdapter(get_type_hints(decide)["body"])
        validate = body.validator.validate_json

        def from_body(request: Request, raw: bytes) -> Ready:
            request.scope["state"]["body"] = raw
            ready: Ready = decide(request, validate(raw))
            return ready

        return Quick(self, from_body)

    def get_route_handler(self) -> Handle:
        """Validate the body from its bytes, call the endpoint, pass its Response on."""
        endpoint = self.endpoint
        hints = get_type_hints(endpoint, include_extras=True)
        wanted = inspect.signature(endpoint).parameters
        body: TypeAdapter[Any] | None = TypeAdapter(hints["body"]) if "body" in wanted else None
        query: TypeAdapter[Any] | None = TypeAdapter(hints["query"]) if "query" in wanted else None

        async def handle(request: Request) -> Response:
            arguments: dict[str, Any] = {}
            if query is not None:
                # text is all that a URL can hold, so numbers and booleans are read from it
                arguments["query"] = query.validate_python(dict(request.query_params), strict=False)
            if body is not None:
                request.state.body = await _read(request)
                arguments["body"] = body.validate_json(request.state.body)
            answer: Response = await endpoint(request, **arguments)
            return answer

        return handle


async def _read(request: Request) -> bytes:
    """Read the whole body, within a time; nearly always it comes in one message."""
    try:
        async with asyncio.timeout(BODY_S_MAX):
            message = await request.receive()
            if not message.get("more_body"):
                # where Starlette keeps it for later readers
                request._body = message.get("body", b"")
                return request._body
            parts = [message.get("body", b"")]
            while message.get("more_body"):
                message = await request.receive()
                if message["type"] == "http.disconnect":
                    raise ClientDisconnect
                parts.append(message.get("body", b""))
    except TimeoutError:
        raise TooSlow("errBodyTooSlow", f"The body did not come within {BODY_S_MAX} s.") from None
    request._body = b"".join(parts)
    return request._body


class TooSlow(Refused):
    """The client holds a place and does not send."""

    status = 408


class ErrorBody(BaseModel):
    """The body of every refusal (spec/m4.md, ErrorBody)."""

    code: str = Field(description="Code that programs may rely on.")
    message: str = Field(description="Which field is wrong, what is wrong, what would be right.")
    args: list[Any] = Field([], description="What the message speaks of.")


class Later(Refused):
    """Not now: the client is told after how many seconds to try again."""

    status = 429

    def __init__(self, code: str, message: str, wait_s: int) -> None:
        """Take the code, the sentence, and the wait."""
        super().__init__(code, message, wait_s)
        self.wait_s = wait_s


def error(status: int, code: str, message: str, args: tuple[object, ...] = ()) -> Response:
    """Answer a refusal."""
    body = {"code": code, "message": message, "args": list(args)}
    return Response(msgspec.json.encode(body), status, media_type="application/json")


def answer_to(trouble: Exception) -> Response | None:
    """Give the answer to an expected trouble; None where it is a bug of ours."""
    if isinstance(trouble, Refused):
        answer = error(trouble.status, trouble.code, trouble.message, trouble.arguments)
        if trouble.wait_s is not None:
            answer.headers["Retry-After"] = str(trouble.wait_s)
        return answer
    if isinstance(trouble, ValidationError | RequestValidationError):
        return error(400, *_first_fault(list(trouble.errors())))
    if isinstance(trouble, LedgerError):
        answer = error(503, trouble.code, f"{str(trouble).rstrip('.')}. {trouble.hint}")
        answer.headers["Retry-After"] = LEDGER_WAIT_S
        return answer
    if isinstance(trouble, HTTPException):
        return error(trouble.status_code, f"errHttp{trouble.status_code}", str(trouble.detail))
    return None


EXPECTED = (Refused, ValidationError, RequestValidationError, LedgerError, HTTPException)


def install_errors(app: FastAPI) -> None:
    """Map every expected trouble to its status and ErrorBody."""

    async def answer(_: Request, trouble: Exception) -> Response:
        given = answer_to(trouble)
        assert given is not None
        return given

    for kind in EXPECTED:
        app.add_exception_handler(kind, answer)


class FastLane:
    """Calls the thin routes without parameters in their paths by one look-up.

    FastAPI documents them and serves everything else: its routing, stacks and telemetry hooks cost
    100 µs a request (measured), more than deciding and appending an order.
    """

    def __init__(self, app: ASGIApp, routers: Sequence[APIRouter]) -> None:
        """Take the application, and the routers whose thin routes are to be quick."""
        self._app = app
        self._handles: dict[tuple[str, str], tuple[ThinRoute, Handle]] = {
            (method, route.path): (route, route.get_route_handler())
            for router in routers
            for route in router.routes
            if isinstance(route, ThinRoute) and "{" not in route.path
            for method in route.methods or ()
        }
        found = {call: route.quick() for call, (route, _) in self._handles.items()}
        self.quick = {call: quick for call, quick in found.items() if quick is not None}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve the call, or pass it on."""
        found = None
        if scope["type"] == "http":
            found = self._handles.get((scope["method"], scope["path"]))
        if found is None:
            await self._app(scope, receive, send)
            return
        scope["route"], handle = found
        try:
            response = await handle(Request(scope, receive))
        except EXPECTED as trouble:
            answer = answer_to(trouble)
            assert answer is not None
            response = answer
        await response(scope, receive, send)


def _first_fault(faults: list[Any]) -> tuple[str, str, tuple[object, ...]]:
    """Say in words which field is wrong, what is wrong, and what came instead."""
    fault = faults[0]
    field = ".".join(str(part) for part in fault["loc"] if part not in ("body", "query", "path"))
    if fault["type"] == "json_invalid":
        return "errBadJson", f"The body is not JSON: {fault['msg']}", ()
    if fault["type"] == "missing":
        return "errFieldMissing", f"Field '{field}' is required and missing.", (field,)
    if fault["type"] == "extra_forbidden":
        return "errFieldUnknown", f"Field '{field}' is not known here.", (field,)
    words = fault["msg"].removeprefix("Value error, ")
    return "errFieldInvalid", f"Field '{field}' is wrong: {words}.", (field,)
