from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest
from fastapi import APIRouter
from pydantic import BaseModel
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from fleetledger.access import Keys
from fleetledger.api import build
from fleetledger.http import BODY_BYTES_MAX, ThinRoute
from ledger.errors import Refused


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


@pytest.fixture
async def keyed(tmp_path: Path) -> AsyncIterator[tuple[httpx.AsyncClient, dict[str, str]]]:
    keys, key = Keys.open(tmp_path)
    assert key is not None
    app = build([_router()], keys=keys, position=lambda: 7, wait=_wait)
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(transport=transport, base_url="http://fleet") as client:
        yield client, {"xyy-app-id": "fleetledger", "xyy-app-key": key}


Keyed = tuple[httpx.AsyncClient, dict[str, str]]


async def test_without_a_key_only_what_tells_nothing_is_open(keyed: Keyed) -> None:
    client, _ = keyed

    assert (await client.get("/api/ping")).status_code == 200
    assert (await client.get("/openapi.json")).status_code == 200
    refused = await client.post("/greet", json={"name": "AMB"})
    assert refused.status_code == 401
    assert set(refused.json()) == {"code", "message", "args"}
    assert (await client.get("/metrics")).status_code == 401


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
