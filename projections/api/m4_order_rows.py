"""The orders of a scene as its clients look on: which ones, and each encoded once.

An order that has not changed is the same value, so its JSON of last time is taken again: what is
polled every second costs little, however many orders wait.
"""

import heapq
from collections.abc import Iterable
from typing import Any, TypeAlias

import msgspec

from ledger.ids import OrderId, SceneId
from ledger.scene import Scene
from ledger.state import TERMINAL, Fleet, Order, OrderStatus
from projections.api.m4_models import OrderQueryType
from projections.api.m4_orders import reject_row
from projections.fields import BY_NAME, CREATED, ID, SHOWN, Row, row
from projections.find import Asked, At, Find
from projections.query import Both, Either, How, Test
from projections.sorting import Key

UNFINISHED_MAX = 5_000  # of one answer, the newest; find/* has all
ENDED_MAX = 1_000  # likewise; as many are kept in memory
ENCODED_KEPT = 20_000

Shown: TypeAlias = Order | Row  # from memory, or from the history


class EncodedOrders:
    """The JSON of orders lately shown."""

    def __init__(self) -> None:
        self._rows: dict[OrderId, tuple[Order, str, msgspec.Raw]] = {}

    def row(self, order: Order, scene_name: str) -> msgspec.Raw:
        """Give the entity of an order as JSON."""
        known = self._rows.get(order.id)
        if known is not None and known[0] is order and known[1] == scene_name:
            return known[2]
        if len(self._rows) >= ENCODED_KEPT:
            self._rows.clear()  # those that are looked at come back with the next answer
        encoded = msgspec.Raw(msgspec.json.encode(row(order, scene_name)))
        self._rows[order.id] = (order, scene_name, encoded)
        return encoded

    def rows(self, shown: Iterable[Shown], scene: Scene) -> list[Any]:
        """Give entities, encoded or not."""
        return [self.row(s, scene.name) if isinstance(s, Order) else s for s in shown]


def newest_first(order: Order) -> tuple[int, str]:
    """Rank an order in an answer: the newest first, then by id."""
    return -order.created_ms, order.id


def unfinished(fleet: Fleet, scene: Scene) -> list[Order]:
    """Give the orders of a scene that have not ended, in no order."""
    return [order for order in fleet.orders.values() if order.scene == scene.id]


def newest(orders: Iterable[Order], number: int) -> list[Order]:
    """Give so many of the newest, the newest first."""
    known = list(orders)
    if len(known) > number:
        return heapq.nsmallest(number, known, key=newest_first)
    return sorted(known, key=newest_first)


async def shown_orders(
    find: Find, live: list[Order], scene: Scene, kind: OrderQueryType, at_ms: At | None
) -> list[Shown]:
    """Give the orders that a scene query shows; `live` are those that have not ended."""
    if kind is OrderQueryType.FAULTED:
        faulted = (order for order in live if order.fault_reason is not None)
        return list(newest(faulted, UNFINISHED_MAX))
    first: list[Shown] = list(newest(live, UNFINISHED_MAX))
    if kind is OrderQueryType.UNFINISHED:
        return first
    known = {order.id for order in live}  # one that ends just now comes once
    return first + [s for s in await ended(find, scene.id, at_ms) if _id(s) not in known]


def _id(shown: Shown) -> str:
    return shown.id if isinstance(shown, Order) else str(shown["id"])


async def ended(find: Find, scene: SceneId, at_ms: At | None) -> list[Shown]:
    """Give the newest orders of a scene that are done or cancelled, the newest first."""
    if at_ms is None:
        moment = find.live.now()
        kept = [order for order in moment.newest if order.scene == scene]
        if moment.newest_are_all or len(kept) >= ENDED_MAX:  # else older ones of it may be wanted
            kept += [order for order in moment.ended if order.scene == scene]
            names = moment.names_at_end
            return [
                row(order, names[order.id]) if order.id in names else order
                for order in newest(kept, ENDED_MAX)
            ]
    ends = tuple(Test(field=BY_NAME["status"], how=How.EQUAL, value=s.value) for s in TERMINAL)
    of_scene = Test(field=BY_NAME["sceneId"], how=How.EQUAL, value=scene)
    condition = Both(items=(of_scene, Either(items=ends)))
    sort = (Key(field=CREATED, descending=True), Key(field=ID))
    asked = Asked(condition=condition, fields=SHOWN, sort=sort)
    return list((await find.some(asked, 0, ENDED_MAX, at_ms)).rows)


def record(order: Order) -> Row:
    """Give the OrderRuntimeRecord (spec/m4.md §8)."""
    return {
        "orderId": order.id,
        "status": order.status.value,
        "allocationReject": reject_row(order.allocation_reject),
        "executionReject": reject_row(order.execution_reject),
        "createdOn": order.created_ms,
    }


def dispatch_profile(live: Iterable[Order]) -> Row:
    """Count the unfinished orders by status: the source does not describe this type."""
    profile = {status.value: 0 for status in OrderStatus if status not in TERMINAL}
    for order in live:
        profile[order.status.value] += 1
    return profile
