import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest
from fastapi import APIRouter
from pydantic import BaseModel
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from fleetledger.access import api as access_api
from fleetledger.access.file import digest_of
from fleetledger.access.registry import key_added
from fleetledger.api import build
from fleetledger.http import BODY_BYTES_MAX, ThinRoute
from fleetledger.middleware import HEAD_BYTES_MAX
from ledger.errors import Refused
from ledger.events import AccessRefused, Role
from tests.fleetledger.access.doors import Doors


class Greeting(BaseModel):
    name: str


def _router() -> APIRouter:
    router = APIRouter(route_class=ThinRoute)

    @router.post("/greet")
    async def greet(request: Request, body: Greeting) -> Response:
        return PlainTextResponse(f"{request.state.user} greets {body.name}")

    @router.post("/refuse")
    async def refuse(request: Request) -> Response:
        raise Refused("errNever", "Field 'never' is wrong.", "never")

    return router


async def _wait(position: int) -> bool:
    return position <= 7


def _client(doors: Doors) -> httpx.AsyncClient:
    access = doors.access
    app = build(
        [_router(), access_api.router(access)],
        callers=access.callers,
        refused=access.refusals.refused,
        position=lambda: 7,
        wait=_wait,
        when=lambda position, then: then(None),
    )
    transport = httpx.ASGITransport(app)
    return httpx.AsyncClient(transport=transport, base_url="http://localhost:5800")


@pytest.fixture
async def keyed(tmp_path: Path) -> AsyncIterator[tuple[httpx.AsyncClient, dict[str, str]]]:
    doors = Doors(tmp_path)
    key = doors.access.file.first_key()
    assert key is not None
    async with _client(doors) as client:
        yield client, {"xyy-app-id": "fleetledger", "xyy-app-key": key}


Keyed = tuple[httpx.AsyncClient, dict[str, str]]


async def test_without_a_key_only_what_tells_nothing_is_open(keyed: Keyed) -> None:
    client, key = keyed

    assert (await client.get("/api/ping")).status_code == 401
    assert (await client.get("/api/ping", headers=key)).status_code == 200
    assert (await client.get("/openapi.json")).status_code == 200
    refused = await client.post("/greet", json={"name": "AMB"})
    assert refused.status_code == 401
    assert set(refused.json()) == {"code", "message", "args"}
    assert (await client.get("/metrics")).status_code == 401


async def test_a_call_that_no_table_names_is_for_admins(tmp_path: Path) -> None:
    doors = Doors(tmp_path)
    digest = digest_of("k")
    doors.access.file.change(key_added("wms", Role.OPERATOR, digest), "test")
    async with _client(doors) as client:
        pair = {"xyy-app-id": "wms", "xyy-app-key": "k"}
        refused = await client.post("/greet", json={"name": "AMB"}, headers=pair)
        assert (refused.status_code, refused.json()["code"]) == (403, "errForbidden")
        assert (await client.get("/greetings", headers=pair)).status_code == 404


async def test_every_refusal_is_counted_for_the_audit(tmp_path: Path) -> None:
    doors = Doors(tmp_path)
    async with _client(doors) as client:
        for _ in range(3):
            await client.get("/api/ping", headers={"xyy-app-id": "wms", "xyy-app-key": "guess"})
    await doors.access.tell_refusals()
    (told,) = doors.told()
    assert isinstance(told, AccessRefused)
    assert (told.caller, told.call, told.code) == ("wms", "GET /api/ping", "errNotSignedIn")
    assert told.count == 3


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),  # a program
        ({"origin": "http://localhost:5800"}, 200),
        ({"sec-fetch-site": "same-origin"}, 200),
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "http://localhost:5801"}, 403),
        ({"origin": "null"}, 403),
        ({"sec-fetch-site": "same-site"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"host": "evil.example:5800"}, 403),  # a name that was pointed at this machine
        ({"host": "localhost.evil.example"}, 403),
        ({"host": "localhost.evil.example"}, 403),
        ({"host": "10.0.0.1:5800"}, 403),
        ({"host": "[::1]:5800"}, 200),
        ({"host": "127.0.0.1"}, 200),
        ({"host": "fleet:5800"}, 200),
    ],
)
async def test_without_access_control_other_sites_pages_can_do_nothing(
    tmp_path: Path, headers: dict[str, str], status: int
) -> None:
    async with _client(Doors(tmp_path, enforced=False)) as client:
        answer = await client.post("/greet", json={"name": "AMB"}, headers=headers)
        assert answer.status_code == status


async def test_a_head_may_not_be_long(keyed: Keyed) -> None:
    client, key = keyed

    answer = await client.get("/api/ping", headers=key | {"x-long": "x" * HEAD_BYTES_MAX})

    assert answer.status_code == 431


async def test_a_deep_body_is_bad_json_and_quickly_so(keyed: Keyed) -> None:
    client, key = keyed

    for body in (b"[" * 900_000, b'{"name":' * 100_000, b'{"name":' + b"[" * 900_000):
        answer = await client.post("/greet", content=body, headers=key)
        assert (answer.status_code, answer.json()["code"]) == (400, "errBadJson")


async def test_a_body_that_does_not_come_is_not_waited_for(
    keyed: Keyed, monkeypatch: pytest.MonkeyPatch
) -> None:
    client, key = keyed
    monkeypatch.setattr("fleetledger.http.BODY_S_MAX", 0.01)

    async def never() -> AsyncIterator[bytes]:
        yield b"{"
        await asyncio.Event().wait()

    answer = await client.post("/greet", content=never(), headers=key)

    assert (answer.status_code, answer.json()["code"]) == (408, "errBodyTooSlow")


async def test_beyond_the_calls_that_fit_one_is_told_to_come_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fleetledger.middleware.UNDER_WAY_MAX", 0)
    async with _client(Doors(tmp_path, enforced=False)) as client:
        answer = await client.get("/api/ping")
    assert answer.status_code == 503
    assert answer.headers["Retry-After"] == "1"


async def test_pages_may_not_be_framed_and_types_not_guessed(keyed: Keyed) -> None:
    client, _ = keyed

    answer = await client.get("/docs")

    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
    assert "Content-Security-Policy" not in (await client.get("/api/ping")).headers


async def test_the_caller_is_the_owner_of_the_key(keyed: Keyed) -> None:
    client, key = keyed

    answer = await client.post("/greet", json={"name": "AMB"}, headers=key)

    assert answer.text == "fleetledger greets AMB"
    assert answer.headers["X-Ledger-Position"] == "7"


async def test_a_large_body_is_refused_with_and_without_a_declared_length(keyed: Keyed) -> None:
    client, key = keyed
    large = b"x" * (BODY_BYTES_MAX + 1)

    async def chunks() -> AsyncIterator[bytes]:
        yield large

    assert (await client.post("/greet", content=large, headers=key)).status_code == 413
    assert (await client.post("/greet", content=chunks(), headers=key)).status_code == 413


async def test_a_query_waits_for_a_position_or_says_that_it_did_not_come(keyed: Keyed) -> None:
    client, key = keyed

    async def status(position: str) -> int:
        headers = key | {"X-Wait-Position": position}
        return (await client.post("/greet", json={"name": "A"}, headers=headers)).status_code

    assert await status("7") == 200
    assert await status("8") == 504
    assert await status("x") == 400


@pytest.mark.parametrize(
    ("body", "code", "field"),
    [
        (b'{"name": 1}', "errFieldInvalid", "name"),
        (b"{}", "errFieldMissing", "name"),
        (b"{", "errBadJson", ""),
        (b'\xff"', "errBadJson", ""),
    ],
)
async def test_wrong_bodies_get_400_and_the_name_of_the_field(
    keyed: Keyed, body: bytes, code: str, field: str
) -> None:
    client, key = keyed

    answer = await client.post("/greet", content=body, headers=key)

    assert answer.status_code == 400
    assert answer.json()["code"] == code
    assert field in answer.json()["message"]


async def test_refusals_have_the_one_shape(keyed: Keyed) -> None:
    client, key = keyed

    answer = await client.post("/refuse", headers=key)

    assert answer.status_code == 400
    assert answer.json() == {
        "code": "errNever",
        "message": "Field 'never' is wrong.",
        "args": ["never"],
    }


async def test_the_document_speaks_of_keys_and_of_our_errors_only(keyed: Keyed) -> None:
    client, _ = keyed

    document = (await client.get("/openapi.json")).json()

    assert document["openapi"].startswith("3.1")
    assert document["security"]
    responses = document["paths"]["/greet"]["post"]["responses"]
    assert {"200", "400", "401", "413"} <= set(responses)
    assert "422" not in responses
