"""The M4 calls that set robots up (spec/m4.md §4), and one of ours that clears their bins."""

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from commands.api.answering import (
    KEY_PARAMETER,
    SCENE_PARAMETER,
    Answering,
    nothing,
    scene_id,
)
from commands.api.m4_models import ParallelResult, parallel_results
from commands.api.m4_robots import (
    CreateRobotBatchReq,
    RobotNamesReq,
    SceneRobot,
    SceneRobots,
    UpdateDisabledReq,
    UpdateOffDutyReq,
)
from commands.robots import (
    ClearRobotBins,
    CreateRobots,
    DisableRobots,
    RemoveRobots,
    SendRobotsOffDuty,
)
from ledger.ids import SceneId

OF_SCENE = "/api/fleet/scenes/{sceneId}/robot"
OF_ROBOTS = "/api/fleet/robots"


class RobotCalls:
    """Endpoints that translate, ask, and word the answer."""

    def __init__(self, answering: Answering) -> None:
        """Take who answers."""
        self._answering = answering

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        for path, endpoint, model in (
            (f"{OF_SCENE}/create", self.create, None),
            (f"{OF_SCENE}/create/batch", self.create_batch, None),
            (f"{OF_SCENE}/create/auto-batch", self.create_auto_batch, None),
            (f"{OF_SCENE}/remove", self.remove, None),
            (f"{OF_ROBOTS}/{{sceneId}}/disabled", self.disabled, None),
            (f"{OF_ROBOTS}/off-duty", self.off_duty, dict[str, ParallelResult]),
            (f"{OF_ROBOTS}/{{sceneId}}/clear-bins", self.clear_bins, dict[str, ParallelResult]),
        ):
            parameters = [KEY_PARAMETER]
            if "{sceneId}" in path:
                parameters.append(SCENE_PARAMETER)
            router.add_api_route(
                path,
                endpoint,
                methods=["POST"],
                response_model=model,
                openapi_extra={"parameters": parameters},
                tags=["robots"],
            )

    async def create(self, request: Request, body: SceneRobot) -> Response:
        """Add one robot to a scene."""
        return await self._create(request, [body])

    async def create_batch(self, request: Request, body: SceneRobots) -> Response:
        """Add several robots to a scene; all of them, or none."""
        return await self._create(request, body)

    async def _create(self, request: Request, robots: list[SceneRobot]) -> Response:
        asked = self._answering.asked(request)
        command = CreateRobots(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene_id(request),
            robots=tuple(robot.robot() for robot in robots),
        )
        return await self._answering.answer(request, command, nothing)

    async def create_auto_batch(self, request: Request, body: CreateRobotBatchReq) -> Response:
        """Add a number of robots alike; a name that is taken refuses the whole call."""
        command = body.command(self._answering.asked(request), scene_id(request))
        return await self._answering.answer(request, command, nothing)

    async def remove(self, request: Request, body: RobotNamesReq) -> Response:
        """Remove robots that have no orders; all of them, or none."""
        asked = self._answering.asked(request)
        command = RemoveRobots(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene_id(request),
            robots=body.names(),
        )
        return await self._answering.answer(request, command, nothing)

    async def disabled(self, request: Request, body: UpdateDisabledReq) -> Response:
        """Take robots out of dispatch, or put them back; all of them, or none."""
        asked = self._answering.asked(request)
        command = DisableRobots(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene_id(request),
            robots=body.names(),
            disabled=body.disabled,
        )
        return await self._answering.answer(request, command, nothing)

    async def off_duty(self, request: Request, body: UpdateOffDutyReq) -> Response:
        """Let robots take no more orders, or let them take some again; each on its own."""
        asked = self._answering.asked(request)
        command = SendRobotsOffDuty(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=SceneId(body.sceneId),
            robots=body.names(),
            off_duty=body.offDuty is True,
        )
        return await self._answering.answer(
            request, command, lambda decision: parallel_results(body.robotNames, decision)
        )

    async def clear_bins(self, request: Request, body: RobotNamesReq) -> Response:
        """State that loads left over from cancelled orders were taken off the robots by hand."""
        asked = self._answering.asked(request)
        command = ClearRobotBins(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene_id(request),
            robots=body.names(),
        )
        return await self._answering.answer(
            request, command, lambda decision: parallel_results(body.robotNames, decision)
        )
