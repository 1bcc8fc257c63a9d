"""A real server with a simulated fleet, and one good request for every call of the catalogue."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
from websockets.sync.client import ClientConnection, connect

from ledger.scene import ContainerType, Door, Group, Lift, LiftFloor, SceneFile
from tests.conformance.catalogue import Call
from tests.fleetledger.server import CALL_S_MAX, Server, serving, small_file

ROBOTS = 4
DOOR, LIFT = 1, 1


def scene_file() -> SceneFile:
    """A small warehouse with a door, a lift, a type of container and a second robot group."""
    file = small_file(robots=ROBOTS)
    area = file.areas[0]
    door = Door(id=DOOR, name="gate", area=area.id, paths=(area.paths[0].key,), simulated=True)
    floor = LiftFloor(name="1", area=area.id, point=area.points[0].name)
    return msgspec.structs.replace(
        file,
        groups=(*file.groups, Group(id=1, name="AMR")),
        container_types=(ContainerType(name="pallet"),),
        doors=(door,),
        lifts=(Lift(id=LIFT, name="lift", floors=(floor,), simulated=True),),
    )


class Answer(msgspec.Struct, frozen=True):
    """What came back, over HTTP or the WebSocket alike."""

    status: int
    body: Any


class Plant:
    """Sends calls; makes what a good request needs, such as an order that can be cancelled."""

    def __init__(self, server: Server, file: SceneFile, socket: ClientConnection) -> None:
        self.server = server
        self.socket = socket
        self.file = file
        self.area = self.file.areas[0]
        self.scene = server.scene
        self.bins = [str(b.name) for b in self.area.bins]
        self.point = str(self.area.points[0].name)
        self.robots = [str(r.name) for r in self.file.robots]
        self._numbers = count(1)
        self.done = ""

    def unique(self, text: str) -> str:
        return f"{text}-{next(self._numbers)}"

    def send(self, call: Call, request: dict[str, Any]) -> Answer:
        """Send a request as `good` gives it: parts `path`, `query`, `body` and `content`."""
        if call.method == "WS":
            return self._ask(call.path, request["content"])
        path = call.path.format(**request.get("path", {}))
        answer = self.server.client.request(
            call.method, path, params=request.get("query"), content=json.dumps(request.get("body"))
        )
        return Answer(answer.status_code, answer.json() if answer.content else None)

    def frame(self, frame: dict[str, Any]) -> dict[str, Any]:
        """Send a frame over the WebSocket; gives the frame that replies."""
        self.socket.send(json.dumps(frame))
        reply: dict[str, Any] = json.loads(self.socket.recv(timeout=CALL_S_MAX))
        return reply

    def _ask(self, action: str, content: Any) -> Answer:
        reply = self.frame({"id": "1", "action": action, "content": json.dumps(content)})
        body = json.loads(reply["content"])
        return Answer(body["error"] if reply["action"].endswith("::Error") else 200, body)

    def good(self, call: Call) -> dict[str, Any]:
        """Give a request that is answered with 200, every documented field filled in."""
        return GOOD[call.id](self)

    def order(self, **fields: Any) -> str:
        """Make an order that waits for more steps; nobody takes it, for all are off duty."""
        steps = [self.step() for _ in range(3)]
        body = {"sceneId": self.scene, "stepFixed": False, "steps": steps} | fields
        return str(self.server.post("/api/fleet/orders/create", body)["orderId"])

    def step(self, **fields: Any) -> dict[str, Any]:
        return {
            "location": self.bins[0],
            "rbkArgs": {"binTask": "Load"},
            "forLoad": True,
            "forUnload": False,
            "withdrawOrderAllowed": True,
            "nextStepSameOrder": False,
        } | fields

    def steps_of(self, order: str) -> list[dict[str, Any]]:
        found = self.server.get("/api/fleet/orders/query-order-detail", orderId=order)
        steps: list[dict[str, Any]] = found["steps"]
        return steps

    def robot(self) -> dict[str, Any]:
        return {
            "robotName": self.unique("New"),
            "disabled": False,
            "remark": "spare",
            "groupId": self.file.groups[0].id,
            "tags": ["a"],
            "vendor": "Seer",
            "selfBinNum": 2,
            "image": {"any": 1},
            "connectionType": "GwWs",
            "robotIp": "10.0.0.1",
            "robotPortStart": 19204,
            "ssl": False,
            "gwAuthId": "id",
            "gwAuthSecret": "secret",
            "simulated": False,
            "plusOne": False,
        }

    def added(self) -> str:
        """Add a robot that nobody needs."""
        body = self.robot()
        self.server.post(f"/api/fleet/scenes/{self.scene}/robot/create", body)
        return str(body["robotName"])

    def unit(self) -> dict[str, Any]:
        """A reservation of ground far from everything, for nobody to be in the way."""
        corners = [(500, 500), (501, 500), (501, 501), (500, 501)]
        return {
            "unitId": self.unique("unit"),
            "owner": "conveyor",
            "reason": "maintenance",
            "sceneId": self.scene,
            "sceneName": self.file.name,
            "areaId": self.area.id,
            "areaName": self.area.name,
            "pointNames": [],
            "pathKeys": [],
            "spatialZones": [{"type": "Rect", "points": [{"x": x, "y": y} for x, y in corners]}],
        }


Make = Callable[[Plant], dict[str, Any]]


def _orders(plant: Plant) -> dict[str, Any]:
    return {"body": {"orderIds": [plant.order(), plant.order()]}}


def _named(**fields: Any) -> Make:
    def make(plant: Plant) -> dict[str, Any]:
        body = {"sceneId": plant.scene, "robotNames": plant.robots[:2], **fields}
        return {"body": body}

    return make


def _in_scene(**fields: Any) -> Make:
    def make(plant: Plant) -> dict[str, Any]:
        body = {"robotNames": plant.robots[:2], **fields}
        return {"path": {"sceneId": plant.scene}, "body": body}

    return make


def _find(**fields: Any) -> Make:
    everything = {"entityName": "TransportOrder", "query": {"type": "All"}, "fuzzy": "TO"}
    whole = everything | {"projection": None, "sort": ["-createdOn"]}
    return lambda plant: {"body": whole | fields}


def _create(plant: Plant) -> dict[str, Any]:
    steps = [plant.step(), plant.step(location=plant.bins[1], forLoad=False, forUnload=True)]
    steps[1]["rbkArgs"] = {"binTask": "Unload"}
    return {
        "body": {
            "sceneId": plant.scene,
            "externalId": plant.unique("wms"),
            "priority": 3,
            "expectedRobotNames": plant.robots[:1],
            "expectedRobotGroups": [plant.file.groups[0].name],
            "containerId": "C-1",
            "containerTypeName": "pallet",
            "containerDir": 1.5,
            "keyLocations": plant.bins[:2],
            "stepFixed": True,
            "steps": steps,
        }
    }


def _update_steps(plant: Plant) -> dict[str, Any]:
    steps = [{"stepIndex": 1} | plant.step(location=plant.bins[1])]
    return {"body": {"orderId": plant.order(), "steps": steps}}


def _delete_steps(plant: Plant) -> dict[str, Any]:
    order = plant.order()
    return {"body": {"orderId": order, "stepIds": [plant.steps_of(order)[1]["id"]]}}


def _series(plant: Plant) -> dict[str, Any]:
    body = plant.robot() | {"robotNamePrefix": plant.unique("Row"), "count": 2}
    body |= {"robotIpStart": "10.0.1.1"}
    for name in ("robotName", "disabled", "robotIp"):
        del body[name]
    return {"path": {"sceneId": plant.scene}, "body": body}


def _update(plant: Plant) -> dict[str, Any]:
    body = plant.robot() | {"robotName": plant.added(), "remark": plant.unique("changed")}
    return {"path": {"sceneId": plant.scene}, "body": body}


def _update_batch(plant: Plant) -> dict[str, Any]:
    config = plant.robot() | {"remark": plant.unique("changed")}
    del config["robotName"]
    body = {"robotNames": [plant.added()], "config": config}
    return {"path": {"sceneId": plant.scene}, "body": body}


def _remove(plant: Plant) -> dict[str, Any]:
    return {"path": {"sceneId": plant.scene}, "body": {"robotNames": [plant.added()]}}


GOOD: dict[str, Make] = {
    "orders-create": _create,
    "orders-add-steps": lambda p: {"body": {"orderId": p.order(), "steps": [p.step()]}},
    "orders-update-steps": _update_steps,
    "orders-delete-steps": _delete_steps,
    "orders-complete": lambda p: {"body": {"orderId": p.order()}},
    "orders-complete-batch": _orders,
    "orders-cancel": lambda p: {"body": {"sceneId": p.scene, "orderId": p.order()}},
    "orders-cancel-batch": _orders,
    "orders-cancel-all": lambda p: {"body": {"sceneId": p.scene}},
    "orders-update-priority-batch": lambda p: {"body": {"orderIds": [p.order()], "priority": 7}},
    "orders-retry-failed": _orders,
    "entity-find-many": _find(skip=0, limit=5),
    "entity-find-page": _find(pageNo=1, pageSize=5),
    "entity-find-one": _find(),
    "orders-query-detail": lambda p: {"query": {"orderId": p.done}},
    "ws-order-detail": lambda p: {"content": {"orderId": p.done}},
    "robots-create": lambda p: {"path": {"sceneId": p.scene}, "body": p.robot()},
    "robots-create-batch": lambda p: {"path": {"sceneId": p.scene}, "body": [p.robot(), p.robot()]},
    "robots-create-auto-batch": _series,
    "robots-remove": _remove,
    "robots-update-config": _update,
    "robots-update-config-batch": _update_batch,
    "robots-reconnect": _named(),
    "robots-off-duty": _named(offDuty=True),
    "robots-all": lambda p: {
        "query": {"sceneId": p.scene, "sceneName": p.file.name, "rawAll": "true"}
    },
    "robots-master": _named(on=True),
    "robots-query-point": lambda p: {"query": {"sceneId": p.scene, "robotName": p.robots[0]}},
    "robots-maps": lambda p: {"path": {"sceneId": p.scene, "robotName": p.robots[0]}},
    "robots-clear-alarm": _in_scene(),
    "robots-set-soft-emc": _in_scene(enable=False),
    "robots-disabled": _in_scene(disabled=False),
    "robots-auto-recovery": _in_scene(),
    "ws-scene-query": lambda p: {
        "content": {
            "sceneId": p.scene,
            "excluded": [],
            "withRawReport": False,
            "orderQueryType": "AllOrders",
        }
    },
    "external-map-res-request": lambda p: {"body": [p.unit()]},
    "external-map-res-release": lambda p: {"body": ["unit-0"]},
    "external-map-res-release-by-owner": lambda p: {
        "body": {
            "owner": "nobody",
            "sceneId": p.scene,
            "sceneName": p.file.name,
            "areaId": p.area.id,
            "areaName": p.area.name,
        }
    },
    "external-map-res-release-all": lambda p: {},
}


@contextmanager
def plant_in(folder: Path) -> Iterator[Plant]:
    """Start a server that has carried out one order, and whose robots now rest."""
    with serving(folder, "--auth", "none", "--simulate", "--speed", "20") as server:
        file = scene_file()
        server.post("/api/fleet/scenes/import", msgspec.to_builtins(file))
        with connect(f"{server.url.replace('http', 'ws')}/wsm", max_size=None) as socket:
            plant = Plant(server, file, socket)
            plant.done = server.order(plant.bins[0], plant.bins[1])
            server.until_finished(plant.done)
            everybody = {"sceneId": plant.scene, "robotNames": plant.robots, "offDuty": True}
            server.post("/api/fleet/robots/off-duty", everybody)
            yield plant
