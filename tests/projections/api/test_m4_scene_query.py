"""The scene query over HTTP, and the questions about one robot or several questions at once."""

import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest

import projections.api.m4
from fleetledger.http import ThinRoute
from ledger.evolve import fold
from ledger.ids import PathKey, RobotName
from ledger.link import Plan, Report
from ledger.state import TERMINAL, Fleet, OrderStatus
from projections.api.m4_scene_query import FIELDS, SceneQueries
from tests.golden import example, same_form
from tests.projections.api.asking import application, asked_of
from tests.projections.past import Side, all_orders, long_log
from tests.strategies import SCENE

LOG = long_log()
AT_MS = LOG.events[-1].at_ms
QUERY_ALL = f"/api/fleet/scenes/{SCENE}/query-all"


@pytest.fixture
async def side(tmp_path: Path) -> AsyncIterator[Side]:
    side = Side(tmp_path, LOG, 550)
    side.go_on(600)
    yield side
    side.close()


def report(robot: str, at_ms: int = AT_MS, **more: Any) -> Report:
    return Report(
        scene=SCENE, robot=RobotName(robot), number=1, at_ms=at_ms, area=0, x_m=1.23456, y_m=2.0,
        heading_rad=0.123456, **more,
    )  # fmt: skip


@pytest.fixture
def queries(side: Side) -> SceneQueries:
    return asked_of(side, lambda scene, at_ms: {RobotName("R1"): report("R1", at_ms - 100)})


@pytest.fixture
async def client(side: Side, queries: SceneQueries) -> AsyncIterator[httpx.AsyncClient]:
    app = application(side, projections.api.m4.router(queries, ThinRoute))
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
        yield client


async def asked(client: httpx.AsyncClient, **body: Any) -> Any:
    answer = await client.post(QUERY_ALL, json=body)
    assert answer.status_code == 200, answer.text
    return answer.json()


async def test_a_scene_query_answers_every_field_in_order(client: httpx.AsyncClient) -> None:
    reply = await asked(client)
    assert tuple(reply) == FIELDS
    orders = all_orders(LOG).values()
    live = [order for order in orders if not order.terminal]
    assert reply["goingCount"] == sum(o.status is OrderStatus.EXECUTING for o in live)
    assert reply["faultCount"] == sum(o.fault_reason is not None for o in live)
    assert reply["dispatchProfile"] == {
        status: sum(o.status == status for o in live) for status in OrderStatus
        if status not in TERMINAL
    }  # fmt: skip
    assert reply["ordersRecords"].keys() == {order.id for order in live}
    assert (reply["keepOrderNum"], reply["randomOrdersOn"], reply["replayOrdersStop"]) == (
        0,
        False,
        True,
    )
    robots = await client.get("/api/fleet/robots/all-all", params={"sceneId": SCENE})
    assert reply["robots"] == robots.json()


async def test_what_is_excluded_is_neither_answered_nor_made(
    client: httpx.AsyncClient, queries: SceneQueries, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*arguments: Any, **more: Any) -> Any:
        raise AssertionError("this is made although nobody wants it")

    for name in ("robot_rows", "field_value", "shown_orders", "seen_now", "plans_now"):
        monkeypatch.setattr(f"projections.api.m4_scene_query.{name}", never)
    assert await asked(client, excluded=[*FIELDS, "unheard of"]) == {}


async def test_traffic_may_be_left_out_as_a_whole(client: httpx.AsyncClient, side: Side) -> None:
    side.live.intend(
        Plan(
            scene=SCENE, robot=RobotName("R1"), at_ms=AT_MS, ready=True,
            untravelled=(PathKey("AP1->AP2"), PathKey("AP2->AP3")),
        )
    )  # fmt: skip
    whole, less = await asked(client), await asked(client, excluded=["traffic"])
    assert whole.keys() - less.keys() == {"trafficConditions"}
    for name, robot in less["robots"].items():
        assert whole["robots"][name].keys() - robot.keys() == {"unTravelled", "spaces"}
    shown = not side.live.fleet.robots[f"{SCENE}/R1"].config.disabled  # type: ignore[index]
    assert whole["trafficConditions"] == ({"AP1->AP2": 1} if shown else {})


async def test_orders_are_those_of_the_type_the_newest_first(client: httpx.AsyncClient) -> None:
    orders = all_orders(LOG)

    def ids(wanted: Any) -> list[str]:
        found = [order for order in orders.values() if wanted(order)]
        return [o.id for o in sorted(found, key=lambda o: (-o.created_ms, o.id))]

    live, ended = ids(lambda o: not o.terminal), ids(lambda o: o.terminal)
    faulted = ids(lambda o: not o.terminal and o.fault_reason is not None)
    for kind, expected in (
        ("AllOrders", live + ended),
        (None, live + ended),
        ("NoFinishedOrders", live),
        ("FaultOrders", faulted),
    ):
        reply = await asked(client, orderQueryType=kind)
        assert [order["id"] for order in reply["orders"]] == expected
    body = {"entityName": "TransportOrder"}
    rows = (await client.post("/api/entity/find/many", json=body)).json()
    reply = await asked(client)
    assert sorted(reply["orders"], key=lambda row: str(row["id"])) == rows


async def test_ended_orders_beyond_memory_come_from_the_history(
    client: httpx.AsyncClient, side: Side
) -> None:
    expected = (await asked(client))["orders"]
    with side.history.moved:
        side.history.moved.wait_for(lambda: side.history.position == 600, timeout=20)
    side.live.seed([], are_all=False)
    assert (await asked(client))["orders"] == expected


async def test_a_scene_of_the_past_is_answered_as_it_was(client: httpx.AsyncClient) -> None:
    at_ms = LOG.events[299].at_ms
    known = [event for event in LOG.events if event.at_ms <= at_ms]
    fleet = fold(Fleet(), known)
    reply = await asked(client, asOf=at_ms)
    assert reply["replyTimestamp"] == at_ms
    assert set(reply["ordersRecords"]) == set(fleet.orders)
    made = {e.order for e in known if type(e).__name__ == "OrderCreated"}  # type: ignore[union-attr]
    assert {order["id"] for order in reply["orders"]} == made
    by_url = await client.post(QUERY_ALL, json={}, params={"asOf": str(at_ms)})
    assert by_url.json() == reply


async def test_raw_reports_come_whole_in_part_or_not(client: httpx.AsyncClient, side: Side) -> None:
    for robot in side.live.fleet.robots.values():
        side.live.observe(report(robot.name))

    async def raws(**body: Any) -> list[Any]:
        return [robot.get("raw") for robot in (await asked(client, **body))["robots"].values()]

    assert set(await raws()) == {None}
    whole = example("m4", "robots-all.response")["AMB-01"]["raw"].keys()
    for asks in ({"withRawReport": True}, {"rawAll": True}):
        assert all(raw.keys() == whole for raw in await raws(**asks))
    assert all(raw.keys() == {"x", "y"} for raw in await raws(rawFields=["x", "y", "nope"]))


@pytest.mark.parametrize(
    "body",
    [
        {"excluded": "robots"},
        {"excluded": [1]},
        {"excluded": ["x"] * 101},
        {"orderQueryType": "SomeOrders"},
        {"orderQueryType": 1},
        {"withRawReport": "true"},
        {"asOf": "yesterday"},
        {"asOf": AT_MS + 1},
        {"asOf": int("9" * 400)},
        [],
    ],
)
async def test_a_wrong_scene_query_is_refused(client: httpx.AsyncClient, body: Any) -> None:
    answer = await client.post(QUERY_ALL, json=body)
    assert answer.status_code == 400
    assert answer.json().keys() == {"code", "message", "args"}


async def test_an_unknown_scene_is_refused(client: httpx.AsyncClient) -> None:
    answer = await client.post("/api/fleet/scenes/x/query-all", json={})
    assert (answer.status_code, answer.json()["code"]) == (400, "errSceneNotFound")


async def test_the_point_of_a_robot_has_the_golden_form(
    client: httpx.AsyncClient, side: Side
) -> None:
    path, params = "/api/fleet/robots/query-point", {"sceneId": SCENE, "robotName": "R1"}
    answer = await client.get(path, params=params)
    assert (answer.status_code, answer.json()["code"]) == (400, "errRobotNeverReported")
    side.live.observe(report("R1", point="AP1"))
    found = (await client.get(path, params=params)).json()
    same_form(example("m4", "robots-query-point.response"), found)
    assert found == {"pointName": "AP1", "direction": 0.1235, "x": 1.235, "y": 2.0}
    then = LOG.events[99].at_ms
    found = (await client.get(path, params=params | {"asOf": str(then)})).json()
    assert (found["x"], found["pointName"]) == (1.235, None)


async def test_the_maps_of_a_robot_have_the_golden_form(
    client: httpx.AsyncClient, side: Side
) -> None:
    path = f"/api/fleet/robots/{SCENE}/maps/R1"
    (area,) = side.live.fleet.scenes[SCENE].areas
    for current in (False, True):
        found = (await client.get(path)).json()
        same_form(example("m4", "robots-maps.response"), found)
        assert found == [{"mapName": area.map_name, "mapMd5": area.map_digest, "current": current}]
        side.live.observe(report("R1", map_name=area.map_name))


@pytest.mark.parametrize(
    ("path", "code"),
    [
        (f"query-point?sceneId={SCENE}&robotName=R99", "NoSuchRobot"),
        ("query-point?sceneId=x&robotName=R1", "errSceneNotFound"),
        ("query-point?sceneId=x", "errFieldMissing"),
        (f"query-point?sceneId={SCENE}&robotName=", "errFieldInvalid"),
        (f"{SCENE}/maps/R99", "NoSuchRobot"),
        ("x/maps/R1", "errSceneNotFound"),
        (f"{SCENE}/maps/%ED%A0%80", "NoSuchRobot"),
    ],
)
async def test_who_is_unknown_is_refused(client: httpx.AsyncClient, path: str, code: str) -> None:
    answer = await client.get(f"/api/fleet/robots/{path}")
    assert (answer.status_code, answer.json()["code"]) == (400, code)


BATCH = "/api/entity/find/batch"
ENTITY = {"entityName": "TransportOrder"}


async def test_a_batch_answers_each_question_as_if_asked_alone(client: httpx.AsyncClient) -> None:
    id_ = sorted(all_orders(LOG))[3]
    asks = [
        ("One", ENTITY | {"id": id_}),
        ("Many", ENTITY | {"limit": 3, "sort": ["-createdOn"]}),
        ("Page", ENTITY | {"pageNo": 2, "pageSize": 5}),
        ("One", ENTITY | {"id": "TO1"}),
        ("Many", ENTITY | {"projection": ["id"], "asOf": LOG.events[99].at_ms}),
    ]
    body = [{"type": type_, "req": req} for type_, req in asks]
    answer = await client.post(BATCH, json=body)
    assert answer.status_code == 200, answer.text
    for (type_, req), reply in zip(asks, answer.json(), strict=True):
        alone = await client.post(f"/api/entity/find/{type_.lower()}", json=req)
        assert reply == alone.json()
    assert (await client.post(BATCH, json=[])).json() == []


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"type": "Count", "req": ENTITY}, "1.type"),
        ({"type": "One"}, "1.req"),
        ({"type": "One", "req": {}}, "[1].req.entityName"),
        ({"type": "Many", "req": ENTITY | {"limit": "x"}}, "[1].req.limit"),
        ({"type": "Page", "req": ENTITY}, "[1].req.pageNo"),
        ({"type": "One", "req": {"entityName": "Robot"}}, "[1].req"),
        ({"type": "One", "req": ENTITY | {"query": {"type": "x"}}}, "[1].req"),
        ({"type": "Many", "req": ENTITY | {"sort": ["nope"]}}, "[1].req"),
    ],
)
async def test_one_bad_question_refuses_the_batch_and_is_named(
    client: httpx.AsyncClient, entry: Any, words: str
) -> None:
    answer = await client.post(BATCH, json=[{"type": "One", "req": ENTITY}, entry])
    assert answer.status_code == 400
    assert words in answer.json()["message"]


async def test_a_batch_is_limited_in_questions_and_rows(
    client: httpx.AsyncClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = await client.post(BATCH, json=[{"type": "One", "req": ENTITY}] * 21)
    assert answer.status_code == 400
    monkeypatch.setattr("projections.api.m4_entities.BATCH_ROWS_MAX", 5)
    for req in (ENTITY, ENTITY | {"limit": 6}):
        answer = await client.post(BATCH, json=[{"type": "Many", "req": req}])
        assert (answer.status_code, answer.json()["code"]) == (400, "errTooManyRows")
    answer = await client.post(BATCH, json=[{"type": "Many", "req": ENTITY | {"limit": 5}}])
    assert len(answer.json()[0]) == 5
    page = {"type": "Page", "req": ENTITY | {"pageNo": 1, "pageSize": 6}}
    assert (await client.post(BATCH, json=[page])).json()["code"] == "errTooManyRows"


def test_rows_that_are_json_already_are_the_rows(side: Side, queries: SceneQueries) -> None:
    for order in side.live.fleet.orders.values():
        once = queries.encoded.row(order, "x")
        assert queries.encoded.row(order, "x") is once
        assert json.loads(msgspec.json.encode(once))["sceneName"] == "x"
        assert json.loads(msgspec.json.encode(queries.encoded.row(order, "y")))["sceneName"] == "y"
