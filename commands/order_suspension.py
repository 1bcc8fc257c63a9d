"""Orders held up by a person, and let go on (spec/protocols.md §1.6, `set-suspended`)."""

from commands.command import Command, Decision, at_most
from commands.ids import live_order
from commands.orders import BATCH_ORDERS_MAX
from commands.rejected import Reason, Rejected
from ledger.events import OrderSuspended, OrderUnsuspended
from ledger.ids import OrderId
from ledger.state import Fleet, Order


class SuspendOrders(Command, frozen=True, kw_only=True):
    """Hold orders up, or let them go on; each on its own."""

    orders: tuple[OrderId, ...]
    suspended: bool


def suspend(fleet: Fleet, command: SuspendOrders) -> Decision:
    """A suspended order keeps its robot and its load; it can be changed and cancelled as ever."""
    at_most(len(command.orders), BATCH_ORDERS_MAX, "orderIds")
    event = OrderSuspended if command.suspended else OrderUnsuspended
    events: list[OrderSuspended | OrderUnsuspended] = []
    refused: dict[str, Rejected] = {}
    for id_ in dict.fromkeys(command.orders):
        try:
            order = live_order(fleet, id_)
        except Rejected as no:
            refused[id_] = no.with_traceback(None)
            continue
        if order.suspended is not command.suspended:
            events.append(event(scene=order.scene, order=id_))
    return Decision(events=tuple(events), refused=refused)


def check_not_suspended(order: Order) -> None:
    """Refuse to go on with an order that somebody holds up."""
    if order.suspended:
        message = f"Order '{order.id}' is suspended."
        raise Rejected(Reason.ORDER_SUSPENDED, message, order.id)
