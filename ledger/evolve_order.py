"""What each event of an order means for the order itself."""

from typing import Any, assert_never

import msgspec

from ledger.events.orders import (
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
    OrderSuspended,
    OrderUnsuspended,
    OrderWithdrawn,
    StepFinished,
    StepsAdded,
    StepsChanged,
    StepsDeleted,
    StepStarted,
)
from ledger.ids import OrderId, StepId
from ledger.state import Order, OrderStatus, Reject, Step, StepStatus, StepTask

replace = msgspec.structs.replace
# members looked up once: through the class each look costs 0.4 µs (measured), of 5 for an event
TO_BE_ALLOCATED, ALLOCATED = OrderStatus.TO_BE_ALLOCATED, OrderStatus.ALLOCATED
PENDING, EXECUTING = OrderStatus.PENDING, OrderStatus.EXECUTING
DONE, CANCELLED = OrderStatus.DONE, OrderStatus.CANCELLED
STEP_EXECUTABLE, STEP_EXECUTING = StepStatus.EXECUTABLE, StepStatus.EXECUTING
STEP_DONE = StepStatus.DONE


def order_created(event: OrderCreated) -> Order:
    """Give the order that this event begins."""
    return Order(
        id=event.order,
        scene=event.scene,
        kind=event.kind,
        created_ms=event.at_ms,
        created_by=event.by,
        modified_ms=event.at_ms,
        modified_by=event.by,
        external_id=event.external_id,
        priority=event.priority,
        wanted_robots=event.wanted_robots,
        wanted_groups=event.wanted_groups,
        container=event.container,
        container_type=event.container_type,
        container_heading_rad=event.container_heading_rad,
        key_locations=event.key_locations,
        sealed=event.sealed,
        steps=_steps(event.order, event.tasks, 0, event.at_ms),
        steps_made=len(event.tasks),
    )


def _steps(order: OrderId, tasks: tuple[StepTask, ...], made: int, at_ms: int) -> tuple[Step, ...]:
    return tuple(
        Step(id=StepId(f"{order}-Step{n}"), task=task, created_ms=at_ms, modified_ms=at_ms)
        for n, task in enumerate(tasks, made)
    )


def order_after(order: Order, event: OrderEvent) -> Order:
    """Give the order as it is after one more event of its own.

    The arms stand in the order of how often their events come: a fold tries them one by one.
    """
    match event:
        case StepStarted():
            return _step_started(order, event)
        case StepFinished():
            return _step_finished(order, event)
        case OrderAssigned():
            return _changed(
                order,
                event,
                status=ALLOCATED,
                robot=event.robot,
                bin=event.bin,
                assigned_ms=event.at_ms,
                cost_s=event.cost_s,
                allocation_reject=None,
            )
        case OrderFinished():
            return _changed(order, event, status=DONE, done_ms=event.at_ms, execution_reject=None)
        case AssignmentRejected():
            reject = Reject(code=event.code, robots=event.robots, at_ms=event.at_ms)
            return _changed(order, event, allocation_reject=reject)
        case ExecutionRejected():
            why = Reject(code=event.code, robots=event.robots, at_ms=event.at_ms)
            return _changed(order, event, execution_reject=why if event.code else None)
        case OrderCreated():
            return order_created(event)
        case StepsAdded():
            return _steps_added(order, event)
        case StepsChanged():
            return _steps_changed(order, event)
        case StepsDeleted():
            gone = frozenset(event.steps)
            left = tuple(step for step in order.steps if step.id not in gone)
            return _pending_if_all_done(_changed(order, event, steps=left))
        case OrderSealed():
            return _changed(order, event, sealed=True)
        case OrderPrioritised():
            return _changed(order, event, priority=event.priority)
        case OrderWithdrawn():
            return _withdrawn(order, event)
        case OrderFaulted():
            return _changed(
                order,
                event,
                fault_reason=event.reason,
                fault_count=order.fault_count + 1,
                faulted_ms=event.at_ms,
            )
        case OrderRetried():
            return _fault_ended(_changed(order, event), event.at_ms)
        case OrderCancelled():
            order = _fault_ended(order, event.at_ms)
            return _changed(order, event, status=CANCELLED, done_ms=event.at_ms)
        case OrderSuspended():
            return _changed(order, event, suspended=True)
        case OrderUnsuspended():
            return _changed(order, event, suspended=False)
        case _:
            assert_never(event)


def _changed(order: Order, event: OrderEvent, **fields: Any) -> Order:
    return replace(
        order,
        version=order.version + 1,
        modified_ms=event.at_ms,
        modified_by=event.by,
        **fields,
    )


def _with(steps: tuple[Step, ...], index: int, step: Step) -> tuple[Step, ...]:
    return (*steps[:index], step, *steps[index + 1 :])


def _steps_added(order: Order, event: StepsAdded) -> Order:
    steps = _steps(order.id, event.tasks, order.steps_made, event.at_ms)
    waited = order.status is PENDING  # for these
    return _changed(
        order,
        event,
        steps=order.steps + steps,
        steps_made=order.steps_made + len(steps),
        status=ALLOCATED if waited else order.status,
        container=order.container if event.container is None else event.container,
    )


def _steps_changed(order: Order, event: StepsChanged) -> Order:
    container = order.container if event.container is None else event.container
    order = _changed(order, event, container=container)
    for change in event.changes:
        before = order.steps[change.step]
        step = replace(
            before, task=change.task, modified_ms=event.at_ms, version=before.version + 1
        )
        order = replace(order, steps=_with(order.steps, change.step, step))
    return order


def _pending_if_all_done(order: Order) -> Order:
    if order.robot is None or not _all_done(order.steps):
        return order
    return replace(order, status=PENDING)


def _all_done(steps: tuple[Step, ...]) -> bool:
    return not [step for step in steps if step.status is not STEP_DONE]


def _withdrawn(order: Order, event: OrderWithdrawn) -> Order:
    steps = tuple(
        replace(s, status=STEP_EXECUTABLE, started_ms=None, modified_ms=event.at_ms)
        if s.status is STEP_EXECUTING
        else s
        for s in order.steps
    )
    return _changed(
        order,
        event,
        status=TO_BE_ALLOCATED,
        robot=None,
        bin=None,
        assigned_ms=None,
        cost_s=None,
        steps=steps,
        current_step=order.done_step,
        former_robots=(*order.former_robots, event.robot),
        execution_reject=None,
    )


def _step_started(order: Order, event: StepStarted) -> Order:
    step = replace(
        order.steps[event.step],
        status=STEP_EXECUTING,
        started_ms=event.at_ms,
        modified_ms=event.at_ms,
        version=order.steps[event.step].version + 1,
    )
    waited_ms = order.waited_ms
    if waited_ms is None and order.assigned_ms is not None:
        waited_ms = event.at_ms - order.assigned_ms
    return _changed(
        order,
        event,
        steps=_with(order.steps, event.step, step),
        status=EXECUTING,
        current_step=event.step,
        waited_ms=waited_ms,
    )


def _step_finished(order: Order, event: StepFinished) -> Order:
    before = order.steps[event.step]
    step = replace(
        before,
        status=STEP_DONE,
        ended_ms=event.at_ms,
        modified_ms=event.at_ms,
        version=before.version + 1,
    )
    spent_ms = event.at_ms - (before.started_ms or event.at_ms)
    steps = _with(order.steps, event.step, step)
    more: dict[str, Any] = {}
    if before.task.loads:
        more |= {"loaded": True, "load_ms": (order.load_ms or 0) + spent_ms}
    if before.task.unloads:
        more |= {"unloaded": True, "unload_ms": (order.unload_ms or 0) + spent_ms}
    if order.robot is not None and _all_done(steps):
        more["status"] = PENDING
    return _changed(order, event, steps=steps, done_step=event.step, **more)


def _fault_ended(order: Order, at_ms: int) -> Order:
    if order.faulted_ms is None:
        return order
    fault_ms = (order.fault_ms or 0) + at_ms - order.faulted_ms
    return replace(order, fault_reason=None, faulted_ms=None, fault_ms=fault_ms)
