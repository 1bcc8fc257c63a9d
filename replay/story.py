"""The whole story of one order: every event in words, and the order that they lead to."""

from collections.abc import Sequence

from ledger.events import AnyEvent
from ledger.events.orders import OfOrder, OrderCreated
from ledger.evolve_order import order_after, order_created
from ledger.ids import OrderId
from ledger.state import Order
from replay.frame import OrderFrame, StepFrame, order_frame, step_frame
from replay.wire import Wire
from replay.words import event_words


class Told(Wire, frozen=True, kw_only=True):
    """One event of an order."""

    position: int
    at_ms: int
    type: str
    by: str
    command: str
    words: str


class Story(Wire, frozen=True, kw_only=True):
    """An order, its steps and its events, oldest first."""

    order: OrderFrame
    steps: tuple[StepFrame, ...]
    events: tuple[Told, ...]


def tell(order: OrderId, events: Sequence[AnyEvent], as_of_ms: int | None = None) -> Story | None:
    """Tell an order's events up to a moment; None if there was no such order yet."""
    state: Order | None = None
    told: list[Told] = []
    for event in events:
        if not isinstance(event, OfOrder) or event.order != order:
            continue
        if as_of_ms is not None and event.at_ms > as_of_ms:
            break
        if isinstance(event, OrderCreated):
            state = order_created(event)
        elif state is not None:
            state = order_after(state, event)
        told.append(
            Told(
                position=event.position,
                at_ms=event.at_ms,
                type=type(event).__name__,
                by=event.by,
                command=event.command,
                words=event_words(event),
            )
        )
    if state is None:
        return None
    return Story(
        order=order_frame(state),
        steps=tuple(step_frame(step) for step in state.steps),
        events=tuple(told),
    )
