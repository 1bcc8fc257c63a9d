"""The read side as the front door serves it to anybody, in process."""

from fastapi import APIRouter
from starlette.types import ASGIApp

from commands.api.m4_scene_config import wire
from fleetledger.access.callers import Anybody
from fleetledger.api import build
from projections.api.m4_resources import external_map_res
from projections.api.m4_scene_query import Beside, PlansAt, ReportsAt, SceneQueries
from projections.devices import door_reports, lift_reports
from tests.projections.past import Side


def asked_of(
    side: Side,
    reports_at: ReportsAt = lambda scene, at_ms: {},
    plans_at: PlansAt = lambda scene, at_ms: {},
) -> SceneQueries:
    beside = Beside(
        config=wire,
        doors=door_reports,
        lifts=lift_reports,
        map_resources=external_map_res,
    )
    return SceneQueries(side.find, reports_at, plans_at, beside)


def application(side: Side, *routers: APIRouter) -> ASGIApp:
    return build(
        routers,
        callers=Anybody(),
        refused=lambda caller, address, call, code: None,
        position=lambda: side.live.position,
        wait=side.live.wait,
        when=lambda position, then: then(None),
    )
