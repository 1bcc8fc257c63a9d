"""The write side in process: FastAPI over a ledger in memory, called without a socket."""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from itertools import count
from typing import Any

import httpx
from fastapi import FastAPI
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

import commands.api.m4
import commands.api.scenes
from commands.api.m4_resources import Watch
from commands.handle import Handler
from fleetledger.http import ThinRoute, install_errors
from ledger.errors import DiskFull
from ledger.events import AnyEvent, stamped
from ledger.evolve import fold
from ledger.ids import CommandId, RobotName, SceneId, UnitId
from ledger.state import Fleet
from ledger.store import MemoryLedger
from tests.commands.site import opened
from tests.scenario import STORY_MS, happened


class AsUser:
    """Says who calls, by a header of the tests."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            scope.setdefault("state", {})["user"] = Request(scope).headers.get("user", "alice")
        await self._app(scope, receive, send)


async def _in_vain(units: Sequence[UnitId]) -> bool:
    return False


class Site:
    """The application, its handler, and what it waited for."""

    def __init__(self, events: Sequence[AnyEvent]) -> None:
        self.ledger = MemoryLedger()
        ready = [stamped(e, n, STORY_MS, "given", CommandId("")) for n, e in enumerate(events, 1)]
        if ready:
            self.ledger.append(ready, 0)
        ids = count(1)
        self.handler = Handler(
            happened(events), self.ledger, lambda: STORY_MS, lambda: f"{next(ids):024X}"
        )
        self.waited: list[int] = []
        self.app = FastAPI()
        install_errors(self.app)
        self.secrets: dict[tuple[SceneId, RobotName], str] = {}
        self.app.include_router(
            commands.api.m4.router(
                self.handler, self.durable, ThinRoute, self.keep_secrets, lambda u: self.watch(u)
            )
        )
        self.watch: Watch = _in_vain  # how it ends that somebody waits for ground
        self.app.include_router(
            commands.api.scenes.router(self.handler, self.durable, ThinRoute, self.fleet_then)
        )

    def fill_disk(self) -> None:
        """Let the ledger take nothing more."""

        def full(events: Sequence[AnyEvent], expected: int) -> int:
            raise DiskFull("64 MB must stay free")

        self.ledger.append = full  # type: ignore[method-assign]

    async def fleet_then(self, at_ms: int) -> Fleet:
        return fold(Fleet(), [e for e in self.ledger.read(0) if e.at_ms <= at_ms])

    async def keep_secrets(self, scene: SceneId, secrets: Mapping[RobotName, str]) -> None:
        self.secrets |= {(scene, robot): secret for robot, secret in secrets.items()}

    async def durable(self, position: int) -> None:
        assert position <= self.ledger.durable
        self.waited.append(position)

    @asynccontextmanager
    async def client(self) -> AsyncIterator[httpx.AsyncClient]:
        transport = httpx.ASGITransport(app=AsUser(self.app))
        async with httpx.AsyncClient(transport=transport, base_url="http://site") as client:
            yield client

    async def post(self, path: str, body: Any = None, **kw: Any) -> httpx.Response:
        async with self.client() as client:
            if isinstance(body, bytes):
                return await client.post(path, content=body, **kw)
            return await client.post(path, json=body, **kw)

    async def get(self, path: str) -> httpx.Response:
        async with self.client() as client:
            return await client.get(path)


def site(*events: AnyEvent) -> Site:
    return Site(events or opened())
