"""Order ids: `TO<yyyymmdd>-<6 digits>`, and a suffix for orders of the system's own."""

import re
from datetime import UTC, datetime
from functools import lru_cache

from commands.command import scene_of
from commands.rejected import Reason, Rejected
from ledger.ids import OrderId
from ledger.state import Fleet, Order, OrderKind

DAY_MS = 86_400_000
SUFFIXES = {
    OrderKind.BUSINESS: "",
    OrderKind.PARKING: "P",
    OrderKind.IDLE_AVOID: "A",
    OrderKind.CHARGING: "C",  # the source shows P and A only
}

_ID = re.compile(r"TO([0-9]{8})-([0-9]{6,9})[PAC]?")


@lru_cache(maxsize=8)
def _date(day: int) -> str:
    return f"{datetime.fromtimestamp(day * DAY_MS / 1000, UTC):%Y%m%d}"


def next_order_id(fleet: Fleet, at_ms: int, kind: OrderKind) -> OrderId:
    """Give the next free id of the (UTC) day; all kinds share one count, as in the examples."""
    date = _date(at_ms // DAY_MS)
    number = fleet.order_counts.get(date, 0) + 1
    return OrderId(f"TO{date}-{number:06}{SUFFIXES[kind]}")


def was_made(fleet: Fleet, order: OrderId) -> bool:
    """Tell whether an order with this id was ever made.

    Finished orders have left the state; the day's count still tells which ids were given out.
    """
    if order in fleet.orders:
        return True
    parts = _ID.fullmatch(order)
    return parts is not None and 1 <= int(parts[2]) <= fleet.order_counts.get(parts[1], 0)


def live_order(fleet: Fleet, order: OrderId) -> Order:
    """Find an order that can still change; say whether another one is finished or unknown."""
    found = fleet.orders.get(order)
    if found is not None:
        return found
    if was_made(fleet, order):
        message = f"Order '{order}' is done or cancelled and changes no more."
        raise Rejected(Reason.ORDER_TERMINAL, message, order)
    raise unknown_order(order)


def order_in_service(fleet: Fleet, order: OrderId) -> Order:
    """Find an order to go on with or to change: a live one, of a scene that is in service."""
    found = live_order(fleet, order)
    scene_of(fleet, found.scene)
    return found


def unknown_order(order: OrderId) -> Rejected:
    """Say that no order has this id."""
    return Rejected(Reason.ORDER_UNKNOWN, f"There is no order with id '{order}'.", order)
