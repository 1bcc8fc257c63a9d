"""The reasons why orders wait, told when they change and no oftener than people can read them."""

from collections.abc import Callable, Sequence

from ledger.ids import RobotName
from ledger.proposals import AnyProposal, RejectAssignment
from ledger.state import Order, Reject
from scheduler.dispatch.reasons import NotAssigned, Why
from scheduler.view import View

REFUSALS_MAX = 50  # in one pass; the others follow in the next ones
REFUSAL_EVERY_MS = 5_000  # for one order
TURN_MS, TURNS = 1_000, 5  # refused orders are looked at again in turn, a fifth of them a second

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
    turn = now_ms // TURN_MS
    for place, order in enumerate(orders):
        if len(proposals) == REFUSALS_MAX:
            break
        before = order.allocation_reject
        if before is not None and (
            (place + turn) % TURNS != 0 or now_ms - before.at_ms < REFUSAL_EVERY_MS
        ):
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
    if before.code != code:
        return True
    changed = {name for name, _ in before.robots.items() ^ robots.items()}
    return any(_settled(before.robots.get(n)) != _settled(robots.get(n)) for n in changed)


def _settled(why: str | None) -> str | None:
    return None if why is None else _SAME.get(why, why)
