"""Histories in which others want to be told of orders, and what they must hear, by a model."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import msgspec

from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.events import AnyEvent, CallbacksConfigured, OrderCancelled, OrderWithdrawn
from ledger.events.orders import OfOrder
from ledger.evolve import evolve, fold
from ledger.ids import OrderId
from ledger.state import Fleet, OrderStatus
from projections.callbacks import Callback
from tests.histories import history
from tests.strategies import SCENE

URLS = ("http://127.0.0.1:1/a", "http://127.0.0.1:1/b")
ALL = CallbackConfig(enabled=True, urls=URLS, retries_max=10_000, retry_s=0.001)
OPENED = 5  # so many events make the scene; settings may come behind them


def told_history(seed: int, count: int, settings: dict[int, CallbackConfig]) -> list[AnyEvent]:
    """Give the history with this seed, with changes of the settings before the events named."""
    events: list[AnyEvent] = []
    for index, event in enumerate(history(seed, count)):
        config = settings.get(index)
        if config is not None:
            events.append(CallbacksConfigured(scene=SCENE, callbacks=config, at_ms=event.at_ms))
        events.append(event)
    return [msgspec.structs.replace(e, position=n) for n, e in enumerate(events, 1)]


@dataclass(frozen=True)
class Heard:
    """What one address must hear of one order: no more than a person would write down."""

    url: str
    order: OrderId
    status: CallbackStatus
    position: int


def heard(callbacks: Sequence[Callback]) -> list[Heard]:
    """Take of callbacks what the model knows of them."""
    return [Heard(c.url, c.order, c.status, c.position) for c in callbacks]


def expected(events: Sequence[AnyEvent]) -> Iterator[Heard]:
    """Find out from whole states, before and after each event, what must be heard."""
    fleet = Fleet()
    last: dict[OrderId, str] = {}
    for event in events:
        config = fleet.scenes[SCENE].callbacks if SCENE in fleet.scenes else CallbackConfig()
        words: list[str] = []
        order = None
        if isinstance(event, OfOrder):
            was = fleet.orders.get(event.order)
            evolve(fleet, event)
            order = fleet.orders.get(event.order)
            words = _words(event, last.get(event.order, ""), order, sealed=bool(was and was.sealed))
            if words:
                last[event.order] = words[-1]
        else:
            evolve(fleet, event)
        for word in words:
            status = CallbackStatus(word)
            if config.enabled and (not config.statuses or status in config.statuses):
                for url in config.urls:
                    assert isinstance(event, OfOrder)
                    yield Heard(url, event.order, status, event.position)


def _words(event: AnyEvent, last: str, order: object, *, sealed: bool) -> list[str]:
    if isinstance(event, OrderCancelled):
        return ["Cancelling", "Cancelled"]
    if isinstance(event, OrderWithdrawn):
        return ["Withdrawing", "ToBeAllocated"]
    status = getattr(order, "status", OrderStatus.DONE).value  # who has left the state is done
    if status == last or (status == "Pending" and sealed):
        return []
    return [status]


def fleet_at(events: Sequence[AnyEvent], position: int) -> Fleet:
    return fold(Fleet(), events[:position])
