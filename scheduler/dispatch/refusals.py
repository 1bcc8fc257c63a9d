"""The reasons why orders wait, told when they change and no oftener than people can read them."""

from collections.abc import Callable, Sequence

from ledger.ids import RobotName
from ledger.proposals import AnyProposal, RejectAssignment
from ledger.state import Order, Reject
from scheduler.dispatch.reasons import NotAssigned, Why
from scheduler.view import View

REFUSALS_MAX = 50  # in one pass; the others follow in the next ones
REFUSAL_EVERY_MS = 5_000  # for one order

# A bin given away is a bin that is not free: this change alone is not news.
_SAME = {Why.ROBOT_TAKEN_BY_OTHER.value: Why.ROBOT_NO_MORE_BIN.value}


def refusals(
    view: View,
    orders: Sequence[Order],
    code: NotAssigned,
    reasons: Callable[[Order], dict[RobotName, str]],
    now_ms: int,
) -> list[AnyProposal]:
    """Refuse the orders whose answer has changed since they last got one."""
    proposals: list[AnyProposal] = []
    for order in orders:
        if len(proposals) == REFUSALS_MAX:
            break
        before = order.allocation_reject
        if before is not None and now_ms - before.at_ms < REFUSAL_EVERY_MS:
            continue
        robots = reasons(order)
        if before is None or _is_news(before, code, robots):
            proposals.append(
                RejectAssignment(
                    scene=view.scene.id, order=order.id, code=code.value, robots=robots
                )
            )
    return proposals


def _is_news(before: Reject, code: NotAssigned, robots: dict[RobotName, str]) -> bool:
    if before.code != code or before.robots.keys() != robots.keys():
        return True
    return any(_SAME.get(w, w) != _SAME.get(robots[n], robots[n]) for n, w in before.robots.items())
