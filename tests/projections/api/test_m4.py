"""M4's questions over HTTP, in process, against the golden examples where there are any."""

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

import projections.api.m4
from fleetledger.http import ThinRoute
from ledger.events import SceneMapReplaced
from ledger.ids import OrderId, PathKey, PointName, RobotName, robot_key
from ledger.link import Alarm, AlarmLevel, Load, Plan, Report, Space
from projections.poses import FRESH_MS
from tests.golden import example, same_form
from tests.projections.api.asking import application, asked_of
from tests.projections.past import Side, all_orders, long_log
from tests.strategies import SCENE

LOG = long_log()
AT_MS = LOG.events[-1].at_ms


def report(robot: str, at_ms: int, x_m: float = 0.0, **more: Any) -> Report:
    return Report(
        scene=SCENE, robot=RobotName(robot), number=1, at_ms=at_ms, area=0, x_m=x_m, y_m=1.0,
        heading_rad=0.0, **more,
    )  # fmt: skip


@pytest.fixture
async def side(tmp_path: Path) -> AsyncIterator[Side]:
    side = Side(tmp_path, LOG, 550)
    side.go_on(600)
    yield side
    side.close()


@pytest.fixture
async def client(side: Side) -> AsyncIterator[httpx.AsyncClient]:
    queries = asked_of(side, lambda scene, at_ms: {RobotName("R1"): report("R1", at_ms - 100, 2.0)})
    router = projections.api.m4.router(queries, ThinRoute)
    app = application(side, router)
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
        yield client


async def posted(client: httpx.AsyncClient, what: str, body: Any, **more: Any) -> Any:
    answer = await client.post(f"/api/entity/find/{what}", json=body, **more)
    assert answer.status_code == 200, answer.text
    return answer.json()


def golden_row() -> dict[str, Any]:
    row: dict[str, Any] = example("m4", "entity-find-many.response")[0]
    return row


@pytest.mark.parametrize("number", ["", ".2", ".3", ".4", ".5", ".6"])
async def test_every_golden_query_is_answered_in_the_golden_form(
    client: httpx.AsyncClient, number: str
) -> None:
    asked = example("m4", f"entity-find-many{number}.request")
    query = asked["query"] or {}
    ids = sorted(all_orders(LOG))
    if query.get("operator") == "In":  # the ids of the example are of another plant
        query["value"] = [ids[4], ids[2], ids[3]]
    if "fuzzy" in asked:
        asked["fuzzy"] = "20260922"
    rows = await posted(client, "many", asked)
    assert rows
    same_form(example("m4", f"entity-find-many{number}.response")[:1], rows)
    if query.get("operator") == "In":
        assert [row["id"] for row in rows] == ids[2:5]
    if query.get("type") == "Compound":
        assert {(row["stepFixed"], row["status"]) for row in rows} == {(True, "Done")}
    if "limit" in asked:
        assert len(rows) == min(asked["limit"], len(ids))


async def test_a_page_has_the_golden_form(client: httpx.AsyncClient) -> None:
    asked = example("m4", "entity-find-page.request")
    expected = example("m4", "entity-find-page.response")
    expected["page"] = [golden_row()]  # its own row writes a number without a decimal point
    found = await posted(client, "page", asked)
    same_form(expected, found)
    assert len(found["page"]) == min(50, found["total"])
    assert found["total"] == len(all_orders(LOG))


async def test_nothing_but_documented_fields_is_in_a_row(client: httpx.AsyncClient) -> None:
    rows = await posted(client, "many", {"entityName": "TransportOrder"})
    assert {frozenset(row) for row in rows} == {frozenset(golden_row())}
    rows = await posted(
        client, "many", {"entityName": "TransportOrder", "projection": ["noLoad", "id"], "limit": 1}
    )
    assert list(rows[0]) == ["noLoad", "id"]


async def test_one_is_found_by_id_or_query_and_none_is_null(client: httpx.AsyncClient) -> None:
    entity = {"entityName": "TransportOrder"}
    id_ = sorted(all_orders(LOG))[7]
    found = await posted(client, "one", entity | {"id": id_})
    assert found["entityValue"]["id"] == id_
    query = {"type": "General", "field1": "id", "operator": "Gt", "value": id_}
    found = await posted(client, "one", entity | {"query": query, "projection": ["id"]})
    assert found == {"entityValue": {"id": sorted(all_orders(LOG))[8]}}
    assert await posted(client, "one", entity | {"id": "TO1"}) == {"entityValue": None}


async def test_count_counts(client: httpx.AsyncClient) -> None:
    query = {"type": "General", "field1": "status", "operator": "In", "value": ["Done"]}
    found = await posted(client, "count", {"entityName": "TransportOrder", "query": query})
    assert found == {"count": sum(o.status == "Done" for o in all_orders(LOG).values())}


async def test_an_unlimited_answer_longer_than_a_chunk_is_streamed_whole(
    client: httpx.AsyncClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("projections.api.m4_entities.CHUNK_ROWS", 3)
    monkeypatch.setattr("projections.find.CHUNK_ROWS", 3)
    asked = {"entityName": "TransportOrder", "projection": ["id"], "sort": ["-id"], "skip": 2}
    ids = sorted(all_orders(LOG), reverse=True)
    assert [row["id"] for row in await posted(client, "many", asked)] == ids[2:]
    found = await posted(client, "many", asked | {"limit": 7})
    assert [row["id"] for row in found] == ids[2:9]
    assert await posted(client, "many", asked | {"limit": 0}) == []
    assert len(await posted(client, "many", asked | {"limit": -1})) == len(ids) - 2


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({"entityName": "Robot"}, "errEntityUnknown"),
        ({}, "errFieldMissing"),
        ({"entityName": "TransportOrder", "sort": ["nope"]}, "errFieldUnknown"),
        ({"entityName": "TransportOrder", "sort": "id"}, "errFieldInvalid"),
        ({"entityName": "TransportOrder", "projection": ["nope"]}, "errFieldUnknown"),
        ({"entityName": "TransportOrder", "query": {"type": "x"}}, "errQueryInvalid"),
        ({"entityName": "TransportOrder", "query": "all"}, "errQueryInvalid"),
        ({"entityName": "TransportOrder", "limit": 10**7}, "errLimitTooLarge"),
        ({"entityName": "TransportOrder", "skip": 10**8}, "errSkipTooLarge"),
        ({"entityName": "TransportOrder", "limit": "2"}, "errFieldInvalid"),
        ({"entityName": "TransportOrder", "asOf": "yesterday"}, "errFieldInvalid"),
        ({"entityName": "TransportOrder", "asOf": AT_MS + 1}, "errAsOfInFuture"),
    ],
)
async def test_bad_input_is_refused_with_a_code(
    client: httpx.AsyncClient, body: Any, code: str
) -> None:
    answer = await client.post("/api/entity/find/many", json=body)
    assert answer.status_code == 400
    assert answer.json()["code"] == code
    assert answer.json().keys() == {"code", "message", "args"}


async def test_a_page_too_large_or_before_the_first_is_refused(client: httpx.AsyncClient) -> None:
    for number, size in ((0, 10), (1, 0), (1, 10_001)):
        body = {"entityName": "TransportOrder", "pageNo": number, "pageSize": size}
        answer = await client.post("/api/entity/find/page", json=body)
        assert (answer.status_code, answer.json()["code"]) == (400, "errFieldInvalid")


async def test_the_past_may_be_asked_for_in_url_body_or_header(client: httpx.AsyncClient) -> None:
    at_ms = LOG.events[299].at_ms
    then = {i for i in all_orders(LOG) if i in {
        getattr(e, "order", None) for e in LOG.events if e.at_ms <= at_ms}}  # fmt: skip
    body = {"entityName": "TransportOrder", "projection": ["id"]}
    by_url = await posted(client, "many", body, params={"asOf": str(at_ms)})
    by_body = await posted(client, "many", body | {"asOf": at_ms})
    by_header = await posted(client, "many", body, headers={"asOf": str(at_ms)})
    assert by_url == by_body == by_header == [{"id": id_} for id_ in sorted(then)]


async def test_answers_name_their_position_and_wait_for_one(
    client: httpx.AsyncClient, side: Side, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = {"entityName": "TransportOrder", "limit": 1}
    answer = await client.post("/api/entity/find/many", json=body)
    assert answer.headers["X-Ledger-Position"] == "600"
    answer = await client.post(
        "/api/entity/find/many", json=body, headers={"X-Wait-Position": "600"}
    )
    assert answer.status_code == 200
    assert not await side.live.wait(601, timeout_s=0.01)


async def test_the_detail_of_an_order_has_the_golden_form(client: httpx.AsyncClient) -> None:
    orders = all_orders(LOG)
    waiting = next(o for o in orders.values() if o.allocation_reject and not o.terminal)
    answer = await client.get(
        "/api/fleet/orders/query-order-detail", params={"orderId": waiting.id}
    )
    found = answer.json()
    expected = example("m4", "orders-query-detail.response")
    (expected_reject,), (reject,) = (
        expected["allocationReject"]["params"],
        (found["allocationReject"]["params"][:1]),
    )
    same_form(list(expected_reject.values()), list(reject.values()))
    del expected["allocationReject"]["params"], found["allocationReject"]["params"]
    same_form(expected, found)
    assert [step["stepIndex"] for step in found["steps"]] == [
        str(n) for n in range(len(waiting.steps))
    ]


async def test_every_order_ended_or_not_has_its_detail(client: httpx.AsyncClient) -> None:
    for id_, order in all_orders(LOG).items():
        answer = await client.get("/api/fleet/orders/query-order-detail", params={"orderId": id_})
        found = answer.json()
        assert (found["id"], found["status"]) == (id_, order.status)
        assert [step["id"] for step in found["steps"]] == [step.id for step in order.steps]


async def test_an_unknown_order_has_no_detail(client: httpx.AsyncClient) -> None:
    answer = await client.get("/api/fleet/orders/query-order-detail", params={"orderId": "TO1"})
    assert (answer.status_code, answer.json()["code"]) == (400, "errOrderNotFound")
    answer = await client.get("/api/fleet/orders/query-order-detail")
    assert (answer.status_code, answer.json()["code"]) == (400, "errFieldMissing")


async def robots(client: httpx.AsyncClient, **params: Any) -> Any:
    answer = await client.get("/api/fleet/robots/all-all", params={"sceneId": SCENE} | params)
    assert answer.status_code == 200, answer.text
    return answer.json()


def shown(side: Side) -> list[str]:
    return [r.name for r in side.live.fleet.robots.values() if not r.config.disabled]


async def test_robots_have_the_golden_form(client: httpx.AsyncClient, side: Side) -> None:
    for name in shown(side):
        side.live.observe(report(name, AT_MS, point=PointName("AP1"), confidence=0.67396))
        side.live.intend(
            Plan(
                scene=SCENE, robot=RobotName(name), at_ms=AT_MS, ready=True,
                spaces=(Space(points=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))),),
            )
        )  # fmt: skip
    found = await robots(client, rawAll="true")
    expected = example("m4", "robots-all.response")["AMB-01"]
    assert sorted(found) == sorted(shown(side))
    optional = {"cuOrderId", "cuStepIndex", "cuStepLocation", "op", "oFaultMsg", "autoOrder"}
    optional |= {"targetPoint", "connectMsg"}
    for robot in found.values():
        robot = {key: value for key, value in robot.items() if key not in optional}
        robot["bins"] = [{"index": b["index"], "status": b["status"]} for b in robot["bins"]]
        same_form(expected, robot)
    assert "raw" not in next(iter((await robots(client)).values()))


async def test_a_robot_that_never_reported_has_no_pose(
    client: httpx.AsyncClient, side: Side
) -> None:
    for robot in (await robots(client, rawAll="true")).values():
        assert not {"x", "y", "d", "rTime", "raw", "battery"} & robot.keys()
        assert robot["alarms"] == robot["spaces"] == robot["unTravelled"] == robot["bbr"] == []


async def test_a_robot_that_cannot_get_on_has_an_alarm_of_traffic_after_its_own(
    client: httpx.AsyncClient, side: Side
) -> None:
    name = RobotName(shown(side)[0])
    own = Alarm(level=AlarmLevel.WARNING, code="55001", message="low battery")
    stuck = Alarm(level=AlarmLevel.ERROR, code="TrafficStuck", message="no way", at_ms=AT_MS)
    side.live.observe(report(name, AT_MS, alarms=(own,)))
    for alarm, codes in ((stuck, ["55001", "TrafficStuck"]), (None, ["55001"])):
        plan = Plan(scene=SCENE, robot=name, at_ms=AT_MS, ready=True, alarm=alarm)
        side.live.intend(plan)
        assert [a["code"] for a in (await robots(client))[name]["alarms"]] == codes


async def test_disabled_robots_are_left_out(client: httpx.AsyncClient, side: Side) -> None:
    assert len(shown(side)) < len(side.live.fleet.robots)  # the history has disabled some
    assert (await robots(client)).keys() == set(shown(side))


async def test_all_robots_are_of_one_instant(client: httpx.AsyncClient, side: Side) -> None:
    online = [r.name for r in side.live.fleet.robots.values() if r.online and not r.config.disabled]
    first, second = online[:2]
    late = {n: r for n, r in side.live.fleet.robots.items() if not r.online}
    for key, robot in late.items():
        side.live.observe(report(robot.name, AT_MS - FRESH_MS * 2))
        assert key in side.live.reports
    for n in range(5):
        side.live.observe(report(first, AT_MS + n * 100, float(n), speed_mps=10.0))
    for n in range(4):
        side.live.observe(report(second, AT_MS + 40 + n * 100, float(n), speed_mps=10.0))
    found = await robots(client)
    assert found[first]["rTime"] == found[second]["rTime"] == AT_MS + 340
    assert (found[first]["x"], found[second]["x"]) == (3.4, 3.0)


async def test_what_a_robot_says_is_shown(client: httpx.AsyncClient, side: Side) -> None:
    known = side.live.fleet.robots.values()
    name = next(r.name for r in known if r.orders and r.online and not r.config.disabled)
    alarm = Alarm(level=AlarmLevel.ERROR, code="52200", message="blocked", at_ms=AT_MS)
    side.live.observe(
        report(
            name, AT_MS, 1.23456, alarms=(alarm,), loads=(Load(bin=0, container="C1"),),
            blocked=True, blocked_reason=1, battery_ratio=0.98765,
        )
    )  # fmt: skip
    side.live.intend(
        Plan(
            scene=SCENE, robot=RobotName(name), at_ms=AT_MS, ready=True, moving=True, commit=7,
            target=PointName("AP2"), untravelled=(PathKey("AP1->AP2"),),
            blocked_by=(RobotName("R9"), RobotName("door:1"), RobotName("external:WMS")),
        )
    )  # fmt: skip
    robot = (await robots(client, rawAll="true"))[name]
    assert (robot["x"], robot["battery"], robot["blockedMsg"]) == (1.235, 0.988, 1)
    assert (
        robot["alarms"]
        == robot["raw"]["errors"]
        == [
            {
                "level": "Error",
                "code": "52200",
                "message": "blocked",
                "times": 1,
                "timestamp": AT_MS,
            }
        ]
    )
    assert robot["loads"][0]["id"] == "C1"
    assert (robot["targetPoint"], robot["bp"], robot["bbr"]) == ("AP2", "AP2", ["R9"])
    assert (robot["ttId"], robot["ttStatus"]) == ("7", "TrafficAccepted")
    orders = side.live.fleet.orders
    first = orders[OrderId(robot["cuOrderId"])]
    assert first.robot == name
    assert robot["withBzOrder"] is True
    assert robot["orders"] == list(side.live.fleet.robots[robot_key(SCENE, name)].orders)


async def test_robots_of_the_past_come_from_what_was_written(client: httpx.AsyncClient) -> None:
    at_ms = LOG.events[9].at_ms
    found = await robots(client, asOf=at_ms)
    assert (found["R1"]["x"], found["R1"]["rTime"]) == (2.0, at_ms)
    assert "x" not in found["R2"]


async def test_a_scene_may_be_named_and_must_exist(client: httpx.AsyncClient, side: Side) -> None:
    name = side.live.fleet.scenes[SCENE].name
    by_name = await client.get("/api/fleet/robots/all-all", params={"sceneName": name})
    assert by_name.json() == await robots(client)
    for params, code in (
        ({"sceneId": "x"}, "errSceneNotFound"),
        ({"sceneName": "x"}, "errSceneNotFound"),
        ({}, "errSceneIdBlank"),
    ):
        answer = await client.get("/api/fleet/robots/all-all", params=params)
        assert (answer.status_code, answer.json()["code"]) == (400, code)


async def test_scenes_are_listed_and_drawn(client: httpx.AsyncClient, side: Side) -> None:
    (listed,) = (await client.get("/api/fleet/scenes/list")).json()
    known = side.live.fleet.scenes[SCENE]
    assert (listed["id"], listed["name"], listed["disabled"]) == (SCENE, known.name, known.disabled)
    drawn = (await client.get(f"/api/fleet/scenes/{SCENE}/map")).json()
    (area,) = drawn["areas"]
    scene = side.live.fleet.scenes[SCENE]
    assert len(area["points"]) == len(scene.areas[0].points)
    assert {path["key"] for path in area["paths"]} == {path.key for path in scene.areas[0].paths}
    assert area["bound"]["xMin"] == 0.0
    unknown = await client.get("/api/fleet/scenes/x/map")
    assert (unknown.status_code, unknown.json()["code"]) == (400, "errSceneNotFound")


async def test_the_map_of_the_past_is_the_map_of_then(client: httpx.AsyncClient) -> None:
    versions = set()
    replaced = next(e.position for e in LOG.events if isinstance(e, SceneMapReplaced))
    for position in (1, replaced):
        answer = await client.get(
            f"/api/fleet/scenes/{SCENE}/map", params={"asOf": LOG.events[position - 1].at_ms}
        )
        versions.add(answer.json()["version"])
    assert len(versions) == 2  # the history has replaced the map


def test_the_questions_are_documented(side: Side) -> None:
    app = FastAPI()
    app.include_router(projections.api.m4.router(asked_of(side), ThinRoute))
    paths = app.openapi()["paths"]
    many = paths["/api/entity/find/many"]["post"]
    assert [p["name"] for p in many["parameters"]] == ["asOf"]
    assert "requestBody" in many
    assert "description" in paths["/api/fleet/robots/all-all"]["get"]
