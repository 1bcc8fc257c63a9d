"""Events of transport orders."""

from typing import TypeAlias

from ledger.events.base import Event
from ledger.ids import OrderId, RobotName, StepId
from ledger.scene import Value
from ledger.state import Candidate, OrderKind, StepTask


class OfOrder(Event, frozen=True, kw_only=True):
    """An event of one order."""

    order: OrderId


class OrderCreated(OfOrder, frozen=True, kw_only=True):
    """An order was accepted (`orders/create`, or the scheduler's own need to park or charge)."""

    kind: OrderKind = OrderKind.BUSINESS
    external_id: str | None = None
    priority: int = 0
    wanted_robots: tuple[RobotName, ...] = ()
    wanted_groups: tuple[str, ...] = ()
    container: str | None = None
    container_type: str | None = None
    container_heading_rad: float | None = None
    key_locations: tuple[str, ...] = ()
    sealed: bool = False
    tasks: tuple[StepTask, ...] = ()


class StepsAdded(OfOrder, frozen=True, kw_only=True):
    """Steps were appended to an unsealed order (`orders/add-steps`)."""

    tasks: tuple[StepTask, ...]
    container: str | None = None  # what the order carries from now on; None = as before


class StepChange(Value, frozen=True, kw_only=True):
    """The new task of the step at an index."""

    step: int
    task: StepTask


class StepsChanged(OfOrder, frozen=True, kw_only=True):
    """Steps that no robot has begun got other tasks (`orders/update-steps`)."""

    changes: tuple[StepChange, ...]
    container: str | None = None  # what the order carries from now on; None = as before


class StepsDeleted(OfOrder, frozen=True, kw_only=True):
    """Steps that no robot has begun were taken out (`orders/delete-steps`); the rest move up."""

    steps: tuple[StepId, ...]


class OrderSealed(OfOrder, frozen=True, kw_only=True):
    """No more steps can come (`orders/complete-order`)."""


class OrderPrioritised(OfOrder, frozen=True, kw_only=True):
    """The order got another priority (`orders/update-priority-batch`)."""

    priority: int


class OrderAssigned(OfOrder, frozen=True, kw_only=True):
    """Dispatch gave the order to a robot; the candidates say who was not taken, and why."""

    robot: RobotName
    bin: int
    cost_s: float
    candidates: tuple[Candidate, ...] = ()


class OrderWithdrawn(OfOrder, frozen=True, kw_only=True):
    """The order was taken back from its robot and waits for another."""

    robot: RobotName
    reason: str


class AssignmentRejected(OfOrder, frozen=True, kw_only=True):
    """Dispatch found no robot for the order; one reason a robot (M4 allocationReject)."""

    code: str
    robots: dict[RobotName, str] = {}


class ExecutionRejected(OfOrder, frozen=True, kw_only=True):
    """The robot cannot get on with the order; an empty code ends it (M4 executionReject)."""

    code: str
    robots: dict[RobotName, str] = {}


class StepStarted(OfOrder, frozen=True, kw_only=True):
    """The robot set out for the step."""

    step: int
    robot: RobotName


class StepFinished(OfOrder, frozen=True, kw_only=True):
    """The robot did what the step asked."""

    step: int
    robot: RobotName


class OrderFaulted(OfOrder, frozen=True, kw_only=True):
    """The order cannot go on until someone retries it."""

    reason: str


class OrderRetried(OfOrder, frozen=True, kw_only=True):
    """A faulted order goes on (`orders/retry-failed-orders`)."""


class OrderFinished(OfOrder, frozen=True, kw_only=True):
    """All steps of a sealed order are done."""


class OrderCancelled(OfOrder, frozen=True, kw_only=True):
    """Someone gave the order up (`orders/cancel…`)."""


class OrderSuspended(OfOrder, frozen=True, kw_only=True):
    """Someone holds the order up: no robot takes it or goes on with it (`set-suspended`)."""


class OrderUnsuspended(OfOrder, frozen=True, kw_only=True):
    """A suspended order may go on (`unset-suspended`)."""


OrderEvent: TypeAlias = (
    OrderCreated
    | StepsAdded
    | StepsChanged
    | StepsDeleted
    | OrderSealed
    | OrderPrioritised
    | OrderAssigned
    | OrderWithdrawn
    | AssignmentRejected
    | ExecutionRejected
    | StepStarted
    | StepFinished
    | OrderFaulted
    | OrderRetried
    | OrderFinished
    | OrderCancelled
    | OrderSuspended
    | OrderUnsuspended
)
