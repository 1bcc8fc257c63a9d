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

CROWD_NEWS_EVERY_MS = 60_000  # corridors fill and empty all the time

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
        if before is None or _is_news(before, code, robots, now_ms):
            proposals.append(
                RejectAssignment(
                    scene=view.scene.id, order=order.id, code=code.value, robots=robots
                )
            )
    return proposals


def _is_news(before: Reject, code: NotAssigned, robots: dict[RobotName, str], now_ms: int) -> bool:
    if before.code != code:
        return True
    if before.robots == robots:
        return False
    names = {name for name, _ in before.robots.items() ^ robots.items()}
    changes = {(_settled(before.robots.get(n)), _settled(robots.get(n))) for n in names}
    changes = {(old, new) for old, new in changes if old != new}
    if now_ms - before.at_ms < CROWD_NEWS_EVERY_MS:
        changes -= _CROWD_CHANGES
    return bool(changes)


def _settled(why: str | None) -> str | None:
    return None if why is None else _SAME.get(why, why)


_CROWD_CHANGES = {
    (Why.ROBOT_NO_MORE_BIN.value, Why.CORRIDOR_FULL.value),
    (Why.CORRIDOR_FULL.value, Why.ROBOT_NO_MORE_BIN.value),
}
