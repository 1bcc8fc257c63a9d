"""The life of an order: what each event leaves in it, above all instants, durations and counts."""

from collections.abc import Iterator
from typing import Any

import pytest

from ledger.events import (
    AssignmentRejected,
    ExecutionRejected,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderEvent,
    OrderFaulted,
    OrderFinished,
    OrderPrioritised,
    OrderRetried,
    OrderSealed,
    OrderWithdrawn,
    StepChange,
    StepFinished,
    StepsAdded,
    StepsChanged,
    StepsDeleted,
    StepStarted,
    stamped,
)
from ledger.evolve_order import order_after, order_created
from ledger.ids import CommandId, OrderId, RobotName, SceneId
from ledger.state import Order, OrderStatus, StepStatus, StepTask

SCENE, ID = SceneId("S"), OrderId("TO1")
R1, R2 = RobotName("R1"), RobotName("R2")
LOAD = StepTask(location="B1", loads=True)
UNLOAD = StepTask(location="B2", unloads=True)
MOVE = StepTask(location="AP1")


def of(kind: type[Any], **fields: Any) -> Any:
    return kind(scene=SCENE, order=ID, **fields)


def life(*happened: tuple[int, Any]) -> Iterator[Order]:
    """Give the order after each event: second and event. Even seconds are alice's, odd bob's."""
    order: Order | None = None
    for position, (second, event) in enumerate(happened, 1):
        by = "bob" if second % 2 else "alice"
        told: OrderEvent = stamped(event, position, second * 1_000, by, CommandId("c"))
        order = order_created(told) if order is None else order_after(order, told)
        yield order


def last(*happened: tuple[int, Any]) -> Order:
    *_, order = life(*happened)
    return order


CREATED = (0, of(OrderCreated, tasks=(LOAD, UNLOAD), sealed=True))
ASSIGNED = (2, of(OrderAssigned, robot=R1, bin=0, cost_s=3.5))
STARTED = (5, of(StepStarted, step=0, robot=R1))
LOADED = (12, of(StepFinished, step=0, robot=R1))
ON = (13, of(StepStarted, step=1, robot=R1))
UNLOADED = (24, of(StepFinished, step=1, robot=R1))
FINISHED = (25, of(OrderFinished))
WHOLE = (CREATED, ASSIGNED, STARTED, LOADED, ON, UNLOADED, FINISHED)


def test_an_order_goes_from_creation_to_its_end() -> None:
    lives = list(life(*WHOLE))
    assert [o.status for o in lives] == [
        OrderStatus.TO_BE_ALLOCATED,
        OrderStatus.ALLOCATED,
        *[OrderStatus.EXECUTING] * 3,
        OrderStatus.PENDING,
        OrderStatus.DONE,
    ]
    assert [o.current_step for o in lives] == [-1, -1, 0, 0, 1, 1, 1]
    assert [o.done_step for o in lives] == [-1, -1, -1, 0, 0, 1, 1]
    assert [o.robot for o in lives] == [None, *[R1] * 6]
    assert [(o.loaded, o.unloaded) for o in lives] == [
        *[(False, False)] * 3,
        *[(True, False)] * 2,
        *[(True, True)] * 2,
    ]


def test_an_order_counts_its_changes_and_knows_the_last() -> None:
    lives = list(life(*WHOLE))
    assert [o.version for o in lives] == [0, 1, 2, 3, 4, 5, 6]
    assert [o.modified_ms for o in lives] == [0, 2_000, 5_000, 12_000, 13_000, 24_000, 25_000]
    assert [o.modified_by for o in lives] == [
        "alice",
        "alice",
        "bob",
        "alice",
        "bob",
        "alice",
        "bob",
    ]
    assert {(o.created_ms, o.created_by) for o in lives} == {(0, "alice")}


def test_an_order_knows_how_long_each_part_took() -> None:
    order = last(*WHOLE)
    assert (order.assigned_ms, order.cost_s, order.done_ms) == (2_000, 3.5, 25_000)
    assert (order.waited_ms, order.load_ms, order.unload_ms) == (3_000, 7_000, 11_000)
    assert (order.fault_ms, order.fault_count) == (None, 0)


def test_durations_of_several_steps_add_up_and_moves_count_for_none() -> None:
    tasks = (LOAD, MOVE, LOAD)
    order = last(
        (0, of(OrderCreated, tasks=tasks, sealed=True)),
        (2, of(OrderAssigned, robot=R1, bin=0, cost_s=0.0)),
        (4, of(StepStarted, step=0, robot=R1)),
        (7, of(StepFinished, step=0, robot=R1)),
        (8, of(StepStarted, step=1, robot=R1)),
        (18, of(StepFinished, step=1, robot=R1)),
        (20, of(StepStarted, step=2, robot=R1)),
        (25, of(StepFinished, step=2, robot=R1)),
    )
    assert (order.waited_ms, order.load_ms, order.unload_ms) == (2_000, 8_000, None)
    assert (order.loaded, order.unloaded) == (True, False)


def test_a_step_knows_its_own_instants() -> None:
    steps = [o.steps[0] for o in life(*WHOLE[:4])]
    assert [s.status for s in steps] == [
        *[StepStatus.EXECUTABLE] * 2,
        StepStatus.EXECUTING,
        StepStatus.DONE,
    ]
    assert [s.version for s in steps] == [0, 0, 1, 2]
    assert [s.modified_ms for s in steps] == [0, 0, 5_000, 12_000]
    done = steps[-1]
    assert (done.created_ms, done.started_ms, done.ended_ms) == (0, 5_000, 12_000)
    assert (steps[2].started_ms, steps[2].ended_ms) == (5_000, None)


def test_faults_are_counted_and_their_time_adds_up_once_they_end() -> None:
    happened = (
        *WHOLE[:3],
        (7, of(OrderFaulted, reason="JackFailed")),
        (9, of(OrderRetried)),
        (10, of(OrderFaulted, reason="Lost")),
    )
    lives = list(life(*happened, (15, of(OrderRetried))))
    assert [o.fault_reason for o in lives[3:]] == ["JackFailed", None, "Lost", None]
    assert [o.fault_count for o in lives[3:]] == [1, 1, 2, 2]
    assert [o.fault_ms for o in lives[3:]] == [None, 2_000, 2_000, 7_000]
    cancelled = last(*happened, (12, of(OrderCancelled)))
    assert (cancelled.fault_ms, cancelled.fault_reason) == (4_000, None)
    assert (cancelled.status, cancelled.done_ms) == (OrderStatus.CANCELLED, 12_000)


def test_an_order_that_is_taken_away_begins_anew_with_what_is_not_done() -> None:
    busy = ExecutionRejected(scene=SCENE, order=ID, code="RobotBlocked")
    happened = (
        CREATED,
        ASSIGNED,
        STARTED,
        (6, busy),
        (8, of(OrderWithdrawn, robot=R1, reason="r")),
    )
    order = last(*happened)
    assert (order.status, order.robot, order.bin) == (OrderStatus.TO_BE_ALLOCATED, None, None)
    assert (order.assigned_ms, order.cost_s, order.execution_reject) == (None, None, None)
    assert (order.current_step, order.former_robots) == (-1, (R1,))
    step = order.steps[0]
    assert (step.status, step.started_ms, step.modified_ms) == (StepStatus.EXECUTABLE, None, 8_000)
    again = (
        (9, of(OrderAssigned, robot=R2, bin=1, cost_s=1.0)),
        (10, of(OrderWithdrawn, robot=R2, reason="r")),
    )
    assert last(*happened, *again).former_robots == (R1, R2)
    at_last = (
        (12, of(OrderAssigned, robot=R2, bin=0, cost_s=1.0)),
        (20, of(StepStarted, step=0, robot=R2)),
    )
    order = last(*happened, *again, *at_last)
    assert (order.robot, order.assigned_ms) == (R2, 12_000)
    assert order.waited_ms == 3_000, "the first time that somebody set out for it"


def test_a_reason_stays_until_it_does_not_hold_any_more() -> None:
    waits = AssignmentRejected(scene=SCENE, order=ID, code="NoRobot", robots={R1: "Charging"})
    blocked = ExecutionRejected(scene=SCENE, order=ID, code="RobotBlocked", robots={R1: "x"})
    free = ExecutionRejected(scene=SCENE, order=ID, code="")
    lives = list(life(CREATED, (1, waits), ASSIGNED, STARTED, (6, blocked), (7, free)))
    reasons = [o.allocation_reject for o in lives]
    assert [r is None for r in reasons] == [True, False, True, True, True, True]
    assert (reasons[1].code, reasons[1].robots, reasons[1].at_ms) == (
        "NoRobot",
        {R1: "Charging"},
        1_000,
    )
    reasons = [o.execution_reject for o in lives]
    assert [r is None for r in reasons] == [True, True, True, True, False, True]
    assert (reasons[4].code, reasons[4].robots) == ("RobotBlocked", {R1: "x"})
    assert last(CREATED, ASSIGNED, STARTED, (6, blocked), FINISHED).execution_reject is None


def test_steps_come_change_and_go() -> None:
    moved = StepTask(location="B9", arguments='{"binTask":"Load"}', loads=True)
    lives = list(
        life(
            (0, of(OrderCreated, tasks=(MOVE, UNLOAD))),
            (1, of(StepsAdded, tasks=(MOVE,), container="C1")),
            (3, of(StepsChanged, changes=(StepChange(step=1, task=moved),), container="C2")),
            (4, of(StepsDeleted, steps=("TO1-Step0",))),
            (5, of(StepsAdded, tasks=(LOAD,))),
            (6, of(OrderSealed)),
            (7, of(OrderPrioritised, priority=9)),
        )
    )
    assert [len(o.steps) for o in lives] == [2, 3, 3, 2, 3, 3, 3]
    assert [o.container for o in lives] == [None, "C1", "C2", "C2", "C2", "C2", "C2"]
    changed = lives[2].steps[1]
    assert (changed.task, changed.modified_ms, changed.version) == (moved, 3_000, 1)
    added = lives[1].steps[2]
    assert (added.created_ms, added.modified_ms, added.version) == (1_000, 1_000, 0)
    assert [s.id for s in lives[-1].steps] == ["TO1-Step1", "TO1-Step2", "TO1-Step3"]
    assert [o.sealed for o in lives] == [False] * 5 + [True] * 2
    assert [o.priority for o in lives] == [0] * 6 + [9]


@pytest.mark.parametrize("steps", [("TO1-Step1",), ("TO1-Step1", "TO1-Step2")])
def test_an_order_left_with_done_steps_only_is_pending(steps: tuple[str, ...]) -> None:
    created = (0, of(OrderCreated, tasks=(LOAD, MOVE, MOVE)))
    order = last(created, ASSIGNED, STARTED, LOADED, (14, of(StepsDeleted, steps=steps)))
    wanted = OrderStatus.PENDING if len(steps) == 2 else OrderStatus.EXECUTING
    assert order.status is wanted
