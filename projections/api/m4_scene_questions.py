"""Questions about scenes over HTTP: the list, maps, how one is set up, and if it is ready.

Readings where the source is silent (spec/protocols.md 1.6):
- a scene is ready when it is in service, has a map, and traffic has placed the enabled robots that
  answer;
- `list-points-bins` names what orders may name: places of areas that are in use;
- move costs of a place that does not exist, lies in another area or cannot be reached are -1, for
  the reply has a word for that and one place must not spoil the rest; an unknown robot is refused;
- a robot that is on no path, or has never reported, reaches nothing.
"""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from ledger.errors import Refused
from ledger.ids import PointName, robot_key
from ledger.link import Report
from ledger.scene import Area, Door, Scene
from ledger.state import Fleet
from projections.api.answers import JSON, answered, moment
from projections.api.m4_models import AsOf, MoveCostsAsked
from projections.api.m4_robots import bin_points
from projections.api.m4_scene_answers import PointsAndBins, SceneListed, SceneMap, SceneSchema
from projections.api.m4_scene_query import PlansOfRobots, SceneQueries
from projections.api.m4_scene_schema import schema
from projections.api.m4_scenes import scene_asked, scene_list, scene_map
from projections.api.m4_seen import robot_asked
from projections.distances import Network

COSTS_MAX = 20_000  # places in one question about move costs
OUT_OF_REACH = -1
NETWORKS_KEPT = 16

_SCENE = {
    "name": "id",
    "in": "path",
    "required": True,
    "schema": {"type": "string"},
    "description": "Id of the scene.",
}
_OF_SCENE = {"parameters": [_SCENE]}
OF_SCENE = "/api/fleet/scenes/{id}"


def scene_routes(made: APIRouter, queries: SceneQueries) -> None:
    """Add the calls."""
    find = queries.find

    @made.get("/api/fleet/scenes/list", response_model=list[SceneListed])
    async def scenes(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """List the scenes by display order, then name; removed ones are absent."""
        fleet = await find.fleet(moment(request, query))
        return answered(scene_list(fleet), fleet.position)

    @made.get("/api/fleet/scenes/schema/{id}", response_model=SceneSchema, openapi_extra=_OF_SCENE)
    async def schema_(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """Give how a scene is set up: settings, groups, robots, areas, doors, lifts."""
        fleet = await find.fleet(moment(request, query))
        scene = _asked(fleet, request)
        return answered(schema(fleet, scene, queries.beside.config), fleet.position)

    @made.get(f"{OF_SCENE}/map", response_model=SceneMap, openapi_extra=_OF_SCENE)
    async def drawing(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """Give points, paths, bins and areas of a scene, for drawing."""
        fleet = await find.fleet(moment(request, query))
        headers = {"X-Ledger-Position": str(fleet.position)}
        return Response(scene_map(_asked(fleet, request)), media_type=JSON, headers=headers)

    @made.get(f"{OF_SCENE}/ready-status", response_model=bool, openapi_extra=_OF_SCENE)
    async def ready_status(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """Tell whether the scene is in service and traffic has placed the robots that answer."""
        at_ms = moment(request, query)
        fleet = await find.fleet(at_ms)
        scene = _asked(fleet, request)
        plans = await queries.plans(fleet, scene, at_ms)
        return answered(is_ready(scene, plans), fleet.position)

    @made.get(f"{OF_SCENE}/list-points-bins", response_model=PointsAndBins, openapi_extra=_OF_SCENE)
    async def points_bins(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """Name the points and bins that orders may name."""
        fleet = await find.fleet(moment(request, query))
        areas = [area for area in _asked(fleet, request).areas if not area.disabled]
        names = {
            "points": [point.name for area in areas for point in area.points],
            "bins": [bin_.name for area in areas for bin_ in area.bins],
        }
        return answered(names, fleet.position)

    @made.post(
        f"{OF_SCENE}/calc-move-costs",
        response_model=dict[str, dict[str, float]],
        openapi_extra=_OF_SCENE,
    )
    async def move_costs(
        request: Request, query: Annotated[AsOf, Query()], body: MoveCostsAsked
    ) -> Response:
        """Give how far robots are from points and bins, in metres; -1 = out of reach."""
        asked = body.root
        number = sum(map(len, asked.values()))
        if number > COSTS_MAX:
            words = f"{number} places are asked for, at most {COSTS_MAX} are allowed in one call."
            raise Refused("errTooMany", words, COSTS_MAX)
        at_ms = moment(request, query)
        fleet = await find.fleet(at_ms)
        scene = _asked(fleet, request)
        reports = await _reports(queries, fleet, scene, asked, at_ms)
        position = fleet.position
        costs = await find.beside(lambda: _costs(scene, asked, reports))
        return answered(costs, position)


def _asked(fleet: Fleet, request: Request) -> Scene:
    return scene_asked(fleet, request.path_params["id"], None)


def is_ready(scene: Scene, plans: PlansOfRobots) -> bool:
    """Tell whether orders get going in a scene, by the plans of its enabled robots."""
    if scene.disabled or not scene.areas:
        return False
    return all(plan is not None and plan.ready for robot, plan in plans if robot.online)


async def _reports(
    queries: SceneQueries,
    fleet: Fleet,
    scene: Scene,
    asked: dict[str, list[str]],
    at_ms: int | None,
) -> dict[str, Report | None]:
    robots = [robot_asked(fleet, scene, name) for name in asked]
    if at_ms is not None:
        then = await queries.reports(scene.id, at_ms)
        return {robot.name: then.get(robot.name) for robot in robots}
    now = queries.find.live.reports
    return {robot.name: now.get(robot_key(scene.id, robot.name)) for robot in robots}


def _costs(
    scene: Scene, asked: dict[str, list[str]], reports: dict[str, Report | None]
) -> dict[str, dict[str, float]]:
    """Do the work, on another thread."""
    areas = {area.id: area for area in scene.areas if not area.disabled}
    points = bin_points(scene)
    costs: dict[str, dict[str, float]] = {}
    for name, places in asked.items():
        report = reports[name]
        area = areas.get(report.area) if report is not None else None
        if report is None or area is None:
            costs[name] = dict.fromkeys(places, OUT_OF_REACH)
            continue
        network = network_of(area, scene.doors)
        starts = _starts(network, report, scene.config.path_distance_m)
        targets = [PointName(points.get(place, place)) for place in places]
        found = network.distances_m(starts, targets)
        costs[name] = {
            place: OUT_OF_REACH if metres is None else round(metres, 3)
            for place, metres in zip(places, found, strict=True)
        }
    return costs


def _starts(network: Network, report: Report, reach_m: float) -> dict[PointName, float]:
    if report.point is not None and report.point in network.index:
        return {report.point: 0.0}
    return network.starts(report.x_m, report.y_m, reach_m)


# maps are constants that take a tenth of a second to prepare: kept by identity, so never stale
_networks: dict[tuple[int, int], tuple[Area, tuple[Door, ...], Network]] = {}


def network_of(area: Area, doors: tuple[Door, ...]) -> Network:
    """Give the paths that robots may drive: what a door out of service closes is left out."""
    key = (id(area), id(doors))
    kept = _networks.get(key)
    if kept is not None and kept[0] is area and kept[1] is doors:
        return kept[2]
    shut = [door for door in doors if door.disabled and door.area == area.id]
    network = Network(area, {name for door in shut for name in (*door.paths, *door.points)})
    while len(_networks) >= NETWORKS_KEPT:
        _networks.pop(next(iter(_networks)), None)
    _networks[key] = (area, doors, network)
    return network
