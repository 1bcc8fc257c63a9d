"""The business orders of one scene that have no robot, most urgent first."""

from bisect import bisect_left, insort
from collections.abc import Mapping, Sequence
from typing import TypeAlias

from ledger.ids import OrderId
from ledger.state import Order, OrderKind, OrderStatus
from scheduler.urgency import Urgency, urgency

HEAD = 500  # the most urgent orders: every pass looks at them
SLICE = 500  # of the others, in turn, so that orders nobody can do do not hide those behind them

Entry: TypeAlias = tuple[bool, Urgency, OrderId]  # suspended, and then last; key; id


class Waiting:
    """Kept sorted while events come in, for a site may have a hundred thousand of them."""

    def __init__(self, sort: Sequence[str] = ()) -> None:
        """Take the setting dispatch_sort."""
        self._sorted: list[Entry] = []
        self._known: dict[OrderId, Entry] = {}
        self._next = 0
        self._urgency = urgency(sort)

    def sort_by(self, sort: Sequence[str], orders: Mapping[OrderId, Order]) -> None:
        """Take a changed setting; the orders are looked at again."""
        self._urgency = urgency(sort)
        for id_ in self._known:
            self._known[id_] = self._entry(orders[id_])
        self._sorted = sorted(self._known.values())

    def _entry(self, order: Order) -> Entry:
        return (order.suspended, self._urgency(order), order.id)

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
            self._known[id_] = entry = self._entry(order)
            insort(self._sorted, entry)

    def slice(self) -> list[OrderId]:
        """Give the orders for one pass: the head, and the next slice of what is behind it."""
        ids = [entry[2] for entry in self._sorted[:HEAD]]
        if len(self._sorted) <= HEAD:
            return ids
        if not HEAD <= self._next < len(self._sorted):
            self._next = HEAD
        ids.extend(entry[2] for entry in self._sorted[self._next : self._next + SLICE])
        self._next += SLICE
        return ids
