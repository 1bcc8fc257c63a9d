"""Which of its orders a robot is at, and which step: it follows from the orders alone."""

from collections.abc import Sequence

from ledger.scene import Value
from ledger.state import Order, Step, StepStatus

_OPEN = frozenset({StepStatus.EXECUTABLE, StepStatus.EXECUTING})


class Current(Value, frozen=True, kw_only=True):
    """The step that a robot is at, or would begin next."""

    order: Order
    index: int
    step: Step
    begun: bool  # the robot has set out for it

    @property
    def attempt(self) -> str:
        """Id of the step's action: a retry after a fault is another action, a repetition is not."""
        failures = self.order.fault_count
        return f"{self.step.id}#{failures}" if failures else str(self.step.id)


def next_step(order: Order) -> int | None:
    """Give the first step that is not done."""
    for index, step in enumerate(order.steps):
        if step.status in _OPEN:
            return index
    return None


def kept_order(orders: Sequence[Order]) -> Order | None:
    """Find the order that the next step must be of (spec/m4.md, nextStepSameOrder)."""
    for order in orders:
        if (
            0 <= order.done_step < len(order.steps)
            and order.steps[order.done_step].task.keeps_robot
        ):
            return order
    return None


def current(orders: Sequence[Order]) -> Current | None:
    """Choose the step of a robot with these orders: begun, then bound, then loading before others.

    A bound robot whose order has no further step yet waits for one and does nothing else.
    A suspended order is put off as long as there is another one to begin.
    """
    open_steps = [(order, next_step(order)) for order in orders]
    known = [_at(o, i) for o, i in open_steps if i is not None]
    for candidate in known:
        if candidate.begun:
            return candidate
    kept = kept_order(orders)
    if kept is not None:
        return next((c for c in known if c.order is kept), None)
    free = [c for c in known if not c.order.suspended] or known
    loading = [c for c in free if c.step.task.loads]
    return next(iter(loading or free), None)


def _at(order: Order, index: int) -> Current:
    step = order.steps[index]
    return Current(order=order, index=index, step=step, begun=step.status is StepStatus.EXECUTING)
