"""An order in full, as M4 shows it: the entity, why it waits, and its steps (spec/m4.md §3)."""

from typing import Any

from ledger.state import Order, Reject, Step
from projections.fields import Row, row


def detail(order: Order, scene_name: str) -> Row:
    """Give the OrderDetail of an order."""
    return {
        **row(order, scene_name),
        "allocationReject": reject_row(order.allocation_reject),
        "executionReject": reject_row(order.execution_reject),
        "steps": [_step(order, index, step) for index, step in enumerate(order.steps)],
    }


def reject_row(reject: Reject | None) -> dict[str, Any] | None:
    """Give a RejectReason, or null."""
    if reject is None:
        return None
    params = [{robot: reason} for robot, reason in reject.robots.items()]
    return {"code": reject.code, "params": params}


def _step(order: Order, index: int, step: Step) -> Row:
    """Give one step; its index is text and its arguments are JSON text (spec/m4.md, C3, C4)."""
    return {
        "id": step.id,
        "orderId": order.id,
        "stepIndex": str(index),
        "status": step.status.value,
        "location": step.task.location,
        "rbkArgs": step.task.arguments,
        "forLoad": step.task.loads,
        "forUnload": step.task.unloads,
        "withdrawOrderAllowed": step.task.withdrawable,
        "nextStepSameOrder": step.task.keeps_robot,
        "createdOn": step.created_ms,
        "createdBy": None,
        "modifiedOn": step.modified_ms,
        "modifiedBy": None,
        "startOn": step.started_ms,
        "endOn": step.ended_ms,
        "processingTime": _between_s(step.created_ms, step.ended_ms),
        "executingTime": _between_s(step.started_ms, step.ended_ms),
        "version": step.version,
    }


def _between_s(from_ms: int | None, to_ms: int | None) -> float:
    return 0.0 if from_ms is None or to_ms is None else (to_ms - from_ms) / 1000
