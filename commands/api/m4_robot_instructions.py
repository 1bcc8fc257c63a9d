"""The M4 calls by which operators tell robots something at once (spec/m4.md §4)."""

from collections.abc import Callable

from fastapi import APIRouter
from pydantic import Field
from starlette.requests import Request
from starlette.responses import Response

from commands.api.answering import KEY_PARAMETER, SCENE_PARAMETER, Answering, scene_id
from commands.api.m4_models import ParallelResult, Text, Wire, parallel_results
from commands.api.m4_robots import RobotNames, RobotNamesReq
from commands.decide import RobotCommand
from commands.instructions import (
    CancelNavigation,
    ClearRobotAlarms,
    ControlRobots,
    PauseRobots,
    ReconnectRobots,
    SoftStopRobots,
)
from commands.recovery import RecoverRobots
from ledger.ids import RobotName, SceneId

OF_ROBOTS = "/api/fleet/robots"


class RobotsOfSceneReq(RobotNamesReq):
    """Robots of the scene in the body."""

    sceneId: Text = Field(description="Scene id.")


class ReconnectReq(Wire):
    """Robots to be reached for."""

    sceneId: Text = Field(description="Scene id.")
    robotNames: RobotNames | None = Field(None, description="Robot names; null = none (C33).")


class ChangeMasterReq(RobotsOfSceneReq):
    """Robots whose control changes."""

    on: bool | None = Field(False, description="True takes control, false releases it.")


class SetSoftEmcReq(RobotNamesReq):
    """Robots to be stopped at once."""

    enable: bool = Field(description="True sets the soft emergency stop, false lifts it.")


class InstructionCalls:
    """Endpoints that translate, ask, and answer for each robot."""

    def __init__(self, answering: Answering) -> None:
        """Take who answers."""
        self._answering = answering

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        for path, endpoint in (
            ("reconnect", self.reconnect),
            ("master", self.master),
            ("cancel-nav", self.cancel_nav),
            ("pause-nav", self.pause_nav),
            ("resume-nav", self.resume_nav),
            ("{sceneId}/clear-alarm", self.clear_alarm),
            ("{sceneId}/set-soft-emc", self.set_soft_emc),
            ("{sceneId}/auto-recovery", self.auto_recovery),
        ):
            of_path = [SCENE_PARAMETER] if "{sceneId}" in path else []
            router.add_api_route(
                f"{OF_ROBOTS}/{path}",
                endpoint,
                methods=["POST"],
                response_model=dict[str, ParallelResult],
                openapi_extra={"parameters": [KEY_PARAMETER, *of_path]},
                tags=["robots"],
            )

    async def _told(
        self,
        request: Request,
        kind: Callable[..., RobotCommand],
        scene: SceneId,
        names: list[str],
        **fields: bool,
    ) -> Response:
        command = kind(
            **self._answering.asked(request)._asdict(),
            scene=scene,
            robots=tuple(map(RobotName, names)),
            **fields,
        )
        return await self._answering.answer(
            request, command, lambda decision: parallel_results(names, decision)
        )

    async def reconnect(self, request: Request, body: ReconnectReq) -> Response:
        """Try to reach robots again that are offline; one that is online is left alone."""
        names = body.robotNames or []
        return await self._told(request, ReconnectRobots, SceneId(body.sceneId), names)

    async def master(self, request: Request, body: ChangeMasterReq) -> Response:
        """Take or release control of robots; one that is offline fails."""
        scene, on = SceneId(body.sceneId), body.on is True
        return await self._told(request, ControlRobots, scene, body.robotNames, taken=on)

    async def cancel_nav(self, request: Request, body: RobotsOfSceneReq) -> Response:
        """Have robots drive no further than what is committed; their orders wait for a retry."""
        scene = SceneId(body.sceneId)
        return await self._told(request, CancelNavigation, scene, body.robotNames)

    async def pause_nav(self, request: Request, body: RobotsOfSceneReq) -> Response:
        """Have robots stop on their way and stay, orders and all; one that is offline fails."""
        scene = SceneId(body.sceneId)
        return await self._told(request, PauseRobots, scene, body.robotNames, paused=True)

    async def resume_nav(self, request: Request, body: RobotsOfSceneReq) -> Response:
        """Let paused robots go on; one that is offline fails."""
        scene = SceneId(body.sceneId)
        return await self._told(request, PauseRobots, scene, body.robotNames, paused=False)

    async def clear_alarm(self, request: Request, body: RobotNamesReq) -> Response:
        """Clear alarms of robots; what is still wrong comes back by itself."""
        return await self._told(request, ClearRobotAlarms, scene_id(request), body.robotNames)

    async def set_soft_emc(self, request: Request, body: SetSoftEmcReq) -> Response:
        """Stop robots at once, or lift that; one that is offline fails."""
        names, stopped = body.robotNames, body.enable
        return await self._told(request, SoftStopRobots, scene_id(request), names, stopped=stopped)

    async def auto_recovery(self, request: Request, body: RobotNamesReq) -> Response:
        """Reconnect, take control if nobody has it, reset traffic, retry the order, clear alarms.

        Traffic is reset for a robot without orders; a faulted order is retried.
        """
        return await self._told(request, RecoverRobots, scene_id(request), body.robotNames)
