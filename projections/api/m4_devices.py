"""The state of doors and lifts over HTTP (spec/protocols.md §1.6): maps by id.

Reading: the source names the calls only; what they answer is the part of the scene query that is
about doors, or lifts. What devices said in the past is not kept: of a past moment the answer is
what the ledger knew.
"""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from projections.api.answers import answered, moment
from projections.api.m4_models import AsOf
from projections.api.m4_scene_answers import UiDoorReport, UiLiftReport
from projections.api.m4_scene_query import SceneQueries
from projections.api.m4_scenes import scene_asked
from projections.devices import door_reports, lift_reports

_OF_SCENE = {
    "parameters": [
        {
            "name": "id",
            "in": "path",
            "required": True,
            "schema": {"type": "string"},
            "description": "Id of the scene.",
        }
    ]
}


def device_routes(made: APIRouter, queries: SceneQueries) -> None:
    """Add the calls."""
    find = queries.find

    @made.get(
        "/api/fleet/scenes/{id}/door",
        response_model=dict[str, UiDoorReport],
        openapi_extra=_OF_SCENE,
    )
    async def doors(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """Give the state of every door of a scene, by its id."""
        at_ms = moment(request, query)
        fleet = await find.fleet(at_ms)
        scene = scene_asked(fleet, request.path_params["id"], None)
        live = find.live if at_ms is None else None
        return answered(door_reports(live, fleet, scene), fleet.position)

    @made.get(
        "/api/fleet/scenes/{id}/lift",
        response_model=dict[str, UiLiftReport],
        openapi_extra=_OF_SCENE,
    )
    async def lifts(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """Give the state of every lift of a scene, by its id."""
        at_ms = moment(request, query)
        fleet = await find.fleet(at_ms)
        scene = scene_asked(fleet, request.path_params["id"], None)
        live = find.live if at_ms is None else None
        return answered(lift_reports(live, fleet, scene), fleet.position)
