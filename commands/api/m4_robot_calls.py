"""The M4 calls that set robots up (spec/m4.md §4), and one of ours that clears their bins."""

from collections.abc import Awaitable, Callable, Mapping
from typing import TypeAlias

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
    UpdateRobotConfigBatchReq,
)
from commands.decide import RobotCommand
from commands.rejected import Rejected
from commands.robot_config import ReconfigureRobot, ReconfigureRobots
from commands.robot_duty import ClearRobotBins, DisableRobots, SendRobotsOffDuty
from commands.robots import CreateRobots, RemoveRobots
from ledger.events import RobotAdded, RobotReconfigured
from ledger.ids import RobotName, SceneId

# keeps gateway secrets of a scene's robots; on disk when it returns, which takes its time
# returns when they are on disk
KeepSecrets: TypeAlias = Callable[[SceneId, Mapping[RobotName, str]], Awaitable[None]]

OF_SCENE = "/api/fleet/scenes/{sceneId}/robot"
OF_ROBOTS = "/api/fleet/robots"


class RobotCalls:
    """Endpoints that translate, ask, and word the answer."""

    def __init__(self, answering: Answering, keep_secrets: KeepSecrets) -> None:
        """Take who answers, and who keeps what the ledger must not."""
        self._answering = answering
        self._keep_secrets = keep_secrets

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        for path, endpoint, model in (
            (f"{OF_SCENE}/create", self.create, None),
            (f"{OF_SCENE}/create/batch", self.create_batch, None),
            (f"{OF_SCENE}/create/auto-batch", self.create_auto_batch, None),
            (f"{OF_SCENE}/remove", self.remove, None),
            (f"{OF_SCENE}/update/config", self.update, None),
            (f"{OF_SCENE}/update/config/batch", self.update_batch, dict[str, ParallelResult]),
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
        secrets = {r.robotName or "": given for r in robots if (given := r.secret())}
        await self._keep(request, command, secrets)
        return await self._answering.answer(request, command, nothing)

    async def _keep(
        self, request: Request, command: RobotCommand, given: Mapping[str, str] | str | None
    ) -> None:
        """Keep secrets, of each robot or one for all, before the ledger says that there are some.

        Only of robots that the command will set up, and not again when a key is repeated: by then
        the robot may have a newer one.
        """
        if not given or self._answering.repeated(request):
            return
        try:
            events = self._answering.handler.consider(command).events
        except Rejected:
            return  # and the command itself will be refused, in its own words
        names = [e.config.name for e in events if isinstance(e, RobotAdded | RobotReconfigured)]
        kept = {
            name: given if isinstance(given, str) else given[name]
            for name in names
            if isinstance(given, str) or name in given
        }
        if kept:
            await self._keep_secrets(command.scene, kept)

    async def create_auto_batch(self, request: Request, body: CreateRobotBatchReq) -> Response:
        """Add a number of robots alike; a name that is taken refuses the whole call."""
        command = body.command(self._answering.asked(request), scene_id(request))
        await self._keep(request, command, body.secret())
        return await self._answering.answer(request, command, nothing)

    async def update(self, request: Request, body: SceneRobot) -> Response:
        """Set up anew the robot named in the body; what is absent is at its default again.

        Group and number of bins cannot change while the robot has orders.
        """
        asked = self._answering.asked(request)
        command = ReconfigureRobot(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene_id(request),
            config=body.robot(),
        )
        await self._keep(request, command, body.secret())
        return await self._answering.answer(request, command, nothing)

    async def update_batch(self, request: Request, body: UpdateRobotConfigBatchReq) -> Response:
        """Change the set-up of robots, each on its own; null leaves a value as it is."""
        asked = self._answering.asked(request)
        command = ReconfigureRobots(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene_id(request),
            robots=body.names(),
            patch=body.config.patch(),
        )
        await self._keep(request, command, body.config.secret())
        return await self._answering.answer(
            request, command, lambda decision: parallel_results(body.robotNames, decision)
        )

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
