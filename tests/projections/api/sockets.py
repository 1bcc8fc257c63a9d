"""A WebSocket client of an application in process: what uvicorn does between it and the network."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from starlette.types import ASGIApp, Message

REPLY_S_MAX = 20.0


class Socket:
    """One connection. While it is `stalled` nothing is taken from the application."""

    def __init__(self) -> None:
        self.sent: asyncio.Queue[Message] = asyncio.Queue()
        self.received: asyncio.Queue[Message] = asyncio.Queue()
        self.flowing = asyncio.Event()
        self.flowing.set()
        self.waiting = 0  # sends that the application is held up in

    async def receive(self) -> Message:
        return await self.sent.get()

    async def send(self, message: Message) -> None:
        self.waiting += 1
        await self.flowing.wait()
        self.waiting -= 1
        self.received.put_nowait(message)

    def say(self, text: str | None, **other: Any) -> None:
        self.sent.put_nowait({"type": "websocket.receive", "text": text, **other})

    def ask(self, action: str, content: Any = None, **other: Any) -> None:
        frame = {"action": action, "content": json.dumps(content or {})} | other
        self.say(json.dumps(frame))

    async def message(self) -> Message:
        async with asyncio.timeout(REPLY_S_MAX):
            return await self.received.get()

    async def text(self) -> str:
        message = await self.message()
        assert message["type"] == "websocket.send", message
        return str(message["text"])

    async def frame(self) -> Any:
        """Give the next frame, its content read."""
        frame = json.loads(await self.text())
        return frame | {"content": json.loads(frame["content"])}

    async def answer(self, action: str, content: Any = None, **other: Any) -> Any:
        self.ask(action, content, **other)
        return await self.frame()

    async def next_of(self, action: str) -> Any:
        """Pass over frames up to the next of this action."""
        while (frame := await self.frame())["action"] != action:
            pass
        return frame


@asynccontextmanager
async def opened(app: ASGIApp, query: str = "", path: str = "/wsm") -> AsyncIterator[Socket]:
    """Open a connection, accepted, and leave it in the end."""
    socket = Socket()
    scope = {
        "type": "websocket",
        "asgi": {"version": "3.0"},
        "scheme": "ws",
        "path": path,
        "raw_path": path.encode(),
        "query_string": query.encode(),
        "root_path": "",
        "headers": [(b"host", b"localhost")],
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 2),
        "subprotocols": [],
        "state": {},
    }
    socket.sent.put_nowait({"type": "websocket.connect"})
    serving = asyncio.create_task(app(scope, socket.receive, socket.send))  # type: ignore[arg-type]
    try:
        assert (await socket.message())["type"] == "websocket.accept"
        yield socket
    finally:
        socket.flowing.set()
        socket.sent.put_nowait({"type": "websocket.disconnect", "code": 1000})
        await serving
