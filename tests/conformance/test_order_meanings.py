"""What each field of an answered order says: one change of the order, one change of the answer.

How orders come to be so is told in tests/ledger/test_evolve_order.py.
"""

from typing import Any

import msgspec
import pytest

from ledger.ids import OrderId, RobotName, SceneId, StepId
from ledger.state import Order, OrderKind, OrderStatus, Reject, Step, StepStatus
from projections.api.m4_order_rows import record
from projections.api.m4_orders import detail, reject_row
from projections.fields import BY_NAME, SHOWN, row
from tests.conformance.full import full_order

replace = msgspec.structs.replace
ORDER = full_order()
FIRST, SECOND = ORDER.steps
WHY = Reject(code="NoRobot", robots={RobotName("R1"): "Charging", RobotName("R2"): "RobotOffline"})
SAYS_WHY = {"code": "NoRobot", "params": [{"R1": "Charging"}, {"R2": "RobotOffline"}]}


def step(of: Step = FIRST, **task: Any) -> Step:
    return replace(of, task=replace(of.task, **task))


# field -> what changes in the order, what the field says then, and which others change with it
FIELDS: dict[str, tuple[dict[str, Any], Any, set[str]]] = {
    "id": ({"id": OrderId("TO2")}, "TO2", set()),
    "sceneId": ({"scene": SceneId("2" * 24)}, "2" * 24, set()),
    "status": ({"status": OrderStatus.PENDING}, "Pending", set()),
    "kind": ({"kind": OrderKind.CHARGING}, "Charging", set()),
    "externalId": ({"external_id": "wms-2"}, "wms-2", set()),
    "priority": ({"priority": 7}, 7, set()),
    "containerId": ({"container": "C-2"}, "C-2", set()),
    "containerTypeName": ({"container_type": "box"}, "box", set()),
    "containerDir": ({"container_heading_rad": -0.5}, -0.5, set()),
    "expectedRobotNames": ({"wanted_robots": (RobotName("R8"),)}, ["R8"], set()),
    "expectedRobotGroups": ({"wanted_groups": ("a", "b")}, ["a", "b"], set()),
    "keyLocations": ({"key_locations": ("LM1", "B9")}, ["LM1", "B9"], set()),
    "loadPoint": ({"steps": (step(location="B7"), SECOND)}, "B7", set()),
    "unloadPoint": ({"steps": (FIRST, step(SECOND, location="B8"))}, "B8", set()),
    "stepFixed": ({"sealed": True}, True, set()),
    "stepNum": ({"steps": (FIRST, SECOND, SECOND)}, 3, set()),
    "currentStepIndex": ({"current_step": 1}, 1, set()),
    "doneStepIndex": ({"done_step": 0}, 0, set()),
    "actualRobotName": ({"robot": RobotName("R8")}, "R8", set()),
    "oldRobots": ({"former_robots": (RobotName("R1"), RobotName("R2"))}, ["R1", "R2"], set()),
    "robotAllocatedOn": ({"assigned_ms": 5}, 5, {"executingTime"}),
    "dispatchCost": ({"cost_s": 4.25}, 4.25, set()),
    "loaded": ({"loaded": True}, True, set()),
    "unloaded": ({"unloaded": True}, True, set()),
    "fault": ({"fault_reason": None}, False, {"faultReason"}),
    "faultReason": ({"fault_reason": "JackFailed"}, "JackFailed", set()),
    "failureNum": ({"fault_count": 3}, 3, set()),
    "faultDuration": ({"fault_ms": 1_250}, 1.25, set()),
    "loadDuration": ({"load_ms": 2_500}, 2.5, set()),
    "unloadDuration": ({"unload_ms": 3_500}, 3.5, set()),
    "waitExecuteDuration": ({"waited_ms": 4_500}, 4.5, set()),
    "processingTime": ({"created_ms": 49}, 0.05, {"createdOn"}),
    "executingTime": ({"assigned_ms": 59}, 0.04, {"robotAllocatedOn"}),
    "createdOn": ({"created_ms": 9}, 9, {"processingTime"}),
    "createdBy": ({"created_by": "wms"}, "wms", set()),
    "modifiedOn": ({"modified_ms": 8}, 8, set()),
    "modifiedBy": ({"modified_by": "wms"}, "wms", set()),
    "doneOn": ({"done_ms": 1_002}, 1_002, {"processingTime", "executingTime"}),
    "version": ({"version": 12}, 12, set()),
}


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_of_an_order_says_its_own_part_of_it(field: str) -> None:
    change, says, beside = FIELDS[field]
    before, after = row(ORDER, "site"), row(replace(ORDER, **change), "site")
    assert after[field] == says != before[field]
    assert {name for name in after if after[name] != before[name]} == {field} | beside


def test_an_order_names_its_scene() -> None:
    assert row(ORDER, "yard")["sceneName"] == "yard"


def test_no_order_is_of_a_batch_of_tasks() -> None:
    """No call of the specification puts an order into one."""
    assert row(ORDER, "site")["taskBatch"] is None


def test_every_field_of_an_order_has_its_line_here() -> None:
    elsewhere = {"sceneName", "taskBatch"}
    assert FIELDS.keys() | elsewhere == {field.name for field in SHOWN}


@pytest.mark.parametrize(
    ("steps", "without"),
    [((FIRST,), False), ((SECOND,), False), ((step(loads=False),), True), ((), True)],
)
def test_an_order_that_neither_loads_nor_unloads_says_so_if_asked(
    steps: tuple[Step, ...], without: bool
) -> None:
    assert BY_NAME["noLoad"].read(replace(ORDER, steps=steps), "site") is without


def test_the_detail_of_an_order_is_all_of_it_and_its_steps_and_why_it_waits() -> None:
    plain = replace(ORDER, allocation_reject=None, execution_reject=None, steps=())
    assert detail(plain, "site") == row(plain, "site") | {
        "allocationReject": None,
        "executionReject": None,
        "steps": [],
    }
    assert detail(replace(plain, allocation_reject=WHY), "site")["allocationReject"] == SAYS_WHY
    assert detail(replace(plain, execution_reject=WHY), "site")["executionReject"] == SAYS_WHY
    ids = [step["id"] for step in detail(ORDER, "site")["steps"]]
    assert ids == [FIRST.id, SECOND.id]


def test_a_reason_has_its_code_and_each_robots_own() -> None:
    assert reject_row(WHY) == SAYS_WHY
    assert reject_row(Reject(code="DispatchPaused")) == {"code": "DispatchPaused", "params": []}


# of the first step
STEP_FIELDS: dict[str, tuple[dict[str, Any], Any, set[str]]] = {
    "id": ({"id": StepId("S9")}, "S9", set()),
    "status": ({"status": StepStatus.DONE}, "Done", set()),
    "version": ({"version": 4}, 4, set()),
    "createdOn": ({"created_ms": 2}, 2, {"processingTime"}),
    "modifiedOn": ({"modified_ms": 9}, 9, set()),
    "startOn": ({"started_ms": 1}, 1, {"executingTime"}),
    "endOn": ({"ended_ms": 5_002}, 5_002, {"processingTime", "executingTime"}),
    "processingTime": ({"created_ms": -1_996}, 2.0, {"createdOn"}),
    "executingTime": ({"started_ms": -2_996}, 3.0, {"startOn"}),
}
TASK_FIELDS: dict[str, tuple[dict[str, Any], Any]] = {
    "location": ({"location": "B7"}, "B7"),
    "rbkArgs": ({"arguments": '{"operation":"Load"}'}, '{"operation":"Load"}'),
    "forLoad": ({"loads": False}, False),
    "forUnload": ({"unloads": True}, True),
    "withdrawOrderAllowed": ({"withdrawable": True}, True),
    "nextStepSameOrder": ({"keeps_robot": True}, True),
}


def first_step(order: Order) -> dict[str, Any]:
    found: dict[str, Any] = detail(order, "site")["steps"][0]
    return found


@pytest.mark.parametrize("field", [*STEP_FIELDS, *TASK_FIELDS])
def test_a_field_of_a_step_says_its_own_part_of_it(field: str) -> None:
    if field in TASK_FIELDS:
        change, says = TASK_FIELDS[field]
        changed, beside = step(**change), set[str]()
    else:
        change, says, beside = STEP_FIELDS[field]
        changed = replace(FIRST, **change)
    before = first_step(ORDER)
    after = first_step(replace(ORDER, steps=(changed, SECOND)))
    assert after[field] == says != before[field]
    assert {name for name in after if after[name] != before[name]} == {field} | beside


def test_a_step_knows_its_order_and_its_place_and_nobodys_name() -> None:
    steps = detail(ORDER, "site")["steps"]
    assert [s["orderId"] for s in steps] == [ORDER.id] * 2
    assert [s["stepIndex"] for s in steps] == ["0", "1"]  # texts: C3
    assert {s[field] for s in steps for field in ("createdBy", "modifiedBy")} == {None}
    here = {"orderId", "stepIndex", "createdBy", "modifiedBy"}
    assert STEP_FIELDS.keys() | TASK_FIELDS.keys() | here == steps[0].keys()


def test_a_step_that_has_not_ended_has_taken_no_time_yet() -> None:
    running = first_step(replace(ORDER, steps=(replace(FIRST, ended_ms=None), SECOND)))
    assert (running["processingTime"], running["executingTime"]) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("field", "change", "says"),
    [
        ("orderId", {"id": OrderId("TO2")}, "TO2"),
        ("status", {"status": OrderStatus.PENDING}, "Pending"),
        ("allocationReject", {"allocation_reject": WHY}, SAYS_WHY),
        ("executionReject", {"execution_reject": WHY}, SAYS_WHY),
        ("createdOn", {"created_ms": 9}, 9),
    ],
)
def test_a_field_of_a_record_says_its_own_part_of_the_order(
    field: str, change: dict[str, Any], says: Any
) -> None:
    before, after = record(ORDER), record(replace(ORDER, **change))
    assert after[field] == says != before[field]
    assert {name for name in after if after[name] != before[name]} == {field}
