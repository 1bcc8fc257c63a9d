"""RDSCore's robotsStatus, in process, against its golden examples."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest
from starlette.applications import Starlette

import projections.api.rdscore as rdscore
from ledger.ids import PathKey, PointName, RobotName
from ledger.link import Alarm, AlarmLevel, Load, Plan, Report
from projections.api.rdscore_filter import selected, tree
from projections.live import Live
from tests.golden import example
from tests.projections.past import long_log
from tests.strategies import SCENE

LOG = long_log()
NOW_MS = LOG.events[-1].at_ms
ALARM = Alarm(level=AlarmLevel.WARNING, code="55001", message="busy", at_ms=NOW_MS)


@pytest.fixture
def live() -> Live:
    live = Live(LOG.fleet_at(600))
    for number, robot in enumerate(live.fleet.robots.values()):
        live.observe(
            Report(
                scene=SCENE, robot=robot.name, number=number, at_ms=NOW_MS, area=0,
                x_m=float(number), y_m=0.0, heading_rad=0.0, map_name="hall",
                map_digest="0" * 32, point=PointName("AP1"),
                alarms=(ALARM,) if number == 0 else (),
                loads=(Load(bin=0, container="C1"),) if number == 0 else (),
            )
        )  # fmt: skip
    live.intend(
        Plan(
            scene=SCENE, robot=RobotName("R1"), at_ms=NOW_MS, ready=True, moving=True,
            untravelled=(PathKey("AP1->AP2"), PathKey("AP2->AP3")),
        )
    )  # fmt: skip
    return live


@pytest.fixture
async def client(live: Live) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(rdscore.app(live, lambda: NOW_MS))
    async with httpx.AsyncClient(transport=transport, base_url="http://test") as client:
        yield client


def alike(expected: Any, actual: Any, where: str = "") -> None:
    """Every golden key is there with its JSON type; numbers are alike, null fits anything."""
    if expected is None or actual is None:
        return
    if isinstance(expected, int | float) and not isinstance(expected, bool):
        assert isinstance(actual, int | float), where
    else:
        assert type(expected) is type(actual), f"{where}: {expected!r} against {actual!r}"
    if isinstance(expected, dict):
        missing = expected.keys() - actual.keys()
        assert not missing or "desc" in expected, f"{where}: {missing}"  # codes are keys there
        for key in expected.keys() & actual.keys():
            alike(expected[key], actual[key], f"{where}.{key}")
    if isinstance(expected, list) and expected:
        for item in actual:
            alike(expected[0], item, f"{where}[]")


async def test_the_complete_answer_has_every_golden_field(client: httpx.AsyncClient) -> None:
    answer = await client.get("/robotsStatus")
    assert answer.status_code == 200
    found = answer.json()
    expected = example("rdscore", "robots-status.response")
    # an idle robot has no order, and ours have no arm
    busy = [r for r in found["report"] if r["current_order"]]
    assert busy
    alike(expected, found | {"report": busy})
    # in the tables of the source, but not in its example, which is older (R6)
    assert found.keys() - expected.keys() == {"code", "create_on", "is_error", "model_md5", "msg"}
    extra = busy[0].keys() - expected["report"][0].keys()
    assert extra == {"isLoaded"}
    rbk = busy[0]["rbk_report"].keys() - expected["report"][0]["rbk_report"].keys()
    assert rbk == {"info"}


async def test_keys_are_in_alphabetical_order(client: httpx.AsyncClient) -> None:
    def check(value: Any) -> None:
        if isinstance(value, dict):
            assert list(value) == sorted(value)
            list(map(check, value.values()))
        elif isinstance(value, list):
            list(map(check, value))

    check((await client.get("/robotsStatus")).json())
    check((await client.get("/robotsStatus", params={"paths": "report.uuid,alarms"})).json())


async def test_what_a_robot_says_is_told(client: httpx.AsyncClient, live: Live) -> None:
    robots = {r["uuid"]: r for r in (await client.get("/robotsStatus")).json()["report"]}
    assert robots.keys() == {robot.name for robot in live.fleet.robots.values()}
    first = robots["R1"]
    assert first["unfinished_path"] == ["AP1", "AP2", "AP3"]
    assert first["chassis"]["goods_region"]["name"] == "C1"
    warnings = first["rbk_report"]["alarms"]["warnings"]
    assert warnings == [{"code": 55001, "desc": "busy", "times": 1, "timestamp": NOW_MS // 1000}]
    for robot in live.fleet.robots.values():
        told = robots[robot.name]
        disabled, off = robot.config.disabled, robot.off_duty
        status = told["undispatchable_reason"]["dispatchable_status"]
        assert status == (2 if disabled else 1 if off else 0)
        assert told["connection_status"] == int(robot.online)
        assert told["dispatchable"] == (robot.online and not disabled and not off)


async def test_coordinates_only(client: httpx.AsyncClient) -> None:
    asked = "report.rbk_report.y,report.rbk_report.x"
    found = (await client.get("/robotsStatus", params={"paths": asked})).json()
    assert found.keys() == example("rdscore", "robots-status.2.response").keys()
    assert found["report"][:2] == [
        {"rbk_report": {"x": 0.0, "y": 0.0}},
        {"rbk_report": {"x": 1.0, "y": 0.0}},
    ]


async def test_alarms_and_names_with_null_for_empty_lists(client: httpx.AsyncClient) -> None:
    asked = "report.rbk_report.alarms,report.vehicle_id"
    found = (await client.get("/robotsStatus", params={"paths": asked})).json()
    expected = example("rdscore", "robots-status.3.response")
    alike(expected, found)
    none = {"errors": None, "fatals": None, "notices": None, "warnings": None}
    assert found["report"][1] == {"rbk_report": {"alarms": none}, "vehicle_id": "R2"}
    assert found["report"][0]["rbk_report"]["alarms"]["warnings"][0]["code"] == 55001


async def test_an_unknown_device_is_error_50002(client: httpx.AsyncClient) -> None:
    answer = await client.get("/robotsStatus", params={"devices": "lifts,XXX"})
    expected = example("rdscore", "robots-status.4.response")
    assert answer.status_code == 400
    assert answer.json() == expected | {"create_on": answer.json()["create_on"]}


async def test_devices_are_there_only_if_asked_for(client: httpx.AsyncClient) -> None:
    plain = (await client.get("/robotsStatus")).json()
    assert not {"doors", "lifts", "terminals"} & plain.keys()
    asked = (await client.get("/robotsStatus", params={"devices": "lifts,doors"})).json()
    assert asked["lifts"] == asked["doors"] == []
    assert "terminals" not in asked


async def test_vehicles_select_robots_and_go_with_paths(client: httpx.AsyncClient) -> None:
    params = {"vehicles": "R2, R1,nobody", "paths": "report.uuid"}
    found = (await client.get("/robotsStatus", params=params)).json()
    assert found["report"] == [{"uuid": "R1"}, {"uuid": "R2"}]
    found = (await client.get("/robotsStatus", params={"vehicles": "R2"})).json()
    assert [r["uuid"] for r in found["report"]] == ["R2"]


async def test_a_robot_that_never_reported_is_told_too(live: Live) -> None:
    live.reports.clear()
    transport = httpx.ASGITransport(rdscore.app(live, lambda: NOW_MS))
    async with httpx.AsyncClient(transport=transport, base_url="http://test") as client:
        found = (await client.get("/robotsStatus")).json()["report"]
    assert {r["rbk_report"]["current_station"] for r in found} == {""}
    assert found[0]["area_resources_occupied"] == []


def test_paths_are_merged_into_one_tree() -> None:
    assert tree(["a.b", "a.c.d", "e"]) == {"a": {"b": {}, "c": {"d": {}}}, "e": {}}
    assert tree(["a.b", "a"]) == tree(["a", "a.b"]) == {"a": {}}


def test_a_path_that_selects_nothing_is_skipped() -> None:
    value = {"a": [{"b": 1}, {}], "c": [], "d": 2}
    assert selected(value, tree(["a.b", "c", "x.y", "d.e"])) == {"a": [{"b": 1}, {}], "c": None}


class Socket:
    """A WebSocket client that speaks ASGI directly."""

    def __init__(self, app: Starlette) -> None:
        self.said: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.heard: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.reads = asyncio.Event()
        self.reads.set()
        self.said.put_nowait({"type": "websocket.connect"})
        scope = {
            "type": "websocket", "path": "/robotsStatus", "headers": [], "query_string": b"",
            "subprotocols": [], "scheme": "ws", "client": ("127.0.0.1", 1), "root_path": "",
            "extensions": {},
        }  # fmt: skip
        self.task = asyncio.create_task(app(scope, self.said.get, self._hear))  # type: ignore[arg-type]

    async def _hear(self, message: Any) -> None:
        if message["type"] == "websocket.send":
            await self.reads.wait()
        self.heard.put_nowait(message)

    async def next(self) -> dict[str, Any]:
        async with asyncio.timeout(20):
            return await self.heard.get()

    async def leave(self) -> None:
        self.said.put_nowait({"type": "websocket.disconnect", "code": 1000})
        async with asyncio.timeout(20):
            await self.task


async def test_the_whole_answer_is_pushed_to_all_clients(live: Live) -> None:
    app = rdscore.app(live, lambda: NOW_MS, tick_s=0.001)
    first, second = Socket(app), Socket(app)
    for socket in (first, second):
        assert (await socket.next())["type"] == "websocket.accept"
        frames = [json.loads((await socket.next())["text"]) for _ in range(3)]
        assert all(len(f["report"]) == len(live.fleet.robots) for f in frames)
    live.observe(Report(
        scene=SCENE, robot=RobotName("R1"), number=9, at_ms=NOW_MS + 1, area=0, x_m=77.0,
        y_m=0.0, heading_rad=0.0,
    ))  # fmt: skip
    while json.loads((await first.next())["text"])["report"][0]["rbk_report"]["x"] != 77.0:
        pass
    await first.leave()
    await second.leave()


async def test_a_slow_client_skips_ticks_and_holds_up_nobody(live: Live) -> None:
    moment = iter(range(10**9))
    app = rdscore.app(live, lambda: next(moment), tick_s=0.001)
    slow, quick = Socket(app), Socket(app)
    slow.reads.clear()
    for socket in (slow, quick):
        assert (await socket.next())["type"] == "websocket.accept"
    for _ in range(20):
        await quick.next()
    assert slow.heard.empty()
    slow.reads.set()
    early, late = [json.loads((await slow.next())["text"])["create_on"] for _ in range(2)]
    assert int(late[-4:-1]) - int(early[-4:-1]) > 10
    await slow.leave()
    await quick.leave()


async def test_too_many_clients_are_turned_away(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rdscore, "CLIENTS_MAX", 1)
    app = rdscore.app(live, lambda: NOW_MS, tick_s=0.001)
    first = Socket(app)
    assert (await first.next())["type"] == "websocket.accept"
    second = Socket(app)
    assert (await second.next())["type"] == "websocket.close"
    await first.leave()
    third = Socket(app)
    assert (await third.next())["type"] == "websocket.accept"
    assert (await third.next())["type"] == "websocket.send"
    await third.leave()


async def test_a_robot_that_cannot_get_on_is_an_error_of_the_core(
    client: httpx.AsyncClient, live: Live
) -> None:
    stuck = Alarm(level=AlarmLevel.ERROR, code="TrafficStuck", message="R1 cannot", at_ms=NOW_MS)
    for alarm, codes in ((stuck, [52107]), (None, [])):
        live.intend(Plan(scene=SCENE, robot=RobotName("R1"), at_ms=NOW_MS, ready=True, alarm=alarm))
        found = (await client.get("/robotsStatus")).json()
        errors = found["alarms"]["errors"]
        assert [e["code"] for e in errors if e["desc"] == "R1 cannot"] == codes
        assert bool(codes) == any(e.get("desc") == "R1 cannot" for e in found["errors"])
