"""One application of all dialects: routes, documentation, errors, metrics, the gate around it."""

from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from fastapi import APIRouter
from fastapi_offline import FastAPIOffline
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp

from fleetledger.access.callers import Callers
from fleetledger.access.roles import Policy
from fleetledger.durability import Then
from fleetledger.http import FastLane, ThinRoute, install_errors
from fleetledger.middleware import Gate, Refusing
from fleetledger.openapi import completed, operation_id

TITLE = "Fleetledger"
DESCRIPTION = """Dispatches fleets of mobile robots and never forgets.

What a command's answer acknowledges is on disk, and so is all that a query shows.
Every answer carries `X-Ledger-Position`; a query with `X-Wait-Position` answers not before that
position is readable. Commands take an `Idempotency-Key`; queries take `asOf`, a past moment.
"""


def build(
    routers: Sequence[APIRouter],
    *,
    callers: Callers,
    refused: Refusing,
    position: Callable[[], int],
    wait: Callable[[int], Awaitable[bool]],
    when: Callable[[int, Then], None],
) -> ASGIApp:
    """Put the dialects' routes together; `callers` tells who calls, `refused` hears of refusals.

    Gate and fast lane stand before FastAPI, whose own middleware would cost every call.
    """
    app = FastAPIOffline(
        title=TITLE,
        description=DESCRIPTION,
        version="0.1.0",
        redoc_url=None,
        generate_unique_id_function=operation_id,
    )
    install_errors(app)
    routers = (_own(), *routers)
    policy = Policy([*app.routes, *(route for router in routers for route in router.routes)])
    for router in routers:
        app.include_router(router)
    plain = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = completed(plain())
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign] # FastAPI's documented way
    lane = FastLane(app, routers)
    return Gate(
        lane,
        callers=callers,
        policy=policy,
        refused=refused,
        position=position,
        wait=wait,
        quick=lane.quick,
        when=when,
    )


def _own() -> APIRouter:
    router = APIRouter(route_class=ThinRoute, tags=["server"])

    @router.get("/metrics", response_class=PlainTextResponse)
    async def metrics(request: Request) -> Response:
        """Figures for Prometheus."""
        return Response(generate_latest(), media_type=CONTENT_TYPE_LATEST)

    return router
