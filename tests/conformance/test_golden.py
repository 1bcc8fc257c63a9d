"""Every example of the dialect on a real server: requests are taken, answers have their form.

The examples are of another plant, so names and ids in them are replaced by those of ours; nothing
else is. What each example leads to is tested on its own in tests/commands/api (requests),
tests/projections/api (answers) and tests/fleetledger/test_golden_server.py (from one to the other).
"""

import json
import re
from collections.abc import Callable
from typing import Any

import pytest

from tests.conformance.catalogue import Call
from tests.conformance.plant import Plant
from tests.golden import KEPT, example, same_form

GOOD = {"ok": True, "result": {}, "errMsg": None}
ORDERS, ROBOTS = "/api/fleet/orders", "/api/fleet/robots"
OF_SCENE, OF_ROBOTS = "/api/fleet/scenes/{scene}/robot", f"{ROBOTS}/{{scene}}"
RESOURCES, FIND = "/api/fleet/external-map-res", "/api/entity/find"
PATHS = {
    "entity-find-many": f"{FIND}/many",
    "entity-find-page": f"{FIND}/page",
    "external-map-res-request": f"{RESOURCES}/request",
    "external-map-res-release": f"{RESOURCES}/release",
    "external-map-res-release-by-owner": f"{RESOURCES}/release-by-owner",
    "orders-create": f"{ORDERS}/create",
    "orders-add-steps": f"{ORDERS}/add-steps",
    "orders-update-steps": f"{ORDERS}/update-steps",
    "orders-delete-steps": f"{ORDERS}/delete-steps",
    "orders-complete": f"{ORDERS}/complete-order",
    "orders-complete-batch": f"{ORDERS}/complete-order-batch",
    "orders-cancel": f"{ORDERS}/cancel",
    "orders-cancel-batch": f"{ORDERS}/cancel-batch",
    "orders-cancel-all": f"{ORDERS}/cancel-all",
    "orders-update-priority-batch": f"{ORDERS}/update-priority-batch",
    "orders-retry-failed": f"{ORDERS}/retry-failed-orders",
    "robots-create": f"{OF_SCENE}/create",
    "robots-create-batch": f"{OF_SCENE}/create/batch",
    "robots-create-auto-batch": f"{OF_SCENE}/create/auto-batch",
    "robots-remove": f"{OF_SCENE}/remove",
    "robots-update-config": f"{OF_SCENE}/update/config",
    "robots-update-config-batch": f"{OF_SCENE}/update/config/batch",
    "robots-reconnect": f"{ROBOTS}/reconnect",
    "robots-off-duty": f"{ROBOTS}/off-duty",
    "robots-master": f"{ROBOTS}/master",
    "robots-clear-alarm": f"{OF_ROBOTS}/clear-alarm",
    "robots-set-soft-emc": f"{OF_ROBOTS}/set-soft-emc",
    "robots-disabled": f"{OF_ROBOTS}/disabled",
    "robots-auto-recovery": f"{OF_ROBOTS}/auto-recovery",
}
OUR_OWN = {"robots-create", "robots-create-batch", "robots-create-auto-batch"}  # robots to be made
SPARE = {"robots-remove", "robots-disabled"}  # robots that nobody misses
SPARE |= {"robots-update-config", "robots-update-config-batch"}
BY_ENTRY = {"orders-cancel-batch", "robots-update-config-batch", "robots-reconnect"}
BY_ENTRY |= {"robots-off-duty", "robots-master", "robots-clear-alarm", "robots-set-soft-emc"}
BY_ENTRY |= {"robots-auto-recovery", "orders-complete-batch"}
# of a robot with nothing to say for itself
OPTIONAL = {"cuOrderId", "cuStepIndex", "cuStepLocation", "op", "oFaultMsg", "autoOrder"}
OPTIONAL |= {"targetPoint", "connectMsg", "navId", "navStatus", "ttId", "ttStatus", "loads", "p"}


def stems(side: str) -> list[str]:
    """Name the examples of requests or of responses."""
    return sorted(p.name.removesuffix(f".{side}.json") for p in KEPT["m4"].glob(f"*.{side}.json"))


REQUESTS, RESPONSES = stems("request"), stems("response")


def call_of(stem: str) -> str:
    """Name the call: `entity-find-many` of `entity-find-many.2`."""
    return stem.partition(".")[0]


class Ours:
    """Replaces the names of an example: the same ones by the same ones."""

    def __init__(self, plant: Plant, stem: str) -> None:
        self.plant, self.call = plant, call_of(stem)
        self.known: dict[str, str] = {}
        self.left: dict[str, list[str]] = {
            "bin": [*plant.bins],
            "robot": [*plant.robots],
            "point": [str(p.name) for p in plant.area.points],
            "path": [str(p.key) for p in plant.area.paths[::2]],
        }

    def body(self, value: Any, key: str = "") -> Any:
        """Give a value with our names in it; `key` says of what kind it is."""
        if isinstance(value, dict):
            return {k: self.body(v, k) for k, v in value.items()}
        if isinstance(value, list):
            return [self.body(item, key) for item in value]
        if key == "areaId":
            return self.plant.area.id
        if not isinstance(value, str):
            return value
        if value in self.known:
            return self.known[value]
        new = self._name(value, key)
        if new is not None:
            self.known[value] = new
        return value if new is None else new

    def _name(self, value: str, key: str) -> str | None:
        if key == "sceneId":
            return self.plant.scene
        if key == "sceneName":
            return str(self.plant.file.name)
        if key in ("robotNames", "robotName", "robotNamePrefix"):
            return self._robot(value)
        if key == "location":
            return self.left["bin"].pop(0)
        if key == "pointNames":
            return self.left["point"].pop(0)
        if key == "pathKeys":
            return self.left["path"].pop(0)
        if key == "stepIds":
            order = next(iter(self.known.values()))
            return str(self.plant.steps_of(order)[len(self.known)]["id"])
        if re.fullmatch(r"TO\d{8}-\d{6}", value):
            if self.call.startswith("entity-find"):
                return self.plant.done
            return self.plant.order(steps=[self.plant.step() for _ in range(6)])
        if key == "fuzzy":
            return self.plant.done[2:10]
        return None

    def _robot(self, value: str) -> str:
        if self.call in OUR_OWN:
            return self.plant.unique(value)
        return self.plant.added() if self.call in SPARE else self.left["robot"].pop(0)


def send(plant: Plant, stem: str, body: Any) -> Any:
    """Send a request that is taken; gives its answer."""
    path = PATHS[call_of(stem)].replace("{scene}", plant.scene)
    call = Call(
        id=stem, title="", method="POST", path=path, request=(), response=(), response_type=None
    )
    answer = plant.send(call, {"body": body})
    assert answer.status == 200, answer.body
    return answer.body


@pytest.fixture
def free_ground(plant: Plant) -> None:
    """Examples use one unit id for different ground."""
    plant.server.client.post(f"{RESOURCES}/release-all").raise_for_status()


OVER_HTTP = [stem for stem in REQUESTS if not stem.startswith("ws-")]


@pytest.mark.usefixtures("free_ground")
@pytest.mark.parametrize("stem", OVER_HTTP)
def test_every_example_of_a_request_is_taken_and_answered_in_its_form(
    plant: Plant, stem: str
) -> None:
    asked = example("m4", f"{stem}.request")
    ours = Ours(plant, stem)
    body = ours.body(asked)
    same_form(asked, body)
    found = send(plant, stem, body)
    call = call_of(stem)
    if call in BY_ENTRY:
        names = body.get("orderIds") or body["robotNames"]
        assert found == dict.fromkeys(names, GOOD)
        same_form([*example("m4", "orders-complete-batch.response").values()], [*found.values()])
    elif call == "orders-retry-failed":  # of ours none has a fault
        assert list(found) == body["orderIds"]
        for entry in found.values():
            assert entry == {"ok": False, "result": {}, "errMsg": entry["errMsg"]}
            assert entry["errMsg"]
    elif call == "external-map-res-request":
        assert found == example("m4", "external-map-res-request.response")
    elif call == "orders-create":
        same_form(example("m4", f"{stem}.response"), found)
        assert found["externalId"] is None
    elif call == "entity-find-page":
        page_form(asked, found)
    elif call == "entity-find-many":
        same_form(example("m4", f"{stem}.response")[:1], found)
        asked_for_ids = (asked["query"] or {}).get("operator") == "In"
        assert not asked_for_ids or [row["id"] for row in found] == [plant.done]
        assert 1 <= len(found) <= asked.get("limit", len(found))
    else:
        assert found is None
    if call == "robots-set-soft-emc":  # and go on
        send(plant, stem, body | {"enable": False})


def page_form(asked: Any, found: Any) -> None:
    expected = example("m4", "entity-find-page.response")
    expected["page"] = example("m4", "entity-find-many.response")[:1]  # with its decimal points
    same_form(expected, found)
    assert (found["pageNo"], found["pageSize"]) == (asked["pageNo"], asked["pageSize"])
    assert len(found["page"]) == min(found["total"], asked["pageSize"])


def test_the_example_of_a_frame_is_answered_by_the_example_of_a_reply(plant: Plant) -> None:
    asked = example("m4", "ws-order-detail.request")
    assert json.loads(asked["content"]).keys() == {"orderId"}
    asked["content"] = json.dumps({"orderId": plant.done})
    reply, expected = plant.frame(asked), example("m4", "ws-order-detail.response")
    assert (reply["action"], type(reply["content"])) == (expected["action"], str)
    detail_form(json.loads(reply["content"]))


def detail_form(found: Any) -> None:
    expected = example("m4", "orders-query-detail.response")
    del expected["allocationReject"]  # there is none where an order has its robot
    found = {key: value for key, value in found.items() if key != "allocationReject"}
    same_form(expected, found)


def the_detail(plant: Plant) -> None:
    detail_form(plant.server.get(f"{ORDERS}/query-order-detail", orderId=plant.done))
    waiting = plant.server.get(f"{ORDERS}/query-order-detail", orderId=plant.order())
    assert (waiting["currentStepIndex"], waiting["doneStepIndex"]) == (-1, -1)


def the_robots(plant: Plant) -> None:
    found = plant.server.get(f"{ROBOTS}/all-all", sceneId=plant.scene, rawAll="true")
    (expected,) = example("m4", "robots-all.response").values()
    wanted = {key: value for key, value in expected.items() if key not in OPTIONAL}
    for name in plant.robots:
        shown = {key: value for key, value in found[name].items() if key not in OPTIONAL}
        shown["bins"] = [{"index": b["index"], "status": b["status"]} for b in shown["bins"]]
        same_form(wanted, shown)
        assert shown["name"] == name


def the_point(plant: Plant) -> None:
    params = {"sceneId": plant.scene, "robotName": plant.robots[0]}
    found = plant.server.get(f"{ROBOTS}/query-point", **params)
    same_form(example("m4", "robots-query-point.response"), found)


def the_maps(plant: Plant) -> None:
    found = plant.server.get(f"{ROBOTS}/{plant.scene}/maps/{plant.robots[0]}")
    same_form(example("m4", "robots-maps.response"), found)
    area = plant.area
    assert found == [{"mapName": area.map_name, "mapMd5": area.map_digest, "current": True}]


def the_refusal(plant: Plant) -> None:
    body = [plant.unit() | {"owner": ""}]
    answer = plant.server.client.post(f"{RESOURCES}/request", json=body)
    expected = example("m4", "external-map-res-request.3.response")
    same_form(expected, answer.json())
    said = answer.json() | {"message": expected["message"]}  # in other words
    assert (answer.status_code, said) == (400, expected)


ASKED: dict[str, Callable[[Plant], None]] = {
    "orders-query-detail": the_detail,
    "robots-all": the_robots,
    "robots-query-point": the_point,
    "robots-maps": the_maps,
    "external-map-res-request.3": the_refusal,
}


@pytest.mark.parametrize("stem", ASKED)
def test_an_answer_to_no_example_has_its_form_too(plant: Plant, stem: str) -> None:
    ASKED[stem](plant)


# five seconds of waiting for ground that nobody clears: in process, where time is the test's own
IN_PROCESS = {"external-map-res-request.2": {"ok": False}}


def test_no_example_is_left_out() -> None:
    assert {call_of(stem) for stem in OVER_HTTP} == PATHS.keys()
    with_requests = {stem for stem in RESPONSES if stem in REQUESTS} - IN_PROCESS.keys()
    assert set(RESPONSES) == with_requests | ASKED.keys() | IN_PROCESS.keys()
    for stem, says in IN_PROCESS.items():  # tests/conformance/test_ground_asked.py
        assert example("m4", f"{stem}.response") == says
