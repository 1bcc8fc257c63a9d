"""What each field of a question about orders does, in all three calls, against all orders."""

from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest

import projections.api.m4
from fleetledger.http import ThinRoute
from ledger.state import Order
from projections.fields import SHOWN, row
from tests.projections.api.asking import application, asked_of
from tests.projections.past import Side, all_orders, long_log

LOG = long_log()
ORDERS = all_orders(LOG)
IDS = sorted(ORDERS)
DONE = {"type": "General", "field1": "status", "operator": "Eq", "value": "Done"}
FUZZY = IDS[len(IDS) // 2][-4:].lower()  # the end of an id


@pytest.fixture(scope="module")
def side(tmp_path_factory: pytest.TempPathFactory) -> Any:
    side = Side(tmp_path_factory.mktemp("orders"), LOG, 550)
    side.go_on(600)
    yield side
    side.close()


@pytest.fixture
async def client(side: Side) -> AsyncIterator[httpx.AsyncClient]:
    app = application(side, projections.api.m4.router(asked_of(side), ThinRoute))
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
        yield client


async def found(client: httpx.AsyncClient, call: str, **fields: Any) -> list[dict[str, Any]]:
    """Give the rows that a call answers."""
    body = {"entityName": "TransportOrder"} | fields
    if call == "page":
        body = {"pageNo": 1, "pageSize": 10_000} | body
    answer = await client.post(f"/api/entity/find/{call}", json=body)
    assert answer.status_code == 200, answer.text
    reply = answer.json()
    rows = {
        "many": lambda: reply,
        "page": lambda: reply["page"],
        "one": lambda: [reply["entityValue"]],
    }
    return rows[call]()  # type: ignore[no-any-return]


def ids(rows: list[dict[str, Any]]) -> list[str]:
    return [row["id"] for row in rows]


def first(call: str, wanted: list[str]) -> list[str]:
    return wanted[:1] if call == "one" else wanted


@pytest.mark.parametrize("call", ["many", "page", "one"])
async def test_the_entity_is_the_order(client: httpx.AsyncClient, call: str) -> None:
    rows = await found(client, call)
    assert ids(rows) == first(call, IDS)
    assert rows[0].keys() == {field.name for field in SHOWN}
    body = {"entityName": "Robot", "pageNo": 1, "pageSize": 1}
    answer = await client.post(f"/api/entity/find/{call}", json=body)
    assert (answer.status_code, answer.json()["code"]) == (400, "errEntityUnknown")


@pytest.mark.parametrize("call", ["many", "page", "one"])
async def test_a_condition_leaves_out_what_it_does_not_hold_for(
    client: httpx.AsyncClient, call: str
) -> None:
    wanted = [id_ for id_ in IDS if ORDERS[id_].status == "Done"]
    assert 0 < len(wanted) < len(IDS)
    assert ids(await found(client, call, query=DONE)) == first(call, wanted)
    assert ids(await found(client, call, query=None)) == first(call, IDS)


@pytest.mark.parametrize("call", ["many", "page"])
async def test_fuzzy_is_a_part_of_the_id(client: httpx.AsyncClient, call: str) -> None:
    wanted = [id_ for id_ in IDS if FUZZY in id_.lower()]
    assert 0 < len(wanted) < len(IDS)
    assert ids(await found(client, call, fuzzy=FUZZY)) == wanted


@pytest.mark.parametrize("call", ["many", "page", "one"])
async def test_a_projection_is_all_that_is_answered(client: httpx.AsyncClient, call: str) -> None:
    rows = await found(client, call, projection=["status", "id"])
    wanted = [{"status": ORDERS[id_].status, "id": id_} for id_ in first(call, IDS)]
    assert rows == wanted


@pytest.mark.parametrize("call", ["many", "page"])
@pytest.mark.parametrize("sort", [["-id"], ["+priority", "-id"], ["-createdOn", "id"]])
async def test_rows_are_sorted_by_one_field_after_another(
    client: httpx.AsyncClient, call: str, sort: list[str]
) -> None:
    def of(order: Order) -> dict[str, Any]:
        return row(order, "")

    wanted = list(ORDERS.values())
    for name in reversed(sort):
        wanted.sort(key=lambda o: of(o)[name.strip("+-")], reverse=name.startswith("-"))
    assert ids(await found(client, call, sort=sort)) == [order.id for order in wanted]


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        ({"skip": 3}, IDS[3:]),
        ({"skip": None, "limit": 4}, IDS[:4]),
        ({"skip": 2, "limit": 5}, IDS[2:7]),
        ({"limit": -1}, IDS),
        ({"limit": None}, IDS),
        ({"skip": 10**6}, []),
    ],
)
async def test_rows_are_skipped_and_limited(
    client: httpx.AsyncClient, fields: dict[str, Any], wanted: list[str]
) -> None:
    assert ids(await found(client, "many", **fields)) == wanted


@pytest.mark.parametrize(("number", "size"), [(1, 7), (2, 7), (3, 5), (10**6, 7)])
async def test_a_page_has_its_number_its_size_and_the_count_of_all(
    client: httpx.AsyncClient, number: int, size: int
) -> None:
    body = {"entityName": "TransportOrder", "query": DONE, "pageNo": number, "pageSize": size}
    reply = (await client.post("/api/entity/find/page", json=body)).json()
    wanted = [id_ for id_ in IDS if ORDERS[id_].status == "Done"]
    assert (reply["pageNo"], reply["pageSize"], reply["total"]) == (number, size, len(wanted))
    assert ids(reply["page"]) == wanted[(number - 1) * size :][:size]
