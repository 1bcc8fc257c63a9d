"""Every event that the system can state. Meanings never change; new meanings are new events."""

from typing import TypeAlias, get_args

from ledger.events.answers import AnswerEvent, CommandAnswered
from ledger.events.base import Event, stamped
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
    OrderWithdrawn,
    StepChange,
    StepFinished,
    StepsAdded,
    StepsChanged,
    StepsDeleted,
    StepStarted,
)
from ledger.events.robots import (
    RobotAdded,
    RobotBinsCleared,
    RobotConnected,
    RobotDisabled,
    RobotDisconnected,
    RobotEnabled,
    RobotEvent,
    RobotRemoved,
    RobotWentOffDuty,
    RobotWentOnDuty,
)
from ledger.events.scenes import SceneConfigured, SceneEvent, SceneImported, SceneMapReplaced

AnyEvent: TypeAlias = SceneEvent | RobotEvent | OrderEvent | AnswerEvent

# one class per event, in the order of the union; the aggregate names the MCAP topic's folder
EVENTS: dict[type[Event], str] = {
    **dict.fromkeys(get_args(SceneEvent), "scenes"),
    **dict.fromkeys(get_args(RobotEvent), "robots"),
    **dict.fromkeys(get_args(OrderEvent), "orders"),
    CommandAnswered: "commands",
}

__all__ = [
    "EVENTS",
    "AnswerEvent",
    "AnyEvent",
    "AssignmentRejected",
    "CommandAnswered",
    "Event",
    "ExecutionRejected",
    "OrderAssigned",
    "OrderCancelled",
    "OrderCreated",
    "OrderEvent",
    "OrderFaulted",
    "OrderFinished",
    "OrderPrioritised",
    "OrderRetried",
    "OrderSealed",
    "OrderWithdrawn",
    "RobotAdded",
    "RobotBinsCleared",
    "RobotConnected",
    "RobotDisabled",
    "RobotDisconnected",
    "RobotEnabled",
    "RobotEvent",
    "RobotRemoved",
    "RobotWentOffDuty",
    "RobotWentOnDuty",
    "SceneConfigured",
    "SceneEvent",
    "SceneImported",
    "SceneMapReplaced",
    "StepChange",
    "StepFinished",
    "StepStarted",
    "StepsAdded",
    "StepsChanged",
    "StepsDeleted",
    "stamped",
]
