"""M4's questions about robots over HTTP: all of a scene, where one is, what maps it has (§4)."""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from ledger.errors import Refused
from ledger.ids import robot_key
from ledger.link import Report
from ledger.scene import Scene
from ledger.state import Fleet, Robot
from projections.api.answers import ROBOTS_AGE_S_MAX, answered, moment, sharing
from projections.api.m4_answers import RobotMapNameMd5, RobotPoint, UiRobotReport
from projections.api.m4_models import AsOf, RobotAsked, RobotsAsked
from projections.api.m4_robots import rounded, ui_report
from projections.api.m4_scene_query import SceneQueries
from projections.api.m4_scenes import scene_asked
from projections.api.m4_seen import robot_asked
from projections.fields import Row
from projections.poses import carried

_IN_PATH = [
    {
        "name": name,
        "in": "path",
        "required": True,
        "schema": {"type": "string"},
        "description": words,
    }
    for name, words in (("sceneId", "Id of the scene."), ("robotName", "Name of the robot."))
]


def robot_routes(made: APIRouter, queries: SceneQueries) -> None:
    """Add the calls."""
    find = queries.find

    @made.get("/api/fleet/robots/all-all", response_model=dict[str, UiRobotReport])
    async def all_robots(request: Request, query: Annotated[RobotsAsked, Query()]) -> Response:
        """Give all robots of a scene but disabled ones, all of one moment, which `rTime` says."""
        at_ms = moment(request, query)

        async def fresh() -> Response:
            fleet = await find.fleet(at_ms)
            scene = scene_asked(fleet, query.scene_id, query.scene_name)
            robots = await queries.seen(fleet, scene, at_ms)
            rows = {seen.robot.name: ui_report(seen, raw=query.raw_all) for seen in robots}
            return answered(rows, fleet.position)

        return await sharing(queries.shared, request, ROBOTS_AGE_S_MAX, fresh)

    @made.get("/api/fleet/robots/query-point", response_model=RobotPoint)
    async def point(request: Request, query: Annotated[RobotAsked, Query()]) -> Response:
        """Give where a robot is now, by its newest report."""
        at_ms = moment(request, query)
        fleet = await find.fleet(at_ms)
        scene = scene_asked(fleet, query.scene_id, None)
        robot = robot_asked(fleet, scene, query.robot_name)
        report = await _report(queries, scene, robot, at_ms)
        if report is None:
            words = f"Field 'robotName': '{robot.name}' has never reported where it is."
            raise Refused("errRobotNeverReported", words, robot.name)
        return answered(robot_point(report), fleet.position)

    @made.get(
        "/api/fleet/robots/{sceneId}/maps/{robotName}",
        response_model=list[RobotMapNameMd5],
        openapi_extra={"parameters": _IN_PATH},
    )
    async def maps(request: Request, query: Annotated[AsOf, Query()]) -> Response:
        """Give all maps of the scene that a robot may use."""
        at_ms = moment(request, query)
        fleet: Fleet = await find.fleet(at_ms)
        scene = scene_asked(fleet, request.path_params["sceneId"], None)
        robot = robot_asked(fleet, scene, request.path_params["robotName"])
        report = await _report(queries, scene, robot, at_ms)
        return answered(robot_maps(scene, report), fleet.position)


async def _report(
    queries: SceneQueries, scene: Scene, robot: Robot, at_ms: int | None
) -> Report | None:
    """Give what the robot said last, brought to a past moment if that is asked."""
    if at_ms is None:
        return queries.find.live.reports.get(robot_key(scene.id, robot.name))
    report = (await queries.reports(scene.id, at_ms)).get(robot.name)
    return carried(report, at_ms) if report is not None and robot.online else report


def robot_point(report: Report) -> Row:
    """Give the RobotPoint; between points the name is null."""
    return {
        "pointName": report.point,
        "direction": rounded(report.heading_rad, 1e4),
        "x": rounded(report.x_m, 1e3),
        "y": rounded(report.y_m, 1e3),
    }


def robot_maps(scene: Scene, report: Report | None) -> list[Row]:
    """Give the maps of the areas in use; the robot is on the one whose name it reports."""
    current = report.map_name if report is not None else None
    return [
        {
            "mapName": area.map_name,
            "mapMd5": area.map_digest,
            "current": area.map_name == current,
        }
        for area in scene.areas
        if not area.disabled
    ]
