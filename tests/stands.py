"""Who stands with somewhere to go, and whether a cause is named for it (design notes, §8, 6)."""

from collections.abc import Collection, Iterable, Mapping

from ledger.ids import RobotName
from ledger.link import Plan
from ledger.state import Order
from ledger.waits import WaitReason

STALL_MS = 120_000  # nobody may stand for longer without a named cause
MOVING_MS = 10_000  # who has moved since is under way, and a cause for those behind it
SHORT_MS = 15_000  # robots stand for less at every turn: not looked at
EVER = (WaitReason.BEHIND_ROBOT, WaitReason.YIELDING, WaitReason.PUSHED)  # no cause by themselves


def explained(plans: Mapping[RobotName, Plan], causes: Collection[RobotName]) -> set[RobotName]:
    """Robots whose waiting comes in the end from something else than robots that wait: from one of
    these causes, a person, a door, reserved ground, work, a queue before a dead end.
    """
    named = set(causes)
    behind: dict[RobotName, set[RobotName]] = {}
    for name, plan in plans.items():
        blockers = plan.blocked_by or (plan.wait.blockers if plan.wait is not None else ())
        behind[name] = set(blockers)
        if plan.wait is not None and plan.wait.reason not in EVER:
            named.add(name)
    more = True
    while more:
        found = {n for n, others in behind.items() if others & named or others - behind.keys()}
        more = not found <= named
        named |= found
    return named


def bound_ms(moved_ms: Mapping[RobotName, int], orders: Iterable[Order]) -> dict[RobotName, int]:
    """Since when each has stood with somewhere to go: since it moved, or was given its oldest order
    if that came later.
    """
    given_ms: dict[RobotName, int] = {}
    for order in orders:
        if order.robot is not None and order.assigned_ms is not None:
            given_ms[order.robot] = min(
                order.assigned_ms, given_ms.get(order.robot, order.assigned_ms)
            )
    return {name: max(at_ms, given_ms.get(name, 0)) for name, at_ms in moved_ms.items()}


class Stands:
    """Counts from when a robot last moved, or last had a named cause not to."""

    def __init__(self) -> None:
        """Nobody has stood yet."""
        self.unnamed_ms = 0  # the longest
        self.unnamed: object = None  # who, and its plan
        self._caused_ms: dict[RobotName, int] = {}

    @staticmethod
    def long(moved_ms: Mapping[RobotName, int], now_ms: int) -> list[RobotName]:
        """Those worth a look: of most moments there are none."""
        return [name for name, at_ms in moved_ms.items() if now_ms - at_ms > SHORT_MS]

    def look(
        self,
        standing: Iterable[RobotName],
        moved_ms: Mapping[RobotName, int],
        plans: Mapping[RobotName, Plan],
        causes: Collection[RobotName],
        now_ms: int,
    ) -> None:
        """Take in how things are; `causes`: robots that something is known to be wrong with."""
        moving = {n for n, at_ms in moved_ms.items() if now_ms - at_ms < MOVING_MS}
        named = explained(plans, moving.union(causes))
        self._caused_ms.update((name, now_ms) for name in (*causes, *named.difference(moving)))
        for name in standing:
            if name in named:
                continue
            stood_ms = now_ms - max(moved_ms[name], self._caused_ms.get(name, 0))
            if stood_ms > self.unnamed_ms:
                self.unnamed_ms, self.unnamed = stood_ms, (name, plans[name])
