"""Events and reasons in plain words, for people: the console, and `fleetledger replay`."""

from collections.abc import Mapping
from typing import assert_never

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
    OrderSuspended,
    OrderUnsuspended,
    OrderWithdrawn,
    StepFinished,
    StepsAdded,
    StepsChanged,
    StepsDeleted,
    StepStarted,
)
from ledger.ids import RobotName
from ledger.state import BinStatus, Order, OrderStatus, Reject, Robot, StepTask

ROBOTS_NAMED_MAX = 6  # in one sentence

# codes of dispatch whose words are not simply the code spelt out
CODES = {
    "AllRobotUnDispatchable": "no robot can take it",
    "NoRobot": "the scene has no robots",
    "RobotNotWanted": "the order names others",
    "RobotNotReady": "not placed on the map yet",
    "RobotSoftStopped": "soft stop pressed",
    "RobotNotControlled": "not under our control",
    "RobotFault": "in fault",
    "RobotBusyKeepsOrder": "has to finish its order first",
    "RobotNoMoreBin": "no free bin",
    "RobotTakenByOther": "took another order",
    "NoRoute": "no way there",
    "GroundReserved": "ground on the way there is reserved for somebody else",
    "RobotBlocked": "has not moved for long",
    "RobotObstructed": "something is in its way",
    "RobotInTheWay": "stands in the way",
    "LocationUnknown": "the place is not on the map any more",
}

STATUS = {
    OrderStatus.TO_BE_ALLOCATED: "waits for a robot",
    OrderStatus.ALLOCATED: "assigned",
    OrderStatus.PENDING: "waits for more steps",
    OrderStatus.EXECUTING: "under way",
    OrderStatus.DONE: "done",
    OrderStatus.CANCELLED: "cancelled",
}


def reason(code: str) -> str:
    """Say a reason's code in words: its own, or spelt out (`RobotBatteryLow` → battery low)."""
    known = CODES.get(code)
    if known is not None:
        return known
    if " " in code:
        return code  # already words
    code = code.removeprefix("Robot") or code
    words: list[str] = []
    for index, letter in enumerate(code):
        after_small = index > 0 and not code[index - 1].isupper()
        if letter.isupper() and after_small:
            words.append(" ")
        words.append(letter.lower() if letter.isupper() else letter)
    return "".join(words)


def rejection(reject: Reject | None) -> str:
    """Say why something cannot be done: each robot's own reason, or the common one."""
    if reject is None or not reject.code:
        return ""
    return _reasons(reject.code, reject.robots)


def _reasons(code: str, robots: Mapping[RobotName, str]) -> str:
    if not robots:
        return reason(code)
    by_reason: dict[str, list[RobotName]] = {}
    for robot, why in sorted(robots.items()):
        by_reason.setdefault(reason(why), []).append(robot)
    said = "; ".join(f"{_some(names)}: {why}" for why, names in by_reason.items())
    return said if code == "AllRobotUnDispatchable" else f"{reason(code)} ({said})"


def _some(names: list[RobotName]) -> str:
    if len(names) <= ROBOTS_NAMED_MAX:
        return ", ".join(names)
    return f"{', '.join(names[:ROBOTS_NAMED_MAX])} and {len(names) - ROBOTS_NAMED_MAX} more"


def order_reason(order: Order) -> str:
    """Say why an order does not get on; empty where nothing is in its way."""
    if order.fault_reason is not None:
        return f"faulted: {reason(order.fault_reason)}"
    if order.suspended:
        return "suspended"
    if order.robot is None:
        return rejection(order.allocation_reject)
    return rejection(order.execution_reject)


def robot_reason(robot: Robot) -> str:
    """Say what is out of order with a robot, as far as the ledger knows; to be busy is not."""
    if robot.config.disabled:
        return "disabled"
    if not robot.online:
        return "offline"
    if robot.off_duty:
        return "off duty"
    if any(b.status is BinStatus.CANCELLED for b in robot.bins):
        return "carries the load of a cancelled order"
    return ""


def task(step: StepTask) -> str:
    """Say what a step asks for."""
    doing = " to load" if step.loads else " to unload" if step.unloads else ""
    return f"to {step.location}{doing}"


def event_words(event: OrderEvent) -> str:
    """Say what happened to an order."""
    match event:
        case OrderCreated():
            who = f" by {event.by}" if event.by else ""
            return f"{event.kind.value} order created{who} with {_steps(len(event.tasks))}"
        case StepsAdded():
            return f"{_steps(len(event.tasks))} added: {'; '.join(task(t) for t in event.tasks)}"
        case StepsChanged():
            changes = "; ".join(f"step {c.step + 1} {task(c.task)}" for c in event.changes)
            return f"changed: {changes}"
        case StepsDeleted():
            return f"{_steps(len(event.steps))} deleted"
        case OrderSealed():
            return "sealed: no more steps will come"
        case OrderPrioritised():
            return f"priority set to {event.priority}"
        case OrderAssigned():
            return f"assigned to {event.robot}, {event.cost_s:.0f} s away{_others(event)}"
        case OrderWithdrawn():
            return f"taken back from {event.robot}: {reason(event.reason)}"
        case AssignmentRejected():
            return f"waits: {_reasons(event.code, event.robots)}"
        case ExecutionRejected():
            if not event.code:
                return "goes on"
            return f"does not get on: {_reasons(event.code, event.robots)}"
        case StepStarted():
            return f"{event.robot} set out for step {event.step + 1}"
        case StepFinished():
            return f"{event.robot} finished step {event.step + 1}"
        case OrderFaulted():
            return f"faulted: {reason(event.reason)}"
        case OrderRetried():
            return "retried: it goes on"
        case OrderFinished():
            return "done"
        case OrderCancelled():
            return f"cancelled{f' by {event.by}' if event.by else ''}"
        case OrderSuspended():
            return f"suspended{f' by {event.by}' if event.by else ''}"
        case OrderUnsuspended():
            return "goes on after having been suspended"
        case _:
            assert_never(event)


def _others(event: OrderAssigned) -> str:
    others = [c for c in event.candidates if c.robot != event.robot]
    if not others:
        return ""
    said = [
        f"{c.robot} {reason(c.reason) if c.reason else f'{c.cost_s or 0:.0f} s away'}"
        for c in others[:ROBOTS_NAMED_MAX]
    ]
    more = len(others) - len(said)
    return f"; not {', '.join(said)}{f' and {more} more' if more else ''}"


def _steps(count: int) -> str:
    return "1 step" if count == 1 else f"{count} steps"
