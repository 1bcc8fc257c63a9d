"""From a command to its HTTP answer: durable first, and the same answer to a repeated key."""

import asyncio
import hashlib
from collections.abc import Awaitable, Callable, Coroutine
from functools import wraps
from typing import Any, NamedTuple, TypeVar
from weakref import WeakValueDictionary

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from commands.command import Decision
from commands.decide import AnyCommand
from commands.handle import Handler, Reply
from commands.rejected import Reason, Rejected
from ledger.ids import CommandId, SceneId

KEY_HEADER = "Idempotency-Key"
KEY_CHARS_MAX = 200
POSITION_HEADER = "X-Ledger-Position"
_KEY = KEY_HEADER.lower().encode()  # as it comes in the scope
DIGEST_INLINE_BYTES_MAX = 1_000_000  # hashing more than this would hold up everybody

Durable = Callable[[int], Awaitable[None]]  # waits until a position is on disk and visible
Words = Callable[[Decision], bytes]  # the body of the answer to what was decided
Later = Callable[[Decision], Awaitable[bytes]]  # the same, once something has come of it

KEY_PARAMETER: dict[str, Any] = {
    "name": KEY_HEADER,
    "in": "header",
    "required": False,
    "schema": {"type": "string", "minLength": 1, "maxLength": KEY_CHARS_MAX},
    "description": "A repeated key gets the first answer and nothing happens twice; "
    "a key belongs to its caller and to one request. Malformed requests use no key up.",
}
SCENE_PARAMETER: dict[str, Any] = {
    "name": "sceneId",
    "in": "path",
    "required": True,
    "schema": {"type": "string"},
    "description": "Scene id.",
}


class Asked(NamedTuple):
    """Who asks, when, and by which id the command will be known."""

    id: CommandId
    by: str
    at_ms: int


class Ready(NamedTuple):
    """An answer that may be given once its position is on disk."""

    position: int
    status: int
    body: bytes


Body = TypeVar("Body")
Decide = Callable[[Request, Body], Ready]
Endpoint = Callable[[Request, Body], Coroutine[Any, Any, Response]]


def nothing(_: Decision) -> bytes:
    """Answer without a body, where the specification says the response is none."""
    return b""


class Answering:
    """What the calls of every dialect share."""

    def __init__(self, handler: Handler, durable: Durable) -> None:
        """Take who decides, and how to wait for the disk."""
        self.handler = handler
        self._durable = durable
        self._turns: WeakValueDictionary[CommandId, asyncio.Lock] = WeakValueDictionary()

    def asked(self, request: Request) -> Asked:
        """Read the head of a command: with a key its id is the key, within its caller's own."""
        by = request.scope["state"]["user"]
        key = _key_of(request)
        if key is None:
            return Asked(CommandId(self.handler.new_id()), by, self.handler.now_ms())
        if not key.strip() or len(key) > KEY_CHARS_MAX:
            message = f"Header '{KEY_HEADER}' must have 1 to {KEY_CHARS_MAX} characters."
            raise Rejected(Reason.KEY_INVALID, message)
        return Asked(CommandId(f"{by}/{key}"), by, self.handler.now_ms())

    def repeated(self, request: Request) -> bool:
        """Tell whether the key of a command has its answer already."""
        return (
            KEY_HEADER in request.headers
            and self.handler.answer_of(self.asked(request).id) is not None
        )

    async def answer(self, request: Request, command: AnyCommand, words: Words) -> Response:
        """Decide, wait until it is on disk, answer."""
        digest = None if _key_of(request) is None else await _digest(request)
        return await self._given(self._decided(command, digest, words))

    def ready(self, request: Request, command: AnyCommand, words: Words) -> Ready:
        """Decide and word the answer, for a call with an ordinary body."""
        digest = None
        if _key_of(request) is not None:
            digest = _begun(request, request.scope["state"]["body"]).hexdigest()
        return self._decided(command, digest, words)

    def once_durable(self, decide: Decide[Body]) -> Endpoint[Body]:
        """Make an endpoint of a function that decides, by `ready`.

        A server may also call the function itself and wait for the disk by itself: to wait in a
        coroutine costs as much as deciding.
        """

        @wraps(decide)
        async def endpoint(request: Request, body: Body) -> Response:
            return await self._given(decide(request, body))

        return endpoint

    async def _given(self, ready: Ready) -> Response:
        await self._durable(ready.position)
        return _response(ready.status, ready.body, ready.position)

    def _decided(self, command: AnyCommand, digest: str | None, words: Words) -> Ready:
        if digest is None:
            decision = self.handler.handle(command)
            return Ready(decision.position, 200, words(decision))

        def reply(outcome: Decision | Rejected) -> Reply:
            if isinstance(outcome, Rejected):
                return Reply(status=outcome.status, body=_refusal(outcome))
            return Reply(status=200, body=words(outcome).decode())

        answered = self.handler.handle_once(command, digest, reply)
        return Ready(answered.position, answered.reply.status, answered.reply.body.encode())

    async def answer_later(
        self, request: Request, command: AnyCommand, later: Later, nothing_more: AnyCommand
    ) -> Response:
        """Decide, wait until it is on disk and for what comes of it, and answer that.

        A repeated key gets the first answer here too. As that is known only now, it is kept beside
        a command of the same id that changes nothing; what a crash leaves unanswered is done anew.
        A repetition that comes meanwhile waits for that answer.
        """
        if KEY_HEADER not in request.headers:
            decision = self.handler.handle(command)
            await self._durable(decision.position)
            body = await later(decision)
            return _response(200, body, await self.settled())
        digest = await _digest(request)
        reply = Reply(status=200, body="")
        async with self._turns.setdefault(command.id, asyncio.Lock()):
            if self.handler.answered(command.id, digest) is None:
                try:
                    decision = self.handler.handle(command)
                    await self._durable(decision.position)
                    reply = Reply(status=200, body=(await later(decision)).decode())
                except Rejected as no:
                    reply = Reply(status=no.status, body=_refusal(no))
            answered = self.handler.handle_once(nothing_more, digest, lambda _: reply)
        await self._durable(answered.position)
        given = answered.reply
        return _response(given.status, given.body.encode(), answered.position)

    async def settled(self) -> int:
        """Wait until the newest state is on disk; give its position."""
        position = self.handler.fleet.position
        await self._durable(position)
        return position


def scene_id(request: Request) -> SceneId:
    """Read the scene of the path."""
    return SceneId(request.path_params["sceneId"])


def json_response(body: object, position: int) -> Response:
    """Answer a query of the command side."""
    return _response(200, msgspec.json.encode(body), position)


def _response(status: int, body: bytes, position: int) -> Response:
    return Response(
        body,
        status,
        {POSITION_HEADER: str(position)},
        "application/json" if body else None,
    )


def _refusal(no: Rejected) -> str:
    """ErrorBody of spec/m4.md."""
    body = {"code": no.code, "message": no.message, "args": list(no.arguments)}
    return msgspec.json.encode(body).decode()


async def _digest(request: Request) -> str:
    """Tell requests apart: method, path and body."""
    body = await request.body()
    start = _begun(request)
    if len(body) > DIGEST_INLINE_BYTES_MAX:
        await asyncio.to_thread(start.update, body)
    else:
        start.update(body)
    return start.hexdigest()


def _begun(request: Request, body: bytes = b"") -> "hashlib._Hash":
    return hashlib.sha256(f"{request.method} {request.url.path}\n".encode() + body)


def _key_of(request: Request) -> str | None:
    for name, value in request.scope["headers"]:
        if name == _KEY:
            key: str = value.decode("latin-1")
            return key
    return None
