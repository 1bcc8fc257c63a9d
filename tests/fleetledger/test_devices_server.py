"""Doors and lifts over HTTP, on a server with simulated ones and a house of two floors."""

from collections.abc import Iterator
from pathlib import Path as FilePath

import msgspec
import pytest

from commands.imports.scene_json import write_scene
from ledger.ids import PointName, RobotName, path_key
from ledger.scene import Door, Lift, LiftFloor, RobotConfig, SceneFile
from tests.fleetledger.server import Server, serving
from tests.laws.test_area_laws import floor

DEVICES = "/api/fleet/devices"
LONG = "x" * 5_000


def house() -> SceneFile:
    ends = (
        (PointName("F1-P1-0"), PointName("F1-P2-0")),
        (PointName("F1-P1-1"), PointName("F1-P2-1")),
    )
    doors = tuple(
        Door(
            id=number,
            name=f"gate {number}",
            area=1,
            paths=(path_key(a, b), path_key(b, a)),
            simulated=True,
        )
        for number, (a, b) in enumerate(ends, 1)
    )
    floors = (LiftFloor(name="G", area=1), LiftFloor(name="1", area=2))
    lift = Lift(id=1, name="lift", floors=floors, door_s=0.5, floor_s=0.5, simulated=True)
    silent = msgspec.structs.replace(doors[0], id=3, name="silent", simulated=False)
    robots = tuple(RobotConfig(name=RobotName(f"R{n}"), simulated=True) for n in range(2))
    return SceneFile(
        name="house",
        areas=(floor(1), floor(2)),
        doors=(*doors, msgspec.structs.replace(silent, paths=(path_key(*ends[1]),), disabled=True)),
        lifts=(lift,),
        robots=robots,
    )


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder: FilePath = tmp_path_factory.mktemp("house")
    file = folder / "house.json"
    file.write_bytes(write_scene(house()))
    options = ("--scene", str(file), "--simulate", "--auth", "none", "--speed", "5")
    with serving(folder / "data", *options) as running:
        yield running


def until(server: Server, path: str, id_: str, **fields: object) -> dict[str, object]:
    """Ask until the device is so; the server's own limit on the number of questions ends it."""
    for _ in range(20_000):
        row: dict[str, object] = server.get(path)[id_]
        if all(row[name] == value for name, value in fields.items()):
            return row
    raise AssertionError(row)


def test_doors_open_and_close_as_asked(server: Server) -> None:
    path = f"/api/fleet/scenes/{server.scene}/door"
    row = until(server, path, "1", online=True, status="Closed")
    assert set(row) == {
        "id",
        "name",
        "disabled",
        "online",
        "uTime",
        "status",
        "fault",
        "faultMsg",
        "openRobots",
    }
    assert (row["id"], row["name"], row["disabled"], row["fault"]) == (1, "gate 1", False, False)
    body = {"sceneId": server.scene, "ids": [1, 3, 9], "remark": "post"}
    answer = server.post(f"{DEVICES}/doors/open-batch", body)
    assert {key: entry["ok"] for key, entry in answer.items()} == {
        "1": True,
        "3": False,
        "9": False,
    }
    assert "disabled" in answer["3"]["errMsg"]
    assert "no door with id 9" in answer["9"]["errMsg"]
    until(server, path, "1", status="Opened")
    until(server, path, "1", status="Closed")


def test_doors_are_kept_open_until_they_are_let_go_or_closed(server: Server) -> None:
    path = f"/api/fleet/scenes/{server.scene}/door"
    keep = {"sceneId": server.scene, "ids": [1, 2], "remark": "moving house"}
    answer = server.post(f"{DEVICES}/doors/keep-open", keep)
    assert answer == {n: {"ok": True, "result": {}, "errMsg": None} for n in ("1", "2")}
    for id_ in ("1", "2"):
        until(server, path, id_, status="Opened", openRobots=[])
    server.post(f"{DEVICES}/doors/keep-open", {**keep, "ids": [1], "keepOpen": False})
    server.post(f"{DEVICES}/doors/close-batch", {"sceneId": server.scene, "ids": [2]})
    for id_ in ("1", "2"):
        until(server, path, id_, status="Closed")


def test_a_lift_comes_stays_and_goes(server: Server) -> None:
    path = f"/api/fleet/scenes/{server.scene}/lift"
    row = until(server, path, "1", online=True)
    assert set(row) == {
        "id",
        "name",
        "disabled",
        "online",
        "uTime",
        "auto",
        "cf",
        "tf",
        "doors",
        "people",
        "fault",
        "faultMsg",
    }
    body = {"sceneId": server.scene, "liftId": 1, "toAreaId": 2, "remark": "r"}
    assert server.post(f"{DEVICES}/lifts/keep-open", body) is None
    until(server, path, "1", cf="1", doors=["Opened"])
    assert (
        server.post(f"{DEVICES}/lifts/cancel-open", {"sceneId": server.scene, "liftId": 1}) is None
    )
    until(server, path, "1", cf="1", doors=["Closed"])


def test_a_robot_passes_and_the_scene_query_says_for_whom_the_door_is(server: Server) -> None:
    robots = server.get("/api/fleet/robots/all-all", sceneId=server.scene)
    assert sorted(row["areaId"] for row in robots.values()) == [1, 2]
    name = next(name for name, row in robots.items() if row["areaId"] == 1)
    path = f"/api/fleet/scenes/{server.scene}/door"
    steps = [{"location": "F1-P3-0"}, {"location": "F1-P0-0"}]
    body = {"sceneId": server.scene, "stepFixed": True, "steps": steps}
    order = server.post("/api/fleet/orders/create", body)["orderId"]
    until(server, path, "1", status="Opened", openRobots=[name])
    doors = server.post(f"/api/fleet/scenes/{server.scene}/query-all", {})["doors"]
    assert set(doors) == {"1", "2", "3"}
    server.until_finished(order)
    until(server, path, "1", status="Closed", openRobots=[])


DOORS = ("open-batch", "close-batch", "keep-open")


@pytest.mark.parametrize(
    ("call", "change", "code"),
    [
        *((f"doors/{call}", {"sceneId": ""}, "errSceneIdBlank") for call in DOORS),
        *((f"doors/{call}", {"sceneId": "nowhere"}, "errSceneNotFound") for call in DOORS),
        *((f"doors/{call}", {"ids": None}, "errFieldInvalid") for call in DOORS),
        *((f"doors/{call}", {"ids": ["1"]}, "errFieldInvalid") for call in DOORS),
        *((f"doors/{call}", {"ids": [2**40]}, "errFieldInvalid") for call in DOORS),
        *((f"doors/{call}", {"ids": [1] * 1_001}, "errFieldInvalid") for call in DOORS),
        *((f"doors/{call}", {"remark": LONG}, "errFieldInvalid") for call in DOORS),
        ("doors/keep-open", {"keepOpen": "yes"}, "errFieldInvalid"),
        ("lifts/keep-open", {"liftId": 9}, "errLiftNotFound"),
        ("lifts/keep-open", {"toAreaId": 9}, "errLiftAreaNotFound"),
        ("lifts/keep-open", {"toAreaId": None}, "errFieldInvalid"),
        ("lifts/keep-open", {"liftId": 1.5}, "errFieldInvalid"),
        ("lifts/cancel-open", {"liftId": 9}, "errLiftNotFound"),
        ("lifts/cancel-open", {"sceneId": "nowhere"}, "errSceneNotFound"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_happens(
    server: Server, call: str, change: dict[str, object], code: str
) -> None:
    good = {"sceneId": server.scene, "ids": [1], "liftId": 1, "toAreaId": 1, "remark": "r"}
    answer = server.client.post(f"{DEVICES}/{call}", json=good | change)
    assert (answer.status_code, answer.json()["code"]) == (400, code), answer.text


def test_no_text_makes_a_fault_of_ours(server: Server) -> None:
    for remark in ("\\ud800", "\\u0000", "\\uffff"):
        raw = f'{{"sceneId":"{server.scene}","ids":[1],"remark":"{remark}"}}'
        answer = server.client.post(f"{DEVICES}/doors/close-batch", content=raw)
        assert answer.status_code in (200, 400), answer.text


def test_the_state_of_an_unknown_scene_is_refused(server: Server) -> None:
    for kind in ("door", "lift"):
        answer = server.client.get(f"/api/fleet/scenes/nowhere/{kind}")
        assert (answer.status_code, answer.json()["code"]) == (400, "errSceneNotFound")
