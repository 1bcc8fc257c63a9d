"""Scenes over HTTP, in process: the list, how one is set up, readiness, places and move costs."""

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest

import projections.api.m4
from fleetledger.http import ThinRoute
from ledger.events import (
    AnyEvent,
    RobotAdded,
    RobotConnected,
    SceneConfigured,
    SceneDisabled,
    SceneEnabled,
    SceneImported,
    SceneRemoved,
    SceneRenamed,
    stamped,
)
from ledger.ids import BinName, CommandId, PathKey, PointName, RobotName, SceneId
from ledger.link import Plan, Report
from ledger.scene import Area, Bin, ContainerType, Door, Lift, LiftFloor, Point, RobotConfig
from ledger.scene_config import SceneConfig
from projections.api.m4_models import PLACES_MAX
from tests.projections.api.asking import application, asked_of
from tests.projections.past import Log, Side
from tests.strategies import DAY_MS, SCENE, grid

GONE, YARD = SceneId("1" * 24), SceneId("2" * 24)
FILE = grid(columns=3, rows=2)
R1, R2 = RobotName("R1"), RobotName("R2")
OF = f"/api/fleet/scenes/{SCENE}"
BEYOND = Area(
    id=1,
    name="beyond",
    map_name="beyond",
    map_digest="",
    points=(Point(name=PointName("X1"), x_m=0, y_m=0),),
    paths=(),
    bins=(Bin(name=BinName("XB"), point=PointName("X1")),),
    disabled=True,
)
DOORS = (
    Door(id=1, name="open", area=0, paths=(PathKey("AP1->AP2"),), simulated=True),
    Door(id=2, name="shut", area=0, points=(PointName("LM6"),), disabled=True, open_ahead_m=0),
)
LIFTS = (Lift(id=1, name="lift", floors=(LiftFloor(name="1F", area=0, point=PointName("LM6")),)),)


def robot(name: RobotName, **more: Any) -> RobotAdded:
    return RobotAdded(scene=SCENE, config=RobotConfig(name=name, **more))


def imported(scene: SceneId, name: str, **more: Any) -> SceneImported:
    return SceneImported(
        scene=scene, name=name, digest=name, areas=FILE.areas, groups=FILE.groups, **more
    )


HAPPENED: tuple[AnyEvent, ...] = (
    imported(GONE, "gone"),
    imported(YARD, "yard"),
    SceneImported(
        scene=SCENE,
        name="hall",
        digest="h",
        areas=(*FILE.areas, BEYOND),
        groups=FILE.groups,
        container_types=(ContainerType(name="pallet", footprint=((1.0, 0.0),)),),
        doors=DOORS,
        lifts=LIFTS,
    ),
    robot(R1, tags=("b", "a"), image='{"src": [1]}', gateway_user="gw", plus_one=True),
    robot(R2, tags=("b",), disabled=True),
    SceneConfigured(scene=SCENE, config=SceneConfig(parking_idle_s=77, operation_log_days=9)),
    SceneRenamed(scene=YARD, name="yard", display_order=-1),
    RobotConnected(scene=SCENE, robot=R1),
    SceneRemoved(scene=GONE),
)


def log_of(*happened: AnyEvent) -> Log:
    return Log(
        [
            stamped(event, n, DAY_MS + n * 1000, "alice", CommandId(f"c{n}"))
            for n, event in enumerate(happened, 1)
        ]
    )


@pytest.fixture
async def side(tmp_path: Path) -> AsyncIterator[Side]:
    log = log_of(*HAPPENED, SceneDisabled(scene=SCENE), SceneEnabled(scene=SCENE))
    side = Side(tmp_path, log, len(HAPPENED))
    yield side
    side.close()


@pytest.fixture
async def client(side: Side) -> AsyncIterator[httpx.AsyncClient]:
    queries = asked_of(side, lambda scene, at_ms: {R1: report(PointName("AP3"))})
    app = application(side, projections.api.m4.router(queries, ThinRoute))
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
        yield client


def report(point: PointName | None = None, number: int = 1, **more: Any) -> Report:
    at: dict[str, Any] = {"at_ms": DAY_MS + number, "x_m": 0.0, "y_m": 0.0, "area": 0} | more
    return Report(scene=SCENE, robot=R1, number=number, heading_rad=0.0, point=point, **at)


async def asked(client: httpx.AsyncClient, path: str, **query: Any) -> Any:
    answer = await client.get(path, params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


async def test_the_list_is_in_order_and_without_removed_scenes(client: httpx.AsyncClient) -> None:
    listed = await asked(client, "/api/fleet/scenes/list")
    assert listed == [
        {
            "id": YARD,
            "name": "yard",
            "disabled": False,
            "version": 1,
            "displayOrder": -1,
            "lastModifiedOn": DAY_MS + 7_000,
        },
        {
            "id": SCENE,
            "name": "hall",
            "disabled": False,
            "version": 1,
            "displayOrder": 0,
            "lastModifiedOn": DAY_MS + 6_000,
        },
    ]


async def test_the_list_of_a_past_moment_has_what_was_there(client: httpx.AsyncClient) -> None:
    listed = await asked(client, "/api/fleet/scenes/list", asOf=DAY_MS + 2_000)
    assert [scene["name"] for scene in listed] == ["gone", "yard"]


@pytest.mark.parametrize(
    "path", ["map", "ready-status", "list-points-bins", "../schema/{scene}", "calc-move-costs"]
)
@pytest.mark.parametrize("scene", [GONE, "nowhere", "%20"])
async def test_a_scene_that_is_not_there_is_refused(
    client: httpx.AsyncClient, path: str, scene: str
) -> None:
    url = f"/api/fleet/scenes/{scene}/{path}"
    if path.startswith(".."):
        url = f"/api/fleet/scenes/schema/{scene}"
    answer = await (client.post(url, json={"R1": ["AP1"]}) if "costs" in path else client.get(url))
    assert (answer.status_code, answer.json()["code"]) == (400, "errSceneNotFound")


async def test_the_schema_has_settings_and_structure(client: httpx.AsyncClient) -> None:
    told = await asked(client, f"/api/fleet/scenes/schema/{SCENE}")
    assert list(told) == ["id", "basic", "newConfig", "structure"]
    assert told["basic"]["name"] == "hall"
    assert told["newConfig"]["parkIdleTime"] == 77
    assert told["newConfig"]["opLogKeepDays"] == SceneConfig().operation_log_days  # as it is obeyed
    structure = told["structure"]
    assert list(structure) == [
        "robotGroups", "robotTags", "robots", "areas", "containerTypes", "doors", "lifts",
    ]  # fmt: skip
    (group,) = structure["robotGroups"]
    assert (group["id"], group["name"], group["maxSpeed"]) == (0, "small", 1.2)
    assert group["collisionModel"]["points"][0] == {"x": 0.5, "y": 0.35}
    assert structure["robotTags"] == ["a", "b"]
    assert structure["robots"][0]["image"] == {"src": [1]}
    assert "secret" not in msgspec.json.encode(told).decode().lower()
    hall, beyond = structure["areas"]
    assert list(hall) == ["id", "name", "disabled", "mergedMap", "gmMap", "groupsMap"]
    assert sorted(hall["mergedMap"]) == sorted(
        ["bound", "points", "paths", "zones", "topoAreas", "bins", "restrictedLines", "sourceMaps"]
    )
    assert [p["name"] for p in hall["mergedMap"]["points"]] == [
        p.name for p in FILE.areas[0].points
    ]
    assert hall["gmMap"] == {"0": {"name": "hall", "md5": "0" * 32}}
    assert beyond["disabled"]
    assert structure["containerTypes"][0]["name"] == "pallet"
    first, second = structure["doors"]
    assert (first["controlledPathKeys"], first["openPre"], first["mock"]) == (
        ["AP1->AP2"], True, True,
    )  # fmt: skip
    assert (second["controlledPointNames"], second["openPre"]) == (["LM6"], False)
    assert structure["lifts"][0]["floors"] == [{"name": "1F", "areaId": 0, "pointName": "LM6"}]


async def test_the_map_shows_the_name_that_the_scene_has_by_now(
    side: Side, client: httpx.AsyncClient
) -> None:
    assert (await asked(client, f"{OF}/map"))["name"] == "hall"
    renamed = SceneRenamed(scene=SCENE, name="new", display_order=0)
    position = side.live.position + 1
    side.live.apply([stamped(renamed, position, DAY_MS * 2, "alice", CommandId("x"))])
    assert (await asked(client, f"{OF}/map"))["name"] == "new"
    assert (await asked(client, f"/api/fleet/scenes/schema/{SCENE}"))["basic"]["name"] == "new"


async def test_the_places_are_those_that_orders_may_name(client: httpx.AsyncClient) -> None:
    names = await asked(client, f"{OF}/list-points-bins")
    assert names == {
        "points": [p.name for p in FILE.areas[0].points],
        "bins": ["B1", "B2", "B3"],
    }


async def test_a_scene_is_ready_when_traffic_has_placed_who_answers(
    side: Side, client: httpx.AsyncClient
) -> None:
    ready = f"{OF}/ready-status"
    assert await asked(client, ready) is False  # R1 answers, and traffic has not spoken of it
    plan = Plan(scene=SCENE, robot=R1, at_ms=DAY_MS, ready=False)
    side.live.intend(plan)
    assert await asked(client, ready) is False
    side.live.intend(msgspec.structs.replace(plan, ready=True))
    assert await asked(client, ready) is True
    side.go_on(len(HAPPENED) + 1)
    assert await asked(client, ready) is False
    side.go_on(len(HAPPENED) + 2)
    assert await asked(client, ready) is True
    assert await asked(client, f"/api/fleet/scenes/{YARD}/ready-status") is True


async def costs(client: httpx.AsyncClient, *places: str, **query: Any) -> Any:
    body = {"R1": list(places), "R2": ["AP1"]}
    answer = await client.post(f"{OF}/calc-move-costs", json=body, params=query)
    assert answer.status_code == 200, answer.text
    assert answer.json()["R2"] == {"AP1": -1}  # it has never reported
    return answer.json()["R1"]


async def test_move_costs_are_metres_from_where_the_robot_is(
    side: Side, client: httpx.AsyncClient
) -> None:
    assert await costs(client, "AP1") == {"AP1": -1}
    side.live.observe(report(PointName("AP1")))
    found = await costs(client, "AP1", "AP3", "B2", "LM5", "LM6", "X1", "XB", "nowhere")
    assert found == {
        "AP1": 0, "AP3": 6, "B2": 3, "LM5": 6, "LM6": -1, "X1": -1, "XB": -1, "nowhere": -1,
    }  # fmt: skip
    side.live.observe(report(number=2, x_m=1.0, y_m=0.1))
    assert await costs(client, "AP1", "AP2") == {"AP1": 1, "AP2": 2}
    side.live.observe(report(number=3, x_m=1.0, y_m=1.5))  # on no path
    assert await costs(client, "AP1") == {"AP1": -1}
    side.live.observe(report(number=4, area=1))
    assert await costs(client, "AP1") == {"AP1": -1}
    assert await costs(client, "AP1", asOf=DAY_MS + 8_000) == {"AP1": 6}


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({"R9": ["AP1"]}, "NoSuchRobot"),
        ({"R1": ["AP1"] * (PLACES_MAX + 1)}, "errFieldInvalid"),
        ({"R1": ["AP1"] * PLACES_MAX, "R2": ["AP1"] * PLACES_MAX, "R3": ["A"]}, "errTooMany"),
        ({"R1": "AP1"}, "errFieldInvalid"),
        ({"R1": [1]}, "errFieldInvalid"),
        ({"": ["AP1"]}, "errFieldInvalid"),
        (["R1"], "errFieldInvalid"),
        ({f"R{n}": [] for n in range(1001)}, "errFieldInvalid"),
    ],
    ids=range(8),
)
async def test_what_is_wrong_with_a_question_about_move_costs_is_named(
    client: httpx.AsyncClient, body: Any, code: str
) -> None:
    answer = await client.post(f"{OF}/calc-move-costs", json=body)
    assert (answer.status_code, answer.json()["code"]) == (400, code)
