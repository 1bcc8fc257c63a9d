"""The life of a scene over HTTP, on a real server with simulated robots, restarts in between."""

from pathlib import Path
from typing import Any

import msgspec

from commands.imports.scene_json import write_scene
from ledger.scene import SceneFile
from tests.fleetledger.server import Server, order_body, serving, small_file

OPTIONS = ("--auth", "none", "--simulate", "--speed", "10")
FILE = msgspec.structs.replace(small_file(robots=2), name="hall")


def refused(server: Server, path: str, body: Any) -> str:
    answer = server.client.post(path, json=body)
    assert answer.status_code == 400, answer.text
    return str(answer.json()["code"])


def fill(server: Server, file: SceneFile) -> str:
    answer = server.client.post("/api/fleet/scenes/import", content=write_scene(file))
    assert answer.status_code == 200, answer.text
    return str(answer.json()["id"])


def bins(server: Server, scene: str) -> list[str]:
    names: list[str] = server.get(f"/api/fleet/scenes/{scene}/list-points-bins")["bins"]
    return names


def test_a_scene_lives_through_restarts(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with serving(data, *OPTIONS) as server:
        scene = server.post("/api/fleet/scenes/create", {"name": "hall"})["id"]
        assert server.get(f"/api/fleet/scenes/{scene}/ready-status") is False
        assert fill(server, FILE) == scene
        of = f"/api/fleet/scenes/{scene}"
        server.post(f"{of}/basic/patch", {"displayOrder": 5})
        server.post(f"{of}/dispatch-pause", {"paused": True})
        here, there, *_ = bins(server, scene)
        order = server.post("/api/fleet/orders/create", order_body(scene, here, there))["orderId"]
        server.until(lambda e: e["type"] == "AssignmentRejected" and e["order"] == order)
        assert server.stop() == 0
    with serving(data, *OPTIONS) as server:
        server.post(f"{of}/disable", {"disabled": True})
        another = order_body(scene, here, there)
        assert refused(server, "/api/fleet/orders/create", another) == "errSceneDisabled"
        assert refused(server, "/api/fleet/scenes/remove", {"ids": [scene]}) == "errSceneHasOrders"
        assert server.found(order)[order]["status"] == "ToBeAllocated"
        server.kill()
    with serving(data, *OPTIONS) as server:
        (listed,) = server.get("/api/fleet/scenes/list")
        assert (listed["disabled"], listed["displayOrder"]) == (True, 5)
        assert (
            refused(server, f"{of}/config/patch", {"cpnEnabled": True})
            == "errSceneConfigUnsupported"
        )
        server.post(f"{of}/config/patch", {"parkingPaused": True})
        server.post(f"{of}/disable", {"disabled": False})
        server.post(f"{of}/dispatch-pause", {"paused": False})
        server.until_finished(order)
        assert server.get(f"{of}/ready-status") is True
        robots = server.get("/api/fleet/robots/all-all", sceneId=scene)
        costs = server.post(f"{of}/calc-move-costs", {name: bins(server, scene) for name in robots})
        assert all(metres >= 0 for places in costs.values() for metres in places.values())
        server.post("/api/fleet/scenes/remove", {"ids": [scene]})
        assert server.get("/api/fleet/scenes/list") == []
        assert server.stop() == 0
    with serving(data, *OPTIONS) as server:
        assert server.get("/api/fleet/scenes/list") == []
        assert server.client.get(f"{of}/config").status_code == 400
        assert server.found(order)[order]["sceneName"] == "hall"
        renewed = fill(server, FILE)
        assert renewed != scene
        sent = server.post("/api/fleet/orders/create", order_body(renewed, here, there))
        server.until_finished(sent["orderId"])
        state = server.client.get("/api/ledger/state").content
        assert f'"{scene}"'.encode() in state  # its name is kept
