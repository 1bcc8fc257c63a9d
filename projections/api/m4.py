"""M4's questions over HTTP: find/*, order detail, robots, scenes (spec/m4.md §2-§6)."""

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.routing import APIRoute
from starlette.requests import Request
from starlette.responses import Response

from ledger.errors import Refused
from ledger.ids import OrderId
from projections.api.answers import ROBOTS_AGE_S_MAX, answered, moment, sharing
from projections.api.m4_answers import OrderDetail
from projections.api.m4_devices import device_routes
from projections.api.m4_entities import entity_routes
from projections.api.m4_models import AsOf, DetailAsked, SceneDataAsked
from projections.api.m4_orders import detail
from projections.api.m4_robot_questions import robot_routes
from projections.api.m4_scene_answers import SceneReply
from projections.api.m4_scene_query import FIELDS, SceneQueries
from projections.api.m4_scene_questions import scene_routes
from projections.fields import Row
from projections.find import At, Find


def router(queries: SceneQueries, route_class: type[APIRoute]) -> APIRouter:
    """Give the routes. `request.state.user` must hold the caller's name."""
    made = APIRouter(route_class=route_class, tags=["m4"])
    entity_routes(made, queries)
    _order_detail(made, queries.find)
    robot_routes(made, queries)
    scene_routes(made, queries)
    device_routes(made, queries)
    _scene_query(made, queries)
    return made


def _order_detail(made: APIRouter, find: Find) -> None:
    @made.get("/api/fleet/orders/query-order-detail", response_model=OrderDetail)
    async def order_detail(request: Request, query: Annotated[DetailAsked, Query()]) -> Response:
        """Give an order with its steps, and why it is not assigned or does not get on."""
        return answered(*await detail_of(find, query.order_id, moment(request, query)))


async def detail_of(find: Find, order_id: str, at_ms: At | None) -> tuple[Row, int]:
    """Give the OrderDetail of an order, and the position at which it is so."""
    order, position = await find.order(OrderId(order_id), at_ms)
    if order is None:
        words = f"Field 'orderId': there is no order '{order_id}'."
        raise Refused("errOrderNotFound", words, order_id)
    fleet = await find.fleet(at_ms)
    return detail(order, fleet.scenes[order.scene].name), position


def _scene_query(made: APIRouter, queries: SceneQueries) -> None:
    of_scene = {
        "name": "sceneId",
        "in": "path",
        "required": True,
        "schema": {"type": "string"},
        "description": "Id of the scene.",
    }

    @made.post(
        "/api/fleet/scenes/{sceneId}/query-all",
        response_model=SceneReply,
        openapi_extra={"parameters": [of_scene]},
    )
    async def query_all(
        request: Request, query: Annotated[AsOf, Query()], body: SceneDataAsked
    ) -> Response:
        """Give all that moves in a scene, as `Fleet::Scene` does over WebSocket."""
        at_ms = moment(request, query, body)
        scene = request.path_params["sceneId"]

        async def fresh() -> Response:
            return answered(*await queries.answer(scene, body, at_ms, FIELDS))

        return await sharing(queries.shared, request, ROBOTS_AGE_S_MAX, fresh)
