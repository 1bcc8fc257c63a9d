"""HTTP of the past: the ledger as it is, the state at any moment, the console and its frames."""

import asyncio
from pathlib import Path
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Query
from fastapi.routing import APIRoute
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from ledger.errors import Refused
from ledger.events import AnyEvent
from ledger.ids import OrderId, SceneId
from ledger.moment import At, parse_position, parse_time
from ledger.state import Fleet
from replay.following import Followers
from replay.frame import Frame, MapFrame, Wish
from replay.frames import frame_at, map_at, story_at, waiting_at
from replay.source import Source
from replay.story import Story
from replay.waiting import Waiting

EVENTS_MAX = 10_000  # of one answer
OWN_PARTS = "x-parts"  # of a documented response: schemas that it refers to
ORDERS_MAX = 500  # of one frame
FIND_CHARACTERS_MAX = 100
CONSOLE = Path(__file__).parent / "console"
CONSOLE_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
# nothing from elsewhere, nothing inline, in nobody's frame
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", populate_by_name=True)


class EventsAsked(_Asked):
    """Which events."""

    after: int = Field(0, ge=0, description="Position behind which to begin.")
    limit: int = Field(1000, ge=1, le=EVENTS_MAX, description="Not for a stream, which goes on.")


class StateAsked(_Asked):
    """Which moment; neither = now."""

    at: str | None = Field(None, description="Epoch milliseconds or ISO 8601.")
    position: str | None = Field(None, description="Right after this event.")


class MapAsked(_Asked):
    """Which scene, and when."""

    scene: str | None = Field(None, alias="sceneId", description="Default: the first scene.")
    as_of: str | None = Field(None, alias="asOf", description="A past moment; default: now.")


class FrameAsked(MapAsked):
    """Which scene, when, and how many orders."""

    orders: int = Field(100, ge=0, le=ORDERS_MAX, description="Orders to list, newest first.")
    find: str = Field("", max_length=FIND_CHARACTERS_MAX, description="Text the orders hold.")
    business: bool = Field(False, description="Leave out parking, charging and making way.")


class StoryAsked(_Asked):
    """Whose story, up to when."""

    order: str = Field(alias="orderId", description="Order id.")
    as_of: str | None = Field(None, alias="asOf", description="A past moment; default: now.")


def router(source: Source, route_class: type[APIRoute] = APIRoute) -> APIRouter:
    """Make the routes; `Refused` and pydantic's errors are left to the app's handlers."""
    made = APIRouter(route_class=route_class)
    _ledger(made, source)
    _replay(made, source)
    _console(made)
    return made


def _json(body: object, position: int) -> Response:
    content = body if isinstance(body, bytes) else msgspec.json.encode(body)
    headers = {"X-Ledger-Position": str(position), "Cache-Control": "no-store"}
    return Response(content, media_type="application/json", headers=headers)


def _answer(of: Any) -> dict[int | str, dict[str, Any]]:
    """Document an answer by its type; the front door puts its parts among the document's own."""
    (schema,), parts = msgspec.json.schema_components(
        [of], ref_template="#/components/schemas/Own{name}"
    )
    named = {f"Own{name}": part | {"title": f"Own{name}"} for name, part in parts.items()}
    return {200: {"content": {"application/json": {"schema": schema}}, OWN_PARTS: named}}


def _ledger(made: APIRouter, source: Source) -> None:
    followers = Followers(source)

    @made.get("/api/ledger/position", tags=["ledger"])
    async def position(request: Request) -> Response:
        """Give the newest position on disk."""
        newest = source.live().position
        return _json({"position": newest}, newest)

    @made.get("/api/ledger/events", tags=["ledger"], responses=_answer(list[dict[str, Any]]))
    async def events(request: Request, query: Annotated[EventsAsked, Query()]) -> Response:
        """Give events in order; with `Accept: text/event-stream` go on as they happen.

        A stream's ids are positions, so `Last-Event-ID` resumes it without a gap; where that
        position is not in the ledger the answer is 409, for it is not what was followed.
        """
        if "text/event-stream" in request.headers.get("accept", ""):
            last = request.headers.get("last-event-id")
            after = query.after if last is None else parse_position(last, "Last-Event-ID")
            return followers.follow(after)
        newest = source.live().position
        found = await asyncio.to_thread(_some, source, query.after, newest, query.limit)
        return _json(found, newest)

    @made.get("/api/ledger/state", tags=["ledger"], responses=_answer(Fleet))
    async def state(request: Request, query: Annotated[StateAsked, Query()]) -> Response:
        """Give the whole state at a moment, canonical: equal states give equal bytes."""
        at = _moment(query.at, query.position)
        if at == At():
            fleet = source.live().copy()
        else:
            fleet = await asyncio.to_thread(source.moments.fleet, at)
        return _json(await asyncio.to_thread(fleet.canonical), fleet.position)


def _moment(at: str | None, position: str | None) -> At:
    if at is not None and position is not None:
        raise Refused("errFieldInvalid", "Give 'at' or 'position', not both.", "at", "position")
    if position is not None:
        return At(position=parse_position(position))
    return At(at_ms=parse_time(at, "at")) if at is not None else At()


def _some(source: Source, after: int, until: int, limit: int) -> list[AnyEvent]:
    return list(source.read(after, min(until, after + limit))) if after < until else []


def _replay(made: APIRouter, source: Source) -> None:
    @made.get("/api/replay/frame", tags=["replay"], responses=_answer(Frame))
    async def frame(request: Request, query: Annotated[FrameAsked, Query()]) -> Response:
        """Give what the console draws: robots and orders of a scene, now or at a past moment."""
        as_of_ms = parse_time(query.as_of) if query.as_of is not None else None
        scene = SceneId(query.scene) if query.scene is not None else None
        wish = Wish(limit=query.orders, find=query.find, business_only=query.business)
        drawn = await frame_at(source, scene, as_of_ms, wish)
        return _json(drawn, drawn.position)

    @made.get("/api/replay/waits", tags=["replay"], responses=_answer(Waiting))
    async def waits(request: Request, query: Annotated[MapAsked, Query()]) -> Response:
        """Give who waits for whom in a scene, and what that hangs on, now or at a past moment."""
        as_of_ms = parse_time(query.as_of) if query.as_of is not None else None
        scene = SceneId(query.scene) if query.scene is not None else None
        found = await waiting_at(source, scene, as_of_ms)
        return _json(found, found.position)

    @made.get("/api/replay/map", tags=["replay"], responses=_answer(MapFrame))
    async def map_(request: Request, query: Annotated[MapAsked, Query()]) -> Response:
        """Give points, paths, bins and footprints of a scene as they were at a moment."""
        as_of_ms = parse_time(query.as_of) if query.as_of is not None else None
        scene = SceneId(query.scene) if query.scene is not None else None
        drawn, position = await map_at(source, scene, as_of_ms)
        return _json(drawn, position)

    @made.get("/api/replay/order-story", tags=["replay"], responses=_answer(Story))
    async def order_story(request: Request, query: Annotated[StoryAsked, Query()]) -> Response:
        """Give an order as it was at a moment, and everything that had happened to it."""
        as_of_ms = parse_time(query.as_of) if query.as_of is not None else None
        told = await story_at(source, OrderId(query.order), as_of_ms)
        return _json(told, told.events[-1].position)


def _console(made: APIRouter) -> None:
    def page(path: Path, media_type: str) -> Response:
        headers = {
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-cache",  # ask each time whether it has changed
        }
        return FileResponse(path, media_type=media_type, headers=headers)

    @made.get("/", include_in_schema=False)
    async def index(request: Request) -> Response:
        """Serve the console."""
        return page(CONSOLE / "index.html", "text/html")

    @made.get("/console/{name}", include_in_schema=False)
    async def file(request: Request) -> Response:
        """Serve a part of the console; there are no folders in it."""
        path = CONSOLE / request.path_params["name"]
        known = path.suffix in CONSOLE_TYPES and path.parent == CONSOLE and path.is_file()
        if not known:
            raise NoSuchFile(path.name)
        return page(path, CONSOLE_TYPES[path.suffix])


class NoSuchFile(Refused):
    """The console has no such part."""

    status = 404

    def __init__(self, name: str) -> None:
        """Take its name."""
        super().__init__("errNoSuchFile", f"The console has no file '{name}'.", name)
