"""What of a scene's callbacks is still to be delivered, for those who look after receivers."""

import asyncio
from collections.abc import Callable
from typing import Any

import msgspec
from fastapi import APIRouter
from fastapi.routing import APIRoute
from pydantic import BaseModel, Field
from starlette.requests import Request
from starlette.responses import Response

from ledger.callbacks import CallbackStatus
from ledger.errors import Refused
from ledger.ids import SceneId
from ledger.scene import Scene
from projections.callbacks import Callback

Waiting = Callable[[], list[Callback]]  # all that is to be delivered, oldest first

SCENE_PARAMETER: dict[str, Any] = {
    "name": "sceneId",
    "in": "path",
    "required": True,
    "schema": {"type": "string"},
    "description": "Scene id.",
}


class OldestCallback(BaseModel):
    """The callback that waits longest."""

    id: str = Field(description="Its id, as the receiver will see it.")
    orderId: str = Field(description="The order that it tells of.")
    status: CallbackStatus = Field(description="The state that it tells of.")
    at: int = Field(description="When that happened, epoch milliseconds.")
    position: int = Field(description="Position of the event in the ledger.")
    tries: int = Field(description="How often it was sent in vain.")
    lastError: str | None = Field(description="What the last try met; null before the first.")


class WaitingAtUrl(BaseModel):
    """What one address is still to get."""

    url: str = Field(description="The address.")
    count: int = Field(description="How many callbacks wait.")
    failing: int = Field(description="How many of them were sent in vain at least once.")
    oldest: OldestCallback = Field(description="The one that waits longest.")


class WaitingCallbacks(BaseModel):
    """What is still to be delivered of a scene's callbacks."""

    count: int = Field(description="How many callbacks of the scene wait.")
    behind: int = Field(
        description="How many events of all scenes were not looked at yet. It stays high while too "
        "many callbacks wait: then nothing more is told until some are accepted or given up."
    )
    urls: list[WaitingAtUrl] = Field(description="By address, in the order of what waits longest.")


def waiting_by_url(callbacks: list[Callback], scene: SceneId, behind: int) -> dict[str, Any]:
    """Count what waits of a scene."""
    by_url: dict[str, list[Callback]] = {}
    for callback in callbacks:
        if callback.scene == scene:
            by_url.setdefault(callback.url, []).append(callback)
    return {
        "count": sum(map(len, by_url.values())),
        "behind": behind,
        "urls": [
            {
                "url": url,
                "count": len(of_url),
                "failing": sum(callback.error != "" for callback in of_url),
                "oldest": _oldest(of_url[0]),
            }
            for url, of_url in by_url.items()
        ],
    }


def _oldest(callback: Callback) -> dict[str, Any]:
    return {
        "id": callback.id,
        "orderId": callback.order,
        "status": callback.status.value,
        "at": callback.at_ms,
        "position": callback.position,
        "tries": callback.tries,
        "lastError": callback.error or None,
    }


def router(
    scene_of: Callable[[SceneId], Scene | None],
    waiting: Waiting,
    behind: Callable[[], int],
    route_class: type[APIRoute],
) -> APIRouter:
    """Give the call; the first argument finds a scene among those that queries see."""
    calls = APIRouter(route_class=route_class, tags=["callbacks"])

    @calls.get(
        "/api/fleet/scenes/{sceneId}/callbacks/waiting",
        response_model=WaitingCallbacks,
        openapi_extra={"parameters": [SCENE_PARAMETER]},
    )
    async def callbacks_waiting(request: Request) -> Response:
        """Say what of a scene's callbacks is still to be delivered, and what keeps it."""
        scene = SceneId(request.path_params["sceneId"])
        if not scene.strip():
            raise Refused("errSceneIdBlank", "Field 'sceneId' must not be blank.")
        found = scene_of(scene)
        if found is None or found.removed:
            raise Refused("errSceneNotFound", f"There is no scene with id '{scene}'.", scene)
        # as many as fifty thousand: nobody else shall wait for their number
        body = await asyncio.to_thread(lambda: waiting_by_url(waiting(), scene, behind()))
        return Response(msgspec.json.encode(body), media_type="application/json")

    return calls
