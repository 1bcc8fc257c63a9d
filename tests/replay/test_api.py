"""The endpoints of the past: ledger, state, frames, stories, and the page itself."""

from collections.abc import AsyncIterator, Iterator

import httpx
import pytest
from fastapi import FastAPI
from msgspec.structs import replace
from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from ledger.errors import Refused
from ledger.evolve import fold
from ledger.ids import robot_key as key
from ledger.moment import time_text
from ledger.state import Fleet
from replay.api import CONSOLE, OWN_PARTS, router
from replay.waiting import STALE_MS
from tests.replay.site import (
    CHAIN_MS,
    R1,
    R2,
    SCENE,
    START_MS,
    TURN_MS,
    WAITING,
    Site,
    carried,
    reports,
    waits_at,
)


async def refused(_: Request, trouble: Exception) -> Response:
    assert isinstance(trouble, Refused)
    return JSONResponse({"code": trouble.code, "message": trouble.message}, trouble.status)


def app_of(site: Site) -> FastAPI:
    app = FastAPI()
    app.include_router(router(site.source))
    app.add_exception_handler(Refused, refused)
    app.add_exception_handler(ValidationError, refused)
    return app


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    site = Site(tmp_path_factory.mktemp("site"))
    site.run(130)
    yield site
    site.close()


@pytest.fixture
async def client(site: Site) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(app=app_of(site))
    async with httpx.AsyncClient(transport=transport, base_url="http://site") as client:
        yield client


async def test_the_position_is_the_newest_on_disk(site: Site, client: httpx.AsyncClient) -> None:
    assert (await client.get("/api/ledger/position")).json() == {"position": site.ledger.durable}


async def test_events_come_in_order_and_in_pages(site: Site, client: httpx.AsyncClient) -> None:
    everything = (await client.get("/api/ledger/events")).json()
    assert [e["position"] for e in everything] == list(range(1, site.ledger.durable + 1))
    assert everything[0]["type"] == "SceneImported"
    page = (await client.get("/api/ledger/events", params={"after": 5, "limit": 3})).json()
    assert page == everything[5:8]
    assert (await client.get("/api/ledger/events", params={"after": 10**9})).json() == []


async def test_a_bad_last_event_id_is_refused(client: httpx.AsyncClient) -> None:
    headers = {"accept": "text/event-stream", "last-event-id": "x"}
    answer = await client.get("/api/ledger/events", headers=headers)
    assert answer.status_code == 400
    assert "Last-Event-ID" in answer.json()["message"]


async def test_the_state_at_a_moment_is_the_fold_up_to_it(
    site: Site, client: httpx.AsyncClient
) -> None:
    events = list(site.ledger.read(0))
    at_ms = START_MS + 45_000
    expected = fold(Fleet(), [e for e in events if e.at_ms <= at_ms]).canonical()
    by_time = await client.get("/api/ledger/state", params={"at": at_ms})
    assert by_time.content == expected
    position = by_time.headers["x-ledger-position"]
    by_position = await client.get("/api/ledger/state", params={"position": position})
    by_text = await client.get("/api/ledger/state", params={"at": time_text(at_ms)})
    assert by_position.content == by_text.content == expected
    newest = await client.get("/api/ledger/state")
    assert newest.content == site.fleet.canonical()


@pytest.mark.parametrize(
    "query",
    [{"at": "soon"}, {"position": "-1"}, {"position": 10**6}, {"at": "1", "position": "1"}],
)
async def test_a_moment_that_makes_no_sense_is_refused(
    client: httpx.AsyncClient, query: dict[str, str]
) -> None:
    answer = await client.get("/api/ledger/state", params=query)
    assert answer.status_code == 400
    assert answer.json()["code"] == "errFieldInvalid"


async def test_the_newest_frame_shows_robots_and_orders(
    site: Site, client: httpx.AsyncClient
) -> None:
    frame = (await client.get("/api/replay/frame", params={"sceneId": SCENE})).json()
    robots = {r["name"]: r for r in frame["robots"]}
    assert {name: r["state"] for name, r in robots.items()} == {
        "R1": "moving",
        "R2": "charging",
        "R3": "offline",
    }
    assert robots["R1"]["x"] == pytest.approx(reports(site.now_ms)[0].x_m)
    assert robots["R1"]["left"]
    assert robots["R3"]["x"] is None
    assert [o["statusWords"] for o in frame["orders"][1:3]] == ["done", "done"]
    [waiting] = [o for o in frame["orders"] if o["id"] == WAITING]
    assert waiting["statusWords"] == "waits for a robot"
    assert "R3: offline" in waiting["reason"]
    assert (frame["live"], frame["atMs"], frame["firstMs"]) == (True, site.now_ms, START_MS)


async def test_a_past_frame_shows_what_was_then(site: Site, client: httpx.AsyncClient) -> None:
    at_ms = START_MS + 12_000
    query = {"sceneId": SCENE, "asOf": str(at_ms)}
    frame = (await client.get("/api/replay/frame", params=query)).json()
    [robot] = [r for r in frame["robots"] if r["name"] == R1]
    assert robot["x"] == pytest.approx(reports(at_ms)[0].x_m, abs=0.2)
    assert robot["loads"] == ["C"]
    assert [o["id"] for o in frame["orders"]] == [carried(0), WAITING]
    assert frame["orders"][0]["statusWords"] == "under way"
    assert frame["live"] is False


async def test_who_waits_for_whom_is_told_for_any_moment(
    site: Site, client: httpx.AsyncClient
) -> None:
    at_ms = START_MS + 3 * CHAIN_MS + 7_500
    query = {"sceneId": SCENE, "asOf": str(at_ms)}
    told = (await client.get("/api/replay/waits", params=query)).json()
    assert (told["live"], told["scene"], told["cycles"]) == (False, SCENE, [])
    assert [(w["robot"], w["reason"], w["blockers"]) for w in told["waits"]] == [
        (R1, "ReservedGround", ["external:lift maintenance"]),
        (R2, "BehindRobot", [R1]),
    ]
    [chain] = told["chains"]
    assert chain["words"] == (
        "R2 waits for R1 to drive on (since 5 s), "
        "R1 waits for ground reserved for 'lift maintenance' (since 3 s)"
    )
    assert (chain["robots"], chain["root"]) == ([R2, R1], "external:lift maintenance")
    early = {"sceneId": SCENE, "asOf": str(at_ms - 4_000)}
    [chain] = (await client.get("/api/replay/waits", params=early)).json()["chains"]
    assert chain["words"].endswith("to drive on (since 1 s), R1 drives")
    before = {"sceneId": SCENE, "asOf": str(at_ms - 6_000)}
    assert (await client.get("/api/replay/waits", params=before)).json()["waits"] == []
    frame = (await client.get("/api/replay/frame", params=query)).json()
    assert (frame["waits"], frame["chains"]) == (told["waits"], told["chains"])
    now = (await client.get("/api/replay/waits")).json()
    assert (now["live"], now["atMs"]) == (True, site.now_ms)


async def test_what_a_scheduler_that_has_gone_intended_is_no_wait_any_more(
    site: Site, client: httpx.AsyncClient
) -> None:
    before = dict(site.plans)
    stale = replace(before[key(SCENE, R1)], wait=waits_at(site.now_ms)[0])
    try:
        site.plans[key(SCENE, R1)] = replace(stale, at_ms=site.now_ms - STALE_MS)
        assert (await client.get("/api/replay/waits")).json()["waits"]
        site.plans[key(SCENE, R1)] = replace(stale, at_ms=site.now_ms - STALE_MS - 1)
        found = (await client.get("/api/replay/waits")).json()["waits"]
        assert R1 not in [wait["robot"] for wait in found]
    finally:
        site.plans.update(before)


async def test_before_the_first_event_there_is_nothing_to_draw(client: httpx.AsyncClient) -> None:
    query = {"sceneId": SCENE, "asOf": str(START_MS - 1)}
    frame = (await client.get("/api/replay/frame", params=query)).json()
    assert (frame["robots"], frame["orders"], frame["scenes"]) == ([], [], [])


async def test_a_moment_ahead_is_drawn_as_now(site: Site, client: httpx.AsyncClient) -> None:
    query = {"sceneId": SCENE, "asOf": str(site.now_ms + 1_000_000)}
    assert (await client.get("/api/replay/frame", params=query)).json()["live"] is True


@pytest.mark.parametrize(
    ("text", "found"),
    [("offline", [WAITING]), ("b2", [WAITING]), ("000001", [WAITING]), ("nothing like it", [])],
)
async def test_orders_are_found_by_any_of_their_texts(
    client: httpx.AsyncClient, text: str, found: list[str]
) -> None:
    frame = (await client.get("/api/replay/frame", params={"find": text})).json()
    assert [o["id"] for o in frame["orders"]] == found


async def test_the_map_has_paths_and_footprints(client: httpx.AsyncClient) -> None:
    answer = (await client.get("/api/replay/map", params={"sceneId": SCENE})).json()
    assert len(answer["areas"][0]["points"]) == 24
    assert answer["groups"][0]["footprint"]
    missing = await client.get("/api/replay/map", params={"sceneId": "nowhere"})
    assert missing.status_code == 404


async def test_an_orders_story_has_every_event_in_words(client: httpx.AsyncClient) -> None:
    query = {"orderId": carried(1)}
    story = (await client.get("/api/replay/order-story", params=query)).json()
    assert [e["words"] for e in story["events"]] == [
        "Business order created by alice with 2 steps",
        "assigned to R1, 2 s away; not R2 charging",
        "R1 set out for step 1",
        "R1 finished step 1",
        "R1 set out for step 2",
        "R1 finished step 2",
        "done",
    ]
    assert story["order"]["statusWords"] == "done"
    assert [s["words"] for s in story["steps"]] == ["to B1 to load", "to B6 to unload"]


async def test_a_story_told_at_a_past_moment_ends_there(client: httpx.AsyncClient) -> None:
    as_of = START_MS + 2_000 + TURN_MS + 450
    query = {"orderId": carried(1), "asOf": str(as_of)}
    story = (await client.get("/api/replay/order-story", params=query)).json()
    assert len(story["events"]) == 2
    assert story["order"]["statusWords"] == "assigned"
    query["asOf"] = str(START_MS)
    assert (await client.get("/api/replay/order-story", params=query)).status_code == 404


async def test_the_page_comes_with_all_its_parts_and_nothing_from_elsewhere(
    client: httpx.AsyncClient,
) -> None:
    page = await client.get("/")
    assert page.status_code == 200
    assert "script-src 'self'" in page.headers["content-security-policy"]
    for path in CONSOLE.iterdir():
        part = await client.get(f"/console/{path.name}")
        assert part.status_code == (404 if path.suffix == ".html" else 200)
        assert "http://" not in part.text.replace("http://www.w3.org/", "")
        assert "https://" not in part.text


@pytest.mark.parametrize("name", ["..%2Fapi.py", "%2e%2e/api.py", "none.js", "index.html"])
async def test_nothing_else_is_served(client: httpx.AsyncClient, name: str) -> None:
    assert (await client.get(f"/console/{name}")).status_code == 404


async def test_the_documentation_names_what_answers_hold(site: Site) -> None:
    paths = app_of(site).openapi()["paths"]
    answer = paths["/api/replay/frame"]["get"]["responses"]["200"]
    schema = answer["content"]["application/json"]["schema"]
    name = schema["$ref"].removeprefix("#/components/schemas/")
    assert "robots" in answer[OWN_PARTS][name]["properties"]
