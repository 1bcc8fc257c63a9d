"""M4's questions over HTTP: find/*, order detail, robots, scenes (spec/m4.md §2-§4)."""

from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from typing import Annotated, Any, TypeAlias

import msgspec
from fastapi import APIRouter, Query
from fastapi.routing import APIRoute
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from ledger.errors import Refused
from ledger.ids import OrderId, RobotName, SceneId, robot_key
from ledger.link import Plan, Report
from ledger.moment import parse_time
from ledger.scene import Group, Scene
from ledger.state import Fleet
from projections.api.m4_models import (
    AsOf,
    CountAsked,
    DetailAsked,
    ManyAsked,
    OneAsked,
    PageAsked,
    RobotsAsked,
    RowsAsked,
)
from projections.api.m4_orders import detail
from projections.api.m4_robots import Seen, bin_points, ui_report
from projections.api.m4_scenes import scene_asked, scene_list, scene_map
from projections.fields import SHOWN, Field, Row
from projections.find import ROWS_MAX, SKIP_MAX, Asked, Find
from projections.poses import at_instant, carried, common_instant
from projections.query import Asker, Condition, How, Test, field_named, parse
from projections.reading import CHUNK_ROWS
from projections.sorting import parse_sort

ENTITIES = ("TransportOrder",)
JSON = "application/json"

ReportsAt: TypeAlias = Callable[[SceneId, int], Mapping[RobotName, Report]]
PlansAt: TypeAlias = Callable[[SceneId, int], Mapping[RobotName, Plan]]


def router(
    find: Find,
    reports_at: ReportsAt,
    route_class: type[APIRoute],
    plans_at: PlansAt = lambda scene, at_ms: {},
) -> APIRouter:
    """Give the routes. `request.state.user` must hold the caller's name.

    What robots reported and traffic intended in the past comes from the two functions, which are
    slow and called in a thread.
    """
    made = APIRouter(route_class=route_class, tags=["m4"])
    _entities(made, find)
    _order_detail(made, find)
    _robots(made, find, reports_at, plans_at)
    _scenes(made, find)
    return made


def _entities(made: APIRouter, find: Find) -> None:
    @made.post("/api/entity/find/many")
    async def many(request: Request, query: Annotated[AsOf, Query()], body: ManyAsked) -> Response:
        """Give all orders that meet the query, as a bare array; without steps."""
        asked, at_ms = _asked(request, body, find), _moment(request, query, body)
        skip, limit = _skip(body.skip), _limit(body.limit)
        if limit is None or limit > CHUNK_ROWS:
            probe = await find.some(asked, skip, CHUNK_ROWS + 1, at_ms)
            if probe.total > CHUNK_ROWS:
                position, chunks = await find.every(asked, skip, limit, at_ms)
                headers = {"X-Ledger-Position": str(position)}
                return StreamingResponse(_array(chunks), media_type=JSON, headers=headers)
        else:
            probe = await find.some(asked, skip, limit, at_ms)
        return _json(probe.rows, probe.position)

    @made.post("/api/entity/find/page")
    async def page(request: Request, query: Annotated[AsOf, Query()], body: PageAsked) -> Response:
        """Give one page of the orders that meet the query, and how many there are."""
        asked, at_ms = _asked(request, body, find), _moment(request, query, body)
        skip = _skip((body.page_no - 1) * body.page_size)
        found = await find.page(asked, skip, body.page_size, at_ms)
        answer = {
            "pageNo": body.page_no,
            "pageSize": body.page_size,
            "total": found.total,
            "page": found.rows,
        }
        return _json(answer, found.position)

    @made.post("/api/entity/find/one")
    async def one(request: Request, query: Annotated[AsOf, Query()], body: OneAsked) -> Response:
        """Give the order with this id, or the first that meets the query; null if none does."""
        asked, at_ms = _asked(request, body, find), _moment(request, query, body)
        if body.id is not None:
            by_id = Test(field=field_named("id", "id"), how=How.EQUAL, value=body.id)
            asked = msgspec.structs.replace(asked, condition=by_id)
        found = await find.some(asked, _skip(body.skip), 1, at_ms)
        value = found.rows[0] if found.rows else None
        return _json({"entityValue": value}, found.position)

    @made.post("/api/entity/find/count")
    async def count(
        request: Request, query: Annotated[AsOf, Query()], body: CountAsked
    ) -> Response:
        """Count the orders that meet the query."""
        asked = Asked(condition=_condition(request, body, find), fuzzy=body.fuzzy)
        number, position = await find.count(asked, _moment(request, query, body))
        return _json({"count": number}, position)


def _order_detail(made: APIRouter, find: Find) -> None:
    @made.get("/api/fleet/orders/query-order-detail")
    async def order_detail(request: Request, query: Annotated[DetailAsked, Query()]) -> Response:
        """Give an order with its steps, and why it is not assigned or does not get on."""
        order, position = await find.order(OrderId(query.order_id), _moment(request, query, None))
        if order is None:
            words = f"Field 'orderId': there is no order '{query.order_id}'."
            raise Refused("errOrderNotFound", words, query.order_id)
        return _json(detail(order, find.live.fleet.scenes[order.scene].name), position)


def _robots(made: APIRouter, find: Find, reports_at: ReportsAt, plans_at: PlansAt) -> None:
    @made.get("/api/fleet/robots/all-all")
    async def all_robots(request: Request, query: Annotated[RobotsAsked, Query()]) -> Response:
        """Give all robots of a scene but disabled ones, all of one moment, which `rTime` says."""
        at_ms = _moment(request, query, None)
        fleet = await find.fleet(at_ms)
        scene = scene_asked(fleet, query.scene_id, query.scene_name)
        if at_ms is None:
            seen = _seen_now(find, scene)
        else:
            then = at_ms
            reports, plans = await find.beside(
                lambda: (reports_at(scene.id, then), plans_at(scene.id, then))
            )
            seen = _seen_then(fleet, scene, reports, plans, then)
        robots = {s.robot.name: ui_report(s, raw=query.raw_all) for s in seen}
        return _json(robots, fleet.position)


def _seen_now(find: Find, scene: Scene) -> Iterator[Seen]:
    """See the robots at the newest instant at which all who answer have reported."""
    live = find.live
    keys = {robot_key(r.scene, r.name): r for r in live.fleet.robots.values()}
    newest = [live.reports[k] for k, r in keys.items() if r.online and k in live.reports]
    instant_ms = common_instant(r for r in newest if r.scene == scene.id)
    groups, points = _groups(scene), bin_points(scene)
    for key, robot in keys.items():
        if robot.scene != scene.id or robot.config.disabled:
            continue
        own = report = live.reports.get(key)
        if robot.online and report is not None and instant_ms is not None:
            report = at_instant(tuple(live.recent[key]), instant_ms)
        yield Seen(
            robot=robot,
            group=groups[robot.config.group],
            report=report,
            own=own,
            plan=live.plans.get(key),
            orders=live.fleet.orders,
            points=points,
        )


def _seen_then(
    fleet: Fleet,
    scene: Scene,
    reports: Mapping[RobotName, Report],
    plans: Mapping[RobotName, Plan],
    at_ms: int,
) -> Iterator[Seen]:
    groups, points = _groups(scene), bin_points(scene)
    for robot in fleet.robots.values():
        if robot.scene != scene.id or robot.config.disabled:
            continue
        own = report = reports.get(robot.name)
        if robot.online and report is not None:
            report = carried(report, at_ms)
        yield Seen(
            robot=robot,
            group=groups[robot.config.group],
            report=report,
            own=own,
            plan=plans.get(robot.name),
            orders=fleet.orders,
            points=points,
        )


def _groups(scene: Scene) -> dict[int, Group]:
    return {group.id: group for group in scene.groups}


def _scenes(made: APIRouter, find: Find) -> None:
    @made.get("/api/fleet/scenes/list")
    async def scenes(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """Give id, name and disabled of every scene."""
        fleet = await find.fleet(_moment(request, query, None))
        return _json(scene_list(fleet), fleet.position)

    parameter = {"name": "id", "in": "path", "required": True, "schema": {"type": "string"}}

    @made.get("/api/fleet/scenes/{id}/map", openapi_extra={"parameters": [parameter]})
    async def drawing(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """Give points, paths, bins and areas of a scene, for drawing."""
        fleet = await find.fleet(_moment(request, query, None))
        scene = scene_asked(fleet, request.path_params["id"], None)
        headers = {"X-Ledger-Position": str(fleet.position)}
        return Response(scene_map(scene), media_type=JSON, headers=headers)


def _asked(request: Request, body: RowsAsked, find: Find) -> Asked:
    return Asked(
        condition=_condition(request, body, find),
        fuzzy=body.fuzzy,
        fields=_projection(body.projection),
        sort=parse_sort(body.sort),
    )


def _condition(request: Request, body: CountAsked, find: Find) -> Condition:
    if body.entity_name not in ENTITIES:
        raise Refused(
            "errEntityUnknown",
            f"Field 'entityName': there is no entity '{body.entity_name[:100]}'; "
            f"there is {', '.join(ENTITIES)}.",
            body.entity_name[:100],
        )
    return parse(body.query, Asker(user=request.state.user, now_ms=find.now_ms()))


def _projection(names: list[str] | None) -> tuple[Field, ...]:
    if not names:
        return SHOWN
    fields = [field_named(name, f"projection[{n}]") for n, name in enumerate(names)]
    return tuple(dict.fromkeys(fields))


def _skip(skip: int | None) -> int:
    if skip is not None and skip > SKIP_MAX:
        raise Refused("errSkipTooLarge", f"At most {SKIP_MAX} rows can be skipped.", SKIP_MAX)
    return max(0, skip or 0)


def _limit(limit: int | None) -> int | None:
    if limit is not None and limit > ROWS_MAX:
        raise Refused("errLimitTooLarge", f"'limit' may be {ROWS_MAX}, or null.", ROWS_MAX)
    return None if limit is None or limit < 0 else limit


def _moment(request: Request, query: AsOf, body: CountAsked | None) -> int | None:
    """Read the past moment that is asked for, wherever it stands; None = now."""
    asked = query.as_of or (None if body is None else body.as_of) or request.headers.get("asOf")
    return None if asked is None else parse_time(str(asked))


def _json(body: object, position: int) -> Response:
    headers = {"X-Ledger-Position": str(position)}
    return Response(msgspec.json.encode(body), media_type=JSON, headers=headers)


async def _array(chunks: AsyncIterator[list[Row]]) -> AsyncIterator[bytes]:
    """Encode rows as one JSON array, chunk by chunk."""
    before: Any = b"["
    async for chunk in chunks:
        yield before + msgspec.json.encode(chunk)[1:-1]
        before = b","
    yield b"[]" if before == b"[" else b"]"
