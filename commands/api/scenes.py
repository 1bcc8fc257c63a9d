"""Scenes over HTTP: import a scene file, read and change the settings."""

import asyncio

import msgspec
from fastapi import APIRouter
from fastapi.routing import APIRoute
from pydantic import BaseModel, Field
from starlette.requests import Request
from starlette.responses import Response

from commands.api.answering import (
    KEY_PARAMETER,
    SCENE_PARAMETER,
    Answering,
    Durable,
    json_response,
    nothing,
    scene_id,
)
from commands.api.m4_scene_config import SceneConfigPatch, wire
from commands.command import scene_of
from commands.handle import Handler
from commands.imports.scene_json import read_scene
from commands.scenes import ConfigureScene, ImportScene, scene_digest
from ledger.ids import SceneId
from ledger.scene import SceneFile

FILE_BODY = {
    "required": True,
    "description": "A scene file, as `fleetledger scene import` writes it.",
    "content": {"application/json": {"schema": {"type": "object"}}},
}


class ImportAnswer(BaseModel):
    """The scene that the file is."""

    id: str = Field(description="Scene id; the one it already has if the content is known.")


class SceneCalls:
    """Endpoints that translate, ask, and word the answer."""

    def __init__(self, answering: Answering) -> None:
        """Take who answers."""
        self._answering = answering

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        router.add_api_route(
            "/api/fleet/scenes/import",
            self.import_scene,
            methods=["POST"],
            response_model=ImportAnswer,
            openapi_extra={"parameters": [KEY_PARAMETER], "requestBody": FILE_BODY},
            tags=["scenes"],
        )
        path = "/api/fleet/scenes/{sceneId}/config"
        router.add_api_route(
            path,
            self.config,
            methods=["GET"],
            response_model=SceneConfigPatch,
            openapi_extra={"parameters": [SCENE_PARAMETER]},
            tags=["scenes"],
        )
        router.add_api_route(
            path,
            self.configure,
            methods=["POST"],
            openapi_extra={"parameters": [KEY_PARAMETER, SCENE_PARAMETER]},
            tags=["scenes"],
        )

    async def import_scene(self, request: Request) -> Response:
        """Take a scene file in: new, an update of the scene with its name, or known already."""
        raw = await request.body()
        file, digest = await asyncio.to_thread(_file, raw)
        asked = self._answering.asked(request)
        command = ImportScene(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=SceneId(self._answering.handler.new_id()),
            digest=digest,
            file=file,
        )
        return await self._answering.answer(
            request, command, lambda decision: msgspec.json.encode({"id": decision.made})
        )

    async def config(self, request: Request) -> Response:
        """Give all settings of a scene."""
        scene = scene_of(self._answering.handler.fleet, scene_id(request))
        return json_response(wire(scene.config), await self._answering.settled())

    async def configure(self, request: Request, body: SceneConfigPatch) -> Response:
        """Change settings of a scene; what the body leaves out stays as it is."""
        scene = scene_of(self._answering.handler.fleet, scene_id(request))
        asked = self._answering.asked(request)
        command = ConfigureScene(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene.id,
            config=body.config(scene.config),
        )
        return await self._answering.answer(request, command, nothing)


def _file(raw: bytes) -> tuple[SceneFile, str]:
    """Read a file and its digest, on another thread, for it may be large."""
    file = read_scene(raw)
    return file, scene_digest(file)


def router(handler: Handler, durable: Durable, route_class: type[APIRoute]) -> APIRouter:
    """Give the calls about scenes; `commands.api.m4.router` tells of the arguments."""
    calls = APIRouter(route_class=route_class)
    SceneCalls(Answering(handler, durable)).join(calls)
    return calls
