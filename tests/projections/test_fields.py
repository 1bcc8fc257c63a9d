"""Readings of the fields of an order."""

from typing import Any

from ledger.ids import OrderId, RobotName, StepId
from ledger.state import Order, OrderStatus, Step, StepTask
from projections.fields import BY_NAME, row
from tests.strategies import SCENE


def step(number: int, location: str, **task: bool) -> Step:
    return Step(
        id=StepId(f"S{number}"),
        task=StepTask(location=location, **task),
        created_ms=0,
        modified_ms=0,
    )


def read(**changes: Any) -> dict[str, Any]:
    whole: dict[str, Any] = {
        "id": OrderId("TO1"), "scene": SCENE, "created_ms": 1_000, "created_by": "wms",
        "modified_ms": 1_000, "modified_by": "wms",
    }  # fmt: skip
    return row(Order(**whole | changes), "hall", BY_NAME.values())


def test_key_locations_come_from_the_steps_where_none_are_given() -> None:
    steps = (step(0, "AP1", loads=True), step(1, "AP2"), step(2, "AP3", unloads=True))
    found = read(steps=steps)
    assert found["keyLocations"] == ["AP1", "AP2", "AP3"]
    assert (found["loadPoint"], found["unloadPoint"], found["noLoad"]) == ("AP1", "AP3", False)
    assert read(steps=steps, key_locations=("LM1",))["keyLocations"] == ["LM1"]


def test_nobody_wanted_is_null_and_not_an_empty_list() -> None:
    found = read()
    assert found["expectedRobotNames"] is found["expectedRobotGroups"] is found["oldRobots"] is None
    assert read(wanted_robots=(RobotName("R1"),))["expectedRobotNames"] == ["R1"]


def test_times_of_the_whole_order_are_null_until_it_ends() -> None:
    found = read(assigned_ms=2_000)
    assert found["processingTime"] is found["executingTime"] is found["doneOn"] is None
    done = {"status": OrderStatus.DONE, "done_ms": 9_500}
    found = read(assigned_ms=2_000, **done)
    assert (found["processingTime"], found["executingTime"]) == (8.5, 7.5)
    assert read(**done)["executingTime"] == 0.0  # it ended without ever having had a robot


def test_a_fault_has_a_reason_a_number_and_a_duration() -> None:
    found = read(fault_reason="JackFailed", fault_count=2, fault_ms=1_500)
    assert (found["fault"], found["faultReason"]) == (True, "JackFailed")
    assert (found["failureNum"], found["faultDuration"]) == (2, 1.5)
    assert read()["fault"] is False
