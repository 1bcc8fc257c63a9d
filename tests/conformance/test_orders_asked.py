"""What each field of a request about orders does, from the wire into the order."""

import json
from typing import Any

import msgspec
import pytest

from ledger.ids import OrderId
from ledger.state import Order, StepTask
from tests.commands.api.application import Site, site
from tests.commands.site import BINS, ORDER, R1, SCENE, SECOND, created, opened, task

BASE = "/api/fleet/orders"
STEP = {"location": "AP110"}


async def asked(there: Site, call: str, body: Any) -> Any:
    answer = await there.post(f"{BASE}/{call}", body)
    assert answer.status_code == 200, answer.text
    return answer.json() if answer.content else None


@pytest.fixture(scope="module")
def there() -> Site:
    """One site for all tests that make orders of their own; R1 is off somewhere else."""
    return site(*opened(R1))


async def made(there: Site, **fields: Any) -> Order:
    body = {"sceneId": SCENE, "steps": [STEP]} | fields
    return order_in(there, (await asked(there, "create", body))["orderId"])


def order_in(there: Site, id_: str) -> Order:
    return there.handler.fleet.orders[OrderId(id_)]


# field of the request -> its value, the field of the order, and its value
CREATION: dict[str, tuple[Any, str, Any]] = {
    "externalId": ("wms-1", "external_id", "wms-1"),
    "priority": (-3, "priority", -3),
    "expectedRobotNames": ([R1], "wanted_robots", (R1,)),
    "expectedRobotGroups": (["AMR", "default"], "wanted_groups", ("AMR", "default")),
    "containerId": ("C7", "container", "C7"),
    "containerTypeName": ("pallet", "container_type", "pallet"),
    "containerDir": (1.25, "container_heading_rad", 1.25),
    "keyLocations": (["AP125", BINS[1]], "key_locations", ("AP125", BINS[1])),
    "stepFixed": (True, "sealed", True),
}


@pytest.mark.parametrize("field", CREATION)
async def test_a_field_of_a_new_order_is_kept_and_changes_nothing_else(
    there: Site, field: str
) -> None:
    value, kept_as, kept = CREATION[field]
    plain, order = await made(there), await made(there, **{field: value})
    assert getattr(order, kept_as) == kept != getattr(plain, kept_as)
    same = {"id": plain.id, "steps": plain.steps, kept_as: getattr(plain, kept_as)}
    assert msgspec.structs.replace(order, **same) == plain


async def test_a_new_order_answers_with_its_id_and_the_clients_own_number(there: Site) -> None:
    body = {"sceneId": SCENE, "steps": [STEP]}
    first = await asked(there, "create", body | {"externalId": "wms-1"})
    second = await asked(there, "create", body)
    assert (first["externalId"], second["externalId"]) == ("wms-1", None)
    assert order_in(there, first["orderId"]).external_id == "wms-1"
    assert order_in(there, second["orderId"]).external_id is None


async def test_an_order_is_of_the_scene_that_it_names(there: Site) -> None:
    assert (await made(there)).scene == SCENE
    answer = await there.post(f"{BASE}/create", {"sceneId": "S", "steps": [STEP]})
    assert (answer.status_code, answer.json()["code"]) == (400, "errSceneNotFound")


async def test_key_locations_may_stand_for_steps_that_come_later(there: Site) -> None:
    order = await made(there, steps=[], keyLocations=["AP125"])
    assert (order.steps, order.key_locations, order.sealed) == ((), ("AP125",), False)


# field of a step -> its value, the field of the task, and its value; bin tasks need a bin
STEPS: dict[str, tuple[Any, str, Any]] = {
    "location": (BINS[1], "location", BINS[1]),
    "rbkArgs": ({"binTask": "Load", "n": [1]}, "arguments", '{"binTask":"Load","n":[1]}'),
    "forLoad": (True, "loads", True),
    "forUnload": (True, "unloads", True),
    "withdrawOrderAllowed": (True, "withdrawable", True),
    "nextStepSameOrder": (True, "keeps_robot", True),
}
PLAIN = StepTask(location=BINS[0])


@pytest.mark.parametrize("call", ["create", "add-steps", "update-steps"])
@pytest.mark.parametrize("field", STEPS)
async def test_a_field_of_a_step_is_kept_and_changes_nothing_else(
    there: Site, call: str, field: str
) -> None:
    value, kept_as, kept = STEPS[field]
    plain = {"location": BINS[0]}
    steps = [plain, plain | {field: value}] if call == "create" else [plain, plain]
    order = await made(there, steps=steps)
    at = 1
    if call == "add-steps":
        await asked(there, call, {"orderId": order.id, "steps": [plain | {field: value}]})
        at = 2
    elif call == "update-steps":
        await asked(there, call, {"orderId": order.id, "steps": [{"stepIndex": 1, field: value}]})
    tasks = [step.task for step in order_in(there, order.id).steps]
    assert tasks[at] == msgspec.structs.replace(PLAIN, **{kept_as: kept})
    assert set(tasks[:at]) == {PLAIN}


async def test_an_update_finds_its_step_by_its_place() -> None:
    there = site(*opened(), created(ORDER, *[task()] * 4))
    await asked(
        there, "update-steps", {"orderId": ORDER, "steps": [{"stepIndex": 2, "location": "AP125"}]}
    )
    places = [step.task.location for step in there.handler.fleet.orders[ORDER].steps]
    assert places == ["AP110", "AP110", "AP125", "AP110"]
    answer = await there.post(
        f"{BASE}/update-steps", {"orderId": ORDER, "steps": [{"stepIndex": 4, "location": "AP125"}]}
    )
    assert (answer.status_code, answer.json()["code"]) == (400, "errStepNotFound")


CALLS: dict[str, dict[str, Any]] = {
    "add-steps": {"orderId": "1", "steps": [STEP]},
    "update-steps": {"orderId": "1", "steps": [{"stepIndex": 0, "location": "AP125"}]},
    "delete-steps": {"orderId": "1", "stepIds": ["1-Step1"]},
    "complete-order": {"orderId": "1"},
    "complete-order-batch": {"orderIds": ["1", "2"]},
    "cancel": {"sceneId": SCENE, "orderId": "1"},
    "cancel-batch": {"orderIds": ["1", "2"]},
    "update-priority-batch": {"orderIds": ["1", "2"], "priority": 7},
}


@pytest.mark.parametrize("call", CALLS)
async def test_a_call_reaches_the_orders_that_it_names_and_no_others(
    there: Site, call: str
) -> None:
    ids = [str((await made(there, steps=[STEP, STEP])).id) for _ in "123"]
    body = json.dumps(CALLS[call])
    for number, id_ in zip("123", ids, strict=True):
        body = body.replace(f'"{number}"', f'"{id_}"').replace(f'"{number}-', f'"{id_}-')
    before = dict(there.handler.fleet.orders)
    await asked(there, call, json.loads(body))
    after = there.handler.fleet.orders
    named = ids[:2] if '"2"' in json.dumps(CALLS[call]) else ids[:1]
    assert {id_ for id_ in before if after.get(id_) != before[id_]} == set(named)


async def test_all_orders_of_the_scene_that_is_named_are_cancelled() -> None:
    there = site(*opened(), created(ORDER, task()), created(SECOND, task()))
    answer = await there.post(f"{BASE}/cancel-all", {"sceneId": "S"})
    assert answer.status_code == 400
    assert len(there.handler.fleet.orders) == 2
    await asked(there, "cancel-all", {"sceneId": SCENE})
    assert not there.handler.fleet.orders


async def test_the_priority_is_that_of_the_request() -> None:
    there = site(*opened(), created(ORDER, task()), created(SECOND, task(), priority=9))
    await asked(there, "update-priority-batch", {"orderIds": [ORDER, SECOND], "priority": -4})
    assert {o.priority for o in there.handler.fleet.orders.values()} == {-4}


async def test_the_steps_that_are_named_go() -> None:
    there = site(*opened(), created(ORDER, *[task()] * 4))
    ids = [f"{ORDER}-Step1", f"{ORDER}-Step3"]
    await asked(there, "delete-steps", {"orderId": ORDER, "stepIds": ids})
    left = [step.id for step in there.handler.fleet.orders[ORDER].steps]
    assert left == [f"{ORDER}-Step0", f"{ORDER}-Step2"]
