"""Callbacks of a scene over HTTP: who is told of the orders' states, and the secret that signs."""

from collections.abc import Callable
from typing import Annotated, Any, Protocol

import msgspec
from fastapi import APIRouter
from fastapi.routing import APIRoute
from pydantic import BaseModel, Field, StringConstraints
from starlette.requests import Request
from starlette.responses import Response

from commands.api.answering import (
    KEY_HEADER,
    KEY_PARAMETER,
    POSITION_HEADER,
    SCENE_PARAMETER,
    Answering,
    Durable,
    json_response,
    scene_id,
)
from commands.api.m4_models import Wire
from commands.callbacks import (
    RETRIES_MAX,
    RETRY_S_MAX,
    RETRY_S_MIN,
    URL_CHARS_MAX,
    URLS_MAX,
    ConfigureCallbacks,
)
from commands.command import Decision, known_scene
from commands.handle import Handler
from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.ids import SceneId

STATUSES_MAX = 50  # repetitions are let pass
SECRET_CHARS_MIN, SECRET_CHARS_MAX = 16, 200
SET = "set"  # instead of a secret that is not shown; too short to be one

ENABLE = "Whether anybody is told. Changes count for what happens after them."
STATUSES = "What is told; an empty list means everything."
URLS = f"Who is told, each of everything: http or https, at most {URLS_MAX}, no repetition."
RETRIES = "How often a callback is sent again before it is given up."
INTERVAL = "Seconds before the first retry; doubles with each one, up to a minute."

Url = Annotated[str, StringConstraints(max_length=URL_CHARS_MAX)]


class Secrets(Protocol):
    """Where secrets are kept, for they are not in the ledger."""

    def get(self, name: str) -> str | None:
        """Give a secret; None where there is none."""

    def put(self, name: str, value: str) -> None:
        """Keep a secret; on disk when it returns."""


def secret_name(scene: SceneId) -> str:
    """Name of the secret that signs a scene's callbacks."""
    return f"callback/{scene}"


class CallbackPatch(Wire):
    """Settings of callbacks; what is left out, or null, stays as it is."""

    enableOrderCallback: bool | None = Field(None, description=ENABLE)
    callbackStatusList: list[CallbackStatus] | None = Field(
        None, max_length=STATUSES_MAX, description=STATUSES
    )
    callbackUrlList: list[Url] | None = Field(None, max_length=URLS_MAX, description=URLS)
    retryTimes: int | None = Field(None, ge=0, le=RETRIES_MAX, description=RETRIES)
    retryInterval: float | None = Field(
        None, ge=RETRY_S_MIN, le=RETRY_S_MAX, description=INTERVAL, allow_inf_nan=False
    )
    secret: str | None = Field(
        None,
        min_length=SECRET_CHARS_MIN,
        max_length=SECRET_CHARS_MAX,
        pattern=r"^[\x21-\x7e]+$",
        repr=False,
        description="Secret that signs every callback from now on, also those that wait; ASCII "
        "without spaces. Where there is none, enabling makes one and answers it this once.",
    )

    def over(self, config: CallbackConfig) -> CallbackConfig:
        """Give the settings with these changes."""
        changes: dict[str, Any] = {
            "enabled": self.enableOrderCallback,
            "urls": _tuple(self.callbackUrlList),
            "statuses": _tuple(self.callbackStatusList),
            "retries_max": self.retryTimes,
            "retry_s": self.retryInterval,
        }
        given = {name: value for name, value in changes.items() if value is not None}
        return msgspec.structs.replace(config, **given)


def _tuple(values: list[Any] | None) -> tuple[Any, ...] | None:
    """Each once, in the order given; URLs are checked for repetition where they are decided."""
    if values is None:
        return None
    if values and isinstance(values[0], CallbackStatus):
        return tuple(dict.fromkeys(values))
    return tuple(values)


class CallbackSettings(BaseModel):
    """Settings of a scene's callbacks."""

    enableOrderCallback: bool = Field(description=ENABLE)
    callbackStatusList: list[CallbackStatus] = Field(description=STATUSES)
    callbackUrlList: list[str] = Field(description=URLS)
    retryTimes: int = Field(description=RETRIES)
    retryInterval: float = Field(description=INTERVAL)
    secret: str | None = Field(
        None,
        description=f"`{SET}` where there is one, else left out. A secret that the server has just "
        "made is shown here, once.",
    )


class CallbackCalls:
    """Endpoints that translate, ask, and word the answer."""

    def __init__(
        self, answering: Answering, secrets: Secrets, new_secret: Callable[[], str]
    ) -> None:
        """Take who answers, where secrets are kept, and who makes them up."""
        self._answering = answering
        self._secrets = secrets
        self._new_secret = new_secret

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        path = "/api/fleet/scenes/{sceneId}/callbacks"
        for method, endpoint, parameters in (
            ("GET", self.settings, [SCENE_PARAMETER]),
            ("POST", self.configure, [KEY_PARAMETER, SCENE_PARAMETER]),
        ):
            router.add_api_route(
                path,
                endpoint,
                methods=[method],
                response_model=CallbackSettings,
                openapi_extra={"parameters": parameters},
                tags=["callbacks"],
            )

    async def settings(self, request: Request) -> Response:
        """Say who is told of the states of a scene's orders; the secret is not shown."""
        scene = known_scene(self._answering.handler.fleet, scene_id(request))
        return json_response(self._wire(scene.id, scene.callbacks), await self._answering.settled())

    async def configure(self, request: Request, body: CallbackPatch) -> Response:
        """Choose who is told of the states of a scene's orders (docs/callbacks.md).

        What happens after this change is told by it; what happened before, as it was settled then.
        """
        scene = known_scene(self._answering.handler.fleet, scene_id(request))
        asked = self._answering.asked(request)
        config = body.over(scene.callbacks)
        command = ConfigureCallbacks(
            id=asked.id, by=asked.by, at_ms=asked.at_ms, scene=scene.id, callbacks=config
        )
        made: list[str] = []

        def words(_: Decision) -> bytes:
            """With a key the secret is kept here: before the events are appended, and not at all
            where the answer is a repeated one."""
            if not made:
                self._keep(command, body.secret, made)
            return msgspec.json.encode(self._wire(scene.id, config))  # kept: without the secret

        if KEY_HEADER not in request.headers:
            self._keep(command, body.secret, made)
        answer = await self._answering.answer(request, command, words)
        if answer.status_code != 200 or not any(made):
            return answer
        shown = {**self._wire(scene.id, config), "secret": made[0]}
        return json_response(shown, int(answer.headers[POSITION_HEADER]))

    def _keep(self, command: ConfigureCallbacks, given: str | None, made: list[str]) -> None:
        """Keep what was given, or make one where callbacks begin without; note what is made.

        It comes before the events, but what would be refused leaves it alone.
        """
        self._answering.handler.consider(command)
        name = secret_name(command.scene)
        fresh = ""
        if given is not None:
            self._secrets.put(name, given)
        elif command.callbacks.enabled and self._secrets.get(name) is None:
            fresh = self._new_secret()
            self._secrets.put(name, fresh)
        made.append(fresh)

    def _wire(self, scene: SceneId, config: CallbackConfig) -> dict[str, Any]:
        wire: dict[str, Any] = {
            "enableOrderCallback": config.enabled,
            "callbackStatusList": list(config.statuses),
            "callbackUrlList": list(config.urls),
            "retryTimes": config.retries_max,
            "retryInterval": config.retry_s,
        }
        if self._secrets.get(secret_name(scene)) is not None:
            wire["secret"] = SET
        return wire


def router(
    handler: Handler,
    durable: Durable,
    route_class: type[APIRoute],
    secrets: Secrets,
    new_secret: Callable[[], str],
) -> APIRouter:
    """Give the calls about callbacks; `commands.api.m4.router` tells of the first arguments."""
    calls = APIRouter(route_class=route_class)
    CallbackCalls(Answering(handler, durable), secrets, new_secret).join(calls)
    return calls
