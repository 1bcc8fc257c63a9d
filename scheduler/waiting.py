"""The business orders of one scene that have no robot, most urgent first."""

from bisect import bisect_left, insort
from typing import TypeAlias

from ledger.ids import OrderId
from ledger.state import Order, OrderKind, OrderStatus

HEAD = 500  # the most urgent orders: every pass looks at them
SLICE = 500  # of the others, in turn, so that orders nobody can do do not hide those behind them

Urgency: TypeAlias = tuple[int, int, OrderId]  # -priority, created, id


class Waiting:
    """Kept sorted while events come in, for a site may have a hundred thousand of them."""

    def __init__(self) -> None:
        self._sorted: list[Urgency] = []
        self._known: dict[OrderId, Urgency] = {}
        self._next = 0

    def __len__(self) -> int:
        return len(self._sorted)

    def note(self, id_: OrderId, order: Order | None) -> None:
        """Take in what became of an order; None = it is no more. Faulted ones wait for people."""
        before = self._known.pop(id_, None)
        if before is not None:
            del self._sorted[bisect_left(self._sorted, before)]
        if order is None or order.kind is not OrderKind.BUSINESS:
            return
        if order.status is OrderStatus.TO_BE_ALLOCATED and order.fault_reason is None:
            urgency = (-order.priority, order.created_ms, id_)
            self._known[id_] = urgency
            insort(self._sorted, urgency)

    def slice(self) -> list[OrderId]:
        """Give the orders for one pass: the head, and the next slice of what is behind it."""
        ids = [urgency[2] for urgency in self._sorted[:HEAD]]
        if len(self._sorted) <= HEAD:
            return ids
        if not HEAD <= self._next < len(self._sorted):
            self._next = HEAD
        ids.extend(urgency[2] for urgency in self._sorted[self._next : self._next + SLICE])
        self._next += SLICE
        return ids
