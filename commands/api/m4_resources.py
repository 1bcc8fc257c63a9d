"""The M4 calls by which others reserve ground (spec/m4.md §7)."""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from enum import StrEnum
from typing import Annotated

import msgspec
from fastapi import APIRouter
from pydantic import BaseModel, Field, RootModel
from starlette.requests import Request
from starlette.responses import Response

from commands.api.answering import KEY_PARAMETER, Answering, Asked, nothing
from commands.api.m4_models import Int, Remark, Text, Wire
from commands.command import Decision
from commands.resource_target import Target
from commands.resources import (
    CORNERS_MAX,
    CORNERS_MIN,
    PLACES_MAX,
    UNITS_MAX,
    ZONES_MAX,
    LapseMapResources,
    ReleaseAllMapResources,
    ReleaseMapResources,
    ReleaseOwnedMapResources,
    RequestMapResources,
    UnitAsked,
    has_all,
)
from ledger.ids import UnitId

OF_RESOURCES = "/api/fleet/external-map-res"
FAR_M = 1e6  # no scene is larger
RELEASED_MAX = 10_000  # units in one call

# Waits until all of these are granted; False = not in time, or not any more.
Watch = Callable[[Sequence[UnitId]], Awaitable[bool]]
Metres = Annotated[float, Field(ge=-FAR_M, le=FAR_M, allow_inf_nan=False)]


class PolygonShape(StrEnum):
    """What a client says of a polygon; its vertices alone count."""

    OTHER = "Other"
    RECT = "Rect"
    CONCAVE = "Concave"


class Point2D(Wire):
    """A vertex."""

    x: Metres = Field(description="Metres, in the scene's frame.")
    y: Metres = Field(description="Metres, in the scene's frame.")


class Polygon(Wire):
    """A piece of ground."""

    points: Annotated[list[Point2D], Field(min_length=CORNERS_MIN, max_length=CORNERS_MAX)] = Field(
        description="Vertices in order; the outline must not cross itself."
    )
    type: PolygonShape = Field(description="Kind of polygon.")

    def ring(self) -> tuple[tuple[float, float], ...]:
        """Give the vertices; one that closes the ring says nothing new."""
        ring = tuple((point.x, point.y) for point in self.points)
        return ring[:-1] if len(ring) > CORNERS_MIN and ring[0] == ring[-1] else ring


class OfArea(Wire):
    """Where resources are. An empty text is an absent one."""

    sceneId: Text | None = Field(None, description="Scene; absent: found by `sceneName`.")
    sceneName: Text | None = Field(None, description="Name of the scene, if `sceneId` is absent.")
    areaId: Int | None = Field(None, description="Area of the scene; absent: by `areaName`.")
    areaName: Text | None = Field(None, description="Name of the area, if `areaId` is absent.")

    def target(self) -> Target:
        """Translate."""
        return Target(
            scene_id=self.sceneId or None,
            scene_name=self.sceneName or None,
            area_id=self.areaId,
            area_name=self.areaName or None,
        )


class MapResourceUnit(OfArea):
    """Ground that is applied for."""

    unitId: Text = Field(description="Id of this unit, unique for each application, e.g. a UUID.")
    owner: Text | None = Field(
        None, description="Required: name of a robot, which may go there, or of another system."
    )
    reason: Remark | None = Field(" ", description="Why it is applied for.")
    pointNames: Annotated[list[Text], Field(max_length=PLACES_MAX)] | None = Field(
        None, description="Points; 0.05 m to each side of them are reserved."
    )
    pathKeys: Annotated[list[Text], Field(max_length=PLACES_MAX)] | None = Field(
        None, description="Paths like `AP33->LM32`; what is within 0.05 m of them is reserved."
    )
    spatialZones: Annotated[list[Polygon], Field(max_length=ZONES_MAX)] | None = Field(
        None, description="Polygons to reserve."
    )

    def unit(self) -> UnitAsked:
        """Translate."""
        return UnitAsked(
            id=self.unitId,
            owner=self.owner or "",
            reason=self.reason or " ",
            target=self.target(),
            points=tuple(self.pointNames or ()),
            paths=tuple(self.pathKeys or ()),
            zones=tuple(zone.ring() for zone in self.spatialZones or ()),
        )


class MapResourceUnits(RootModel[list[MapResourceUnit]]):
    """One application: units of one owner in one area."""

    root: Annotated[list[MapResourceUnit], Field(max_length=UNITS_MAX)]


class UnitIds(RootModel[list[str]]):
    """Units to release."""

    root: Annotated[list[Text], Field(max_length=RELEASED_MAX)]


class ReleaseByOwnerReq(OfArea):
    """Whose resources to release, and where."""

    owner: Text | None = Field(None, description="Required: owner named in the application.")


class MapResourceReply(BaseModel):
    """What became of an application."""

    ok: bool = Field(description="True = granted; false = the ground did not become free in time.")


class ResourceCalls:
    """Endpoints that translate, ask, and word the answer."""

    def __init__(self, answering: Answering, watch: Watch) -> None:
        """Take who answers, and how to wait for what is granted."""
        self._answering = answering
        self._watch = watch
        self._waited_for: Counter[UnitId] = Counter()  # by calls under way

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        for name, endpoint, model in (
            ("request", self.request, MapResourceReply),
            ("release", self.release, None),
            ("release-by-owner", self.release_by_owner, None),
            ("release-all", self.release_all, None),
        ):
            router.add_api_route(
                f"{OF_RESOURCES}/{name}",
                endpoint,
                methods=["POST"],
                response_model=model,
                openapi_extra={"parameters": [KEY_PARAMETER]},
                tags=["external map resources"],
            )

    async def request(self, request: Request, body: MapResourceUnits) -> Response:
        """Reserve points, paths and polygons of one area for one owner; all of them, or none.

        Robots under way leave the ground first, so this may take up to 5 s. Asking again for what
        one has succeeds again. Whoever applies must release.
        """
        asked = self._answering.asked(request)
        units = tuple(unit.unit() for unit in body.root)
        command = RequestMapResources(id=asked.id, by=asked.by, at_ms=asked.at_ms, units=units)
        owner = units[0].owner if units else ""
        ids = tuple(dict.fromkeys(UnitId(unit.id) for unit in units))

        async def later(_: Decision) -> bytes:
            ok = await self._granted(request, asked, owner, ids)
            return msgspec.json.encode({"ok": ok})

        return await self._answering.answer_later(request, command, later, _lapse(asked, owner, ()))

    async def _granted(
        self, request: Request, asked: Asked, owner: str, ids: tuple[UnitId, ...]
    ) -> bool:
        """Wait for the ground; who has waited last in vain gives up what was asked for."""
        handler = self._answering.handler
        if has_all(handler.fleet, owner, ids):
            return True
        self._waited_for.update(ids)
        try:
            await _first_of(self._watch(ids), _hung_up(request))
        finally:
            self._waited_for.subtract(ids)
            alone = tuple(id_ for id_ in ids if not self._waited_for[id_])
            self._waited_for = +self._waited_for
            if not has_all(handler.fleet, owner, ids):
                now = msgspec.structs.replace(_lapse(asked, owner, alone), at_ms=handler.now_ms())
                handler.handle(now)  # decided on the newest state: a grant in between stays
        return has_all(handler.fleet, owner, ids)

    async def release(self, request: Request, body: UnitIds) -> Response:
        """Release units by their ids; those that nobody holds are passed over."""
        asked = self._answering.asked(request)
        units = tuple(UnitId(unit) for unit in body.root)
        command = ReleaseMapResources(id=asked.id, by=asked.by, at_ms=asked.at_ms, units=units)
        return await self._answering.answer(request, command, nothing)

    async def release_by_owner(self, request: Request, body: ReleaseByOwnerReq) -> Response:
        """Release what an owner holds, everywhere or in one scene or area."""
        asked = self._answering.asked(request)
        command = ReleaseOwnedMapResources(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            owner=body.owner or "",
            target=body.target(),
        )
        return await self._answering.answer(request, command, nothing)

    async def release_all(self, request: Request) -> Response:
        """Release everybody's resources. Use with care: it takes others' away, too."""
        asked = self._answering.asked(request)
        command = ReleaseAllMapResources(id=asked.id, by=asked.by, at_ms=asked.at_ms)
        return await self._answering.answer(request, command, nothing)


def _lapse(asked: Asked, owner: str, units: tuple[UnitId, ...]) -> LapseMapResources:
    return LapseMapResources(id=asked.id, by=asked.by, at_ms=asked.at_ms, owner=owner, units=units)


async def _hung_up(request: Request) -> None:
    """Wait until the client has gone."""
    while (await request.receive())["type"] != "http.disconnect":
        pass


async def _first_of(*waits: Awaitable[object]) -> None:
    """Wait for one, and leave the others off."""
    tasks = [asyncio.ensure_future(wait) for wait in waits]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
