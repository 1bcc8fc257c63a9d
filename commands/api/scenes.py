"""Scenes over HTTP: import a scene file, make, rename, disable, pause and remove, settings."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Query
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
from commands.api.m4_scene_config import SceneConfigAll, SceneConfigPatch, wire
from commands.api.m4_scenes import (
    CreateSceneReq,
    DisableSceneReq,
    PauseDispatchReq,
    RemoveScenesReq,
    SceneBasicPatch,
    SceneIdAnswer,
)
from commands.command import Decision, known_scene
from commands.handle import Handler
from commands.imports.scene_json import read_scene
from commands.scene_config import ConfigureScene
from commands.scene_life import (
    CreateScene,
    DisableScene,
    PauseDispatch,
    RemoveScenes,
    RenameScene,
)
from commands.scenes import ImportScene, scene_digest
from ledger.ids import SceneId
from ledger.moment import parse_time
from ledger.scene import SceneFile
from ledger.state import Fleet

FOLDER = "/api/fleet/scenes"
OF_SCENE = f"{FOLDER}/{{sceneId}}"
FILE_BODY = {
    "required": True,
    "description": "A scene file, as `fleetledger scene import` writes it.",
    "content": {"application/json": {"schema": {"type": "object"}}},
}


FleetThen = Callable[[int], Awaitable[Fleet]]  # the state at a moment, epoch milliseconds


class MomentAsked(BaseModel):
    """When."""

    as_of: str | None = Field(
        None, alias="asOf", description="A past moment: epoch milliseconds or ISO 8601."
    )


class SceneCalls:
    """Endpoints that translate, ask, and word the answer."""

    def __init__(self, answering: Answering, fleet_then: FleetThen) -> None:
        """Take who answers, and who knows past states."""
        self._answering = answering
        self._fleet_then = fleet_then

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        file = {"requestBody": FILE_BODY}
        _post(router, f"{FOLDER}/import", self.import_scene, SceneIdAnswer, **file)
        _post(router, f"{FOLDER}/create", self.create, SceneIdAnswer)
        _post(router, f"{FOLDER}/remove", self.remove)
        _post(router, f"{OF_SCENE}/basic/patch", self.rename)
        _post(router, f"{OF_SCENE}/disable", self.disable)
        _post(router, f"{OF_SCENE}/dispatch-pause", self.pause_dispatch)
        _post(router, f"{OF_SCENE}/config", self.configure)
        _post(router, f"{OF_SCENE}/config/patch", self.configure)
        router.add_api_route(
            f"{OF_SCENE}/config",
            self.config,
            methods=["GET"],
            response_model=SceneConfigAll,
            openapi_extra={"parameters": [SCENE_PARAMETER]},
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
        return await self._answering.answer(request, command, _id)

    async def create(self, request: Request, body: CreateSceneReq) -> Response:
        """Make an empty scene; the import of a file with its name fills it."""
        asked = self._answering.asked(request)
        command = CreateScene(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=SceneId(self._answering.handler.new_id()),
            name=body.name,
        )
        return await self._answering.answer(request, command, _id)

    async def remove(self, request: Request, body: RemoveScenesReq) -> Response:
        """Take scenes without live orders away for good, with their robots; all, or none."""
        asked = self._answering.asked(request)
        scenes = tuple(map(SceneId, body.ids))
        command = RemoveScenes(id=asked.id, by=asked.by, at_ms=asked.at_ms, scenes=scenes)
        return await self._answering.answer(request, command, nothing)

    async def rename(self, request: Request, body: SceneBasicPatch) -> Response:
        """Give a scene another name or place in lists; what is absent stays as it is."""
        asked = self._answering.asked(request)
        command = RenameScene(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene_id(request),
            name=body.name,
            display_order=body.displayOrder,
        )
        return await self._answering.answer(request, command, nothing)

    async def disable(self, request: Request, body: DisableSceneReq) -> Response:
        """Take a scene out of service, or put it back; its orders stay as they are."""
        asked = self._answering.asked(request)
        command = DisableScene(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene_id(request),
            disabled=body.disabled,
        )
        return await self._answering.answer(request, command, nothing)

    async def pause_dispatch(self, request: Request, body: PauseDispatchReq) -> Response:
        """Let no order of the scene get a robot, or let them again."""
        asked = self._answering.asked(request)
        command = PauseDispatch(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene_id(request),
            paused=body.paused,
        )
        return await self._answering.answer(request, command, nothing)

    async def config(self, request: Request, query: Annotated[MomentAsked, Query()]) -> Response:
        """Give the settings of a scene, as they are or were obeyed."""
        asked = query.as_of or request.headers.get("asOf")
        if asked is None:
            scene = known_scene(self._answering.handler.fleet, scene_id(request))
            return json_response(wire(scene.config), await self._answering.settled())
        fleet = await self._fleet_then(parse_time(asked))
        scene = known_scene(fleet, scene_id(request))
        return json_response(wire(scene.config), fleet.position)

    async def configure(self, request: Request, body: SceneConfigPatch) -> Response:
        """Change settings of a scene; what the body leaves out stays as it is.

        A setting that is not supported can only be sent as `GET …/config` gives it.
        """
        scene = known_scene(self._answering.handler.fleet, scene_id(request))
        asked = self._answering.asked(request)
        command = ConfigureScene(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene.id,
            config=body.config(scene.config),
        )
        return await self._answering.answer(request, command, nothing)


def _post(
    router: APIRouter,
    path: str,
    endpoint: Callable[..., Any],
    model: type[Any] | None = None,
    **more: Any,
) -> None:
    parameters = [KEY_PARAMETER]
    if "{sceneId}" in path:
        parameters.append(SCENE_PARAMETER)
    router.add_api_route(
        path,
        endpoint,
        methods=["POST"],
        response_model=model,
        openapi_extra={"parameters": parameters, **more},
        tags=["scenes"],
    )


def _id(decision: Decision) -> bytes:
    return msgspec.json.encode({"id": decision.made})


def _file(raw: bytes) -> tuple[SceneFile, str]:
    """Read a file and its digest, on another thread, for it may be large."""
    file = read_scene(raw)
    return file, scene_digest(file)


def router(
    handler: Handler, durable: Durable, route_class: type[APIRoute], fleet_then: FleetThen
) -> APIRouter:
    """Give the calls about scenes; `commands.api.m4.router` tells of the first arguments."""
    calls = APIRouter(route_class=route_class)
    SceneCalls(Answering(handler, durable), fleet_then).join(calls)
    return calls
