"""Whom questions about robots and scenes mean: two scenes have robots of the same names."""

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest

import projections.api.m4
import projections.api.wsm
from fleetledger.http import ThinRoute
from ledger.events import AnyEvent, SceneImported, SceneRenamed, stamped
from ledger.ids import CommandId, SceneId
from ledger.link import Report
from tests.commands.site import R1, R2, SCENE, opened
from tests.projections.api.asking import application, asked_of
from tests.projections.api.sockets import opened as connected
from tests.projections.past import Log, Side

YARD = SceneId("2" * 24)
X_M = {(SCENE, R1): 1.0, (SCENE, R2): 2.0, (YARD, R1): 3.0, (YARD, R2): 4.0}


def happened() -> list[AnyEvent]:
    there = opened(R1, R2)
    yard = [msgspec.structs.replace(event, scene=YARD) for event in there]
    assert isinstance(yard[0], SceneImported)
    area = msgspec.structs.replace(yard[0].areas[0], map_name="yard")
    yard[0] = msgspec.structs.replace(yard[0], areas=(area,))
    named = SceneRenamed(scene=YARD, name="yard", display_order=1)
    events = (*there, *yard, named)
    return [stamped(e, n, n * 1_000, "given", CommandId("")) for n, e in enumerate(events, 1)]


@pytest.fixture
async def side(tmp_path: Path) -> AsyncIterator[Side]:
    log = Log(happened())
    side = Side(tmp_path, log, len(log.events))
    for (scene, robot), x_m in X_M.items():
        map_name = "yard" if x_m == 4.0 else ""
        report = Report(
            scene=scene, robot=robot, number=1, at_ms=20_000, area=1, x_m=x_m, y_m=0.0,
            heading_rad=0.0, map_name=map_name,
        )  # fmt: skip
        side.live.observe(report)
    yield side
    side.close()


@pytest.fixture
async def client(side: Side) -> AsyncIterator[httpx.AsyncClient]:
    app = application(side, projections.api.m4.router(asked_of(side), ThinRoute))
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
        yield client


async def asked(client: httpx.AsyncClient, path: str, **params: Any) -> Any:
    answer = await client.get(f"/api/fleet/robots/{path}", params=params)
    assert answer.status_code == 200, answer.text
    return answer.json()


@pytest.mark.parametrize(
    ("params", "x_m"),
    [
        ({"sceneId": SCENE}, 1.0),
        ({"sceneId": YARD}, 3.0),
        ({"sceneName": "site"}, 1.0),
        ({"sceneName": "yard"}, 3.0),
        ({"sceneId": SCENE, "sceneName": "yard"}, 1.0),
    ],
)
async def test_all_robots_are_those_of_the_scene_whose_id_goes_before_its_name(
    client: httpx.AsyncClient, params: dict[str, str], x_m: float
) -> None:
    found = await asked(client, "all-all", **params)
    assert {name: row["x"] for name, row in found.items()} == {R1: x_m, R2: x_m + 1}


async def test_raw_reports_come_with_all_robots_only_if_asked_for(
    client: httpx.AsyncClient,
) -> None:
    for value, there in ((None, False), ("false", False), ("true", True)):
        params = {"sceneId": SCENE} | ({} if value is None else {"rawAll": value})
        found = await asked(client, "all-all", **params)
        assert {"raw" in row for row in found.values()} == {there}


@pytest.mark.parametrize(("scene", "robot"), X_M)
async def test_a_robot_is_that_of_the_scene(
    client: httpx.AsyncClient, scene: SceneId, robot: str
) -> None:
    point = await asked(client, "query-point", sceneId=scene, robotName=robot)
    assert point["x"] == X_M[scene, robot]
    (map_,) = await asked(client, f"{scene}/maps/{robot}")
    assert map_["mapName"] == ("yard" if scene == YARD else "hall")
    assert map_["current"] is ((scene, robot) == (YARD, R2))


async def test_a_scene_query_over_the_socket_is_of_its_scene(side: Side) -> None:
    app = application(side, projections.api.wsm.router(asked_of(side)))
    async with connected(app) as socket:
        for scene, x_m in ((SCENE, 1.0), (YARD, 3.0)):
            reply = (await socket.answer("Fleet::Scene::Query", {"sceneId": scene}))["content"]
            assert {name: row["x"] for name, row in reply["robots"].items()} == {
                R1: x_m,
                R2: x_m + 1,
            }
            less = {"sceneId": scene, "excluded": ["robots"], "withRawReport": True}
            reply = (await socket.answer("Fleet::Scene::Query", less))["content"]
            assert "robots" not in reply
