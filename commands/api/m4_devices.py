"""The M4 calls for doors and lifts (spec/protocols.md §1.6)."""

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import Field
from starlette.requests import Request
from starlette.responses import Response

from commands.api.answering import KEY_PARAMETER, Answering, nothing
from commands.api.m4_models import Int, ParallelResult, Remark, Text, Wire, parallel_results
from commands.decide import DeviceCommand
from commands.devices import (
    DOORS_MAX,
    CloseDoors,
    KeepDoorsOpen,
    KeepLiftOpen,
    LetLiftGo,
    OpenDoors,
)
from ledger.ids import SceneId

OF_DEVICES = "/api/fleet/devices"


class DoorsReq(Wire):
    """Doors of a scene."""

    sceneId: Text = Field(description="Scene id.")
    ids: Annotated[list[Int], Field(max_length=DOORS_MAX)] = Field(description="Door ids.")
    remark: Remark | None = Field(None, description="Why; kept in the ledger.")

    def names(self) -> list[str]:
        """Give the ids as the answer names them."""
        return [str(id_) for id_ in dict.fromkeys(self.ids)]


class KeepDoorsOpenReq(DoorsReq):
    """Doors of a scene that are to stay open, or need not any more."""

    keepOpen: bool | None = Field(
        True, description="True = keep them open, false = let them go; absent means true."
    )


class LiftReq(Wire):
    """A lift of a scene."""

    sceneId: Text = Field(description="Scene id.")
    liftId: Int = Field(description="Lift id.")
    remark: Remark | None = Field(None, description="Why; kept in the ledger.")


class KeepLiftOpenReq(LiftReq):
    """A lift that is to go to an area and stay open there."""

    toAreaId: Int = Field(description="Id of the area at which it is to be open.")


class DeviceCalls:
    """Endpoints that translate, ask, and word the answer."""

    def __init__(self, answering: Answering) -> None:
        """Take who answers."""
        self._answering = answering

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        of_each: dict[str, Any] = {"response_model": dict[str, ParallelResult]}
        for path, endpoint, more in (
            ("/doors/open-batch", self.open_doors, of_each),
            ("/doors/close-batch", self.close_doors, of_each),
            ("/doors/keep-open", self.keep_doors_open, of_each),
            ("/lifts/keep-open", self.keep_lift_open, {}),
            ("/lifts/cancel-open", self.let_lift_go, {}),
        ):
            router.add_api_route(
                f"{OF_DEVICES}{path}",
                endpoint,
                methods=["POST"],
                openapi_extra={"parameters": [KEY_PARAMETER]},
                tags=["devices"],
                **more,
            )

    async def _told(
        self, request: Request, kind: Callable[..., DeviceCommand], body: DoorsReq, **fields: bool
    ) -> Response:
        command = kind(
            **self._answering.asked(request)._asdict(),
            scene=SceneId(body.sceneId),
            doors=tuple(body.ids),
            remark=body.remark or "",
            **fields,
        )
        return await self._answering.answer(
            request, command, lambda decision: parallel_results(body.names(), decision)
        )

    async def open_doors(self, request: Request, body: DoorsReq) -> Response:
        """Have doors open once, each on its own; about 10 s later they may close by themselves."""
        return await self._told(request, OpenDoors, body)

    async def close_doors(self, request: Request, body: DoorsReq) -> Response:
        """Have doors close, also those kept open, each on its own; not on a robot that passes."""
        return await self._told(request, CloseDoors, body)

    async def keep_doors_open(self, request: Request, body: KeepDoorsOpenReq) -> Response:
        """Keep doors open until they are let go, or let them go; each on its own."""
        return await self._told(request, KeepDoorsOpen, body, keep_open=body.keepOpen is not False)

    async def keep_lift_open(self, request: Request, body: KeepLiftOpenReq) -> Response:
        """Send a lift to an area and keep its doors open there until it is let go."""
        asked = self._answering.asked(request)
        command = KeepLiftOpen(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=SceneId(body.sceneId),
            lift=body.liftId,
            area=body.toAreaId,
            remark=body.remark or "",
        )
        return await self._answering.answer(request, command, nothing)

    async def let_lift_go(self, request: Request, body: LiftReq) -> Response:
        """Let a lift go its own ways; nothing happens to one that nobody keeps open."""
        asked = self._answering.asked(request)
        command = LetLiftGo(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=SceneId(body.sceneId),
            lift=body.liftId,
            remark=body.remark or "",
        )
        return await self._answering.answer(request, command, nothing)
