"""The WebSocket `/wsm`: questions and their answers, and scenes pushed (docs/api-websocket.md).

A client's frames are answered one after the other, so nothing is queued for it: while it does not
read, nothing more of it is read. It must not be compressed: that is done for each client anew.
"""

import asyncio
from collections import Counter, deque
from contextlib import suppress

import msgspec
import structlog
from fastapi import APIRouter
from prometheus_client import Gauge
from starlette.websockets import WebSocket, WebSocketDisconnect

from ledger.errors import Refused
from ledger.ids import SceneId
from projections.api.m4_models import ReportsAsked, StreamAsked
from projections.api.m4_scene_query import SceneQueries, fields_asked
from projections.api.m4_scenes import scene_asked
from projections.api.scene_changes import FOLLOWED, USUAL, SceneChanges
from projections.api.wsm_actions import Actions
from projections.api.wsm_frames import (
    BAD_REQUEST,
    NOT_SIGNED_IN,
    BadFrame,
    Frame,
    Naming,
    content_of,
    encoded,
    escaped,
    read,
    refusal,
    refusal_of,
    reply_action,
)
from projections.api.wsm_push import SUBSCRIBE, TICK_S, Push

PATH = "/wsm"
CLIENTS_MAX = 200
CLIENTS_OF_A_USER_MAX = 100
FRAMES_A_SECOND_MAX = 50  # of one client; more wait
SUBSCRIPTIONS_MAX = 10  # of one client
SEND_S_MAX = 30.0  # a client that takes longer for one frame is let go
UNSUBSCRIBE = "Fleetledger::Scene::Unsubscribe"
RESYNC = "Fleetledger::Scene::Resync"
TRY_AGAIN_LATER, REFUSED = 1013, 1008  # WebSocket close codes

CLIENTS = Gauge("fleetledger_websocket_clients", "Clients of /wsm")

log = structlog.get_logger()


def router(queries: SceneQueries, tick_s: float = TICK_S) -> APIRouter:
    """Give the route. `state.user` of the scope must hold the caller's name, or be empty."""
    made = APIRouter()
    service = Service(queries, tick_s)
    made.add_websocket_route(PATH, service.serve)
    return made


class Service:
    """All clients."""

    def __init__(self, queries: SceneQueries, tick_s: float = TICK_S) -> None:
        """Take who answers, and the pace of the push in seconds of the wall."""
        self.queries = queries
        self.actions = Actions(queries)
        live, now_ms = queries.find.live, queries.find.now_ms
        self.push = Push(
            lambda scene: SceneChanges(live, scene, queries.beside, queries.encoded, now_ms),
            lambda: live.position,
            tick_s,
        )
        self._clients: Counter[str] = Counter()  # by user

    async def serve(self, socket: WebSocket) -> None:
        """Serve one client until it leaves."""
        await socket.accept()
        user = str(socket.scope.get("state", {}).get("user", ""))
        try:
            naming = Naming(socket.query_params.get("naming", Naming.SEED))
        except ValueError:
            words = f"Parameter 'naming' must be one of {', '.join(Naming)}."
            await _turn_away(socket, REFUSED, BAD_REQUEST, "errFieldInvalid", words)
            return
        if not user:
            words = "Sign in, or send the headers of a key pair with the handshake."
            await _turn_away(socket, REFUSED, NOT_SIGNED_IN, "errNotSignedIn", words)
            return
        if self._clients.total() >= CLIENTS_MAX or self._clients[user] >= CLIENTS_OF_A_USER_MAX:
            words = f"{CLIENTS_MAX} clients are served at most, {CLIENTS_OF_A_USER_MAX} of a user."
            await _turn_away(socket, TRY_AGAIN_LATER, BAD_REQUEST, "errTooManyClients", words)
            return
        self._clients[user] += 1
        CLIENTS.inc()
        client = Client(socket, self, naming)
        try:
            await client.run()
        except (TimeoutError, WebSocketDisconnect, RuntimeError, OSError) as trouble:
            log.info("client left", dialect="m4", user=user, reason=str(trouble))
        finally:
            client.close()
            CLIENTS.dec()
            self._clients[user] -= 1
            if not self._clients[user]:
                del self._clients[user]


async def _turn_away(socket: WebSocket, close: int, error: int, code: str, words: str) -> None:
    """Say why not; the handshake has succeeded, as clients expect even of a bad login."""
    with suppress(WebSocketDisconnect, RuntimeError, OSError):
        await socket.send_text(refusal(Frame(), error, code, words, ()))
        await socket.close(close, code)


class Client:
    """One connection."""

    def __init__(self, socket: WebSocket, service: Service, naming: Naming) -> None:
        self._socket = socket
        self._service = service
        self._naming = naming
        self._pushed: str | None = None  # frame that is on its way
        self._pushing: asyncio.Task[None] | None = None
        self._woken = asyncio.Event()
        self._read_at: deque[float] = deque(maxlen=FRAMES_A_SECOND_MAX)

    def ready(self) -> bool:
        """Whether it has taken the last frame that was pushed."""
        return self._pushed is None

    def push(self, text: str) -> None:
        """Send a frame beside the answers."""
        self._pushed = text
        self._woken.set()

    async def run(self) -> None:
        """Answer its frames until it leaves."""
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            await self._in_turn()
            answer = await self._answer(message.get("text"))
            await self._send(answer)

    async def _in_turn(self) -> None:
        """Let a client that sends too fast wait; meanwhile nothing more of it is read."""
        now = asyncio.get_running_loop().time
        if len(self._read_at) == FRAMES_A_SECOND_MAX:
            await asyncio.sleep(max(0.0, self._read_at[0] + 1.0 - now()))
        self._read_at.append(now())

    async def _send(self, text: str) -> None:
        async with asyncio.timeout(SEND_S_MAX):
            await self._socket.send({"type": "websocket.send", "text": text})

    async def _answer(self, text: str | None) -> str:
        frame = Frame()
        try:
            frame = read(text)
            content = await self._content(frame)
            return encoded(reply_action(frame.action, self._naming), content, frame.id)
        except BadFrame as trouble:
            return refusal_of(trouble.frame, trouble)
        except Refused as trouble:
            return refusal_of(frame, trouble)
        except Exception as trouble:  # a bug of ours must not cost the client its connection
            log.exception("frame not answered", action=frame.action, reason=str(trouble))
            return refusal_of(frame, trouble)

    async def _content(self, frame: Frame) -> str:
        match frame.action:
            case action if action in self._service.actions.known:
                return await self._service.actions.answer(frame)
            case action if action == SUBSCRIBE:
                return escaped(self._subscribe(content_of(frame, StreamAsked)))
            case action if action == UNSUBSCRIBE:
                return escaped(self._unsubscribe(content_of(frame, ReportsAsked)))
            case action if action == RESYNC:
                return escaped(self._resync(content_of(frame, ReportsAsked)))
        known = ", ".join([*self._service.actions.known, SUBSCRIBE, UNSUBSCRIBE, RESYNC])
        shown = frame.action[:100]
        raise Refused(
            "errActionUnknown", f"There is no action '{shown}'; there are {known}.", shown
        )

    def _subscribe(self, asked: StreamAsked) -> bytes:
        scene = scene_asked(self._service.queries.find.live.fleet, asked.scene_id, None).id
        fields = fields_asked(asked.fields, USUAL)
        if any(field not in FOLLOWED for field in fields):
            words = f"Field 'content.fields': only {', '.join(FOLLOWED)} can be followed."
            raise Refused("errFieldInvalid", words, "content.fields")
        if self._service.push.followed_by(self) >= SUBSCRIPTIONS_MAX:
            words = f"A client may follow {SUBSCRIPTIONS_MAX} scenes."
            raise Refused("errTooManyScenes", words, SUBSCRIPTIONS_MAX)
        if self._pushing is None:
            self._pushing = asyncio.create_task(self._push_on())
        self._service.push.subscribe(self, scene, frozenset(fields))
        return msgspec.json.encode({"sceneId": scene, "fields": fields})

    def _unsubscribe(self, asked: ReportsAsked) -> bytes:
        scene = SceneId(asked.scene_id)
        if not self._service.push.unsubscribe(self, scene):
            raise _not_followed(scene)
        return b"{}"

    def _resync(self, asked: ReportsAsked) -> bytes:
        scene = SceneId(asked.scene_id)
        if not self._service.push.resync(self, scene):
            raise _not_followed(scene)
        return b"{}"

    async def _push_on(self) -> None:
        """Send what is pushed; a client that takes none for too long is let go."""
        try:
            while True:
                await self._woken.wait()
                self._woken.clear()
                assert self._pushed is not None
                await self._send(self._pushed)
                self._pushed = None
        except (TimeoutError, WebSocketDisconnect, RuntimeError, OSError) as trouble:
            log.info("follower left", dialect="m4", reason=str(trouble))
            self._service.push.leave(self)
            with suppress(RuntimeError, OSError, WebSocketDisconnect):
                async with asyncio.timeout(1.0):
                    await self._socket.close(TRY_AGAIN_LATER, "too slow")

    def close(self) -> None:
        """Push nothing more."""
        self._service.push.leave(self)
        if self._pushing is not None:
            self._pushing.cancel()


def _not_followed(scene: SceneId) -> Refused:
    words = f"Field 'content.sceneId': this client does not follow scene '{scene}'."
    return Refused("errNotSubscribed", words, scene)
