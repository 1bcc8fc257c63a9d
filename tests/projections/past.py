"""Orders and histories for tests of the read side, and DuckDB tables filled with them."""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from ledger.events import (
    AnyEvent,
    CommandAnswered,
    OrderCancelled,
    OrderFinished,
    SceneImported,
    SceneRenamed,
)
from ledger.evolve import fold
from ledger.evolve_order import order_after, order_created
from ledger.ids import CommandId, OrderId, SceneId
from ledger.state import Fleet, Order
from projections.archive import Archive
from projections.find import Find
from projections.history import History
from projections.live import Live
from projections.projector import Projector
from projections.reading import Reader
from projections.tables import Placed
from tests.histories import history
from tests.strategies import SCENE

SCENE_NAME = "hall 考核"
NAMES = {SCENE: SCENE_NAME}


def archive_of(orders: Sequence[Order]) -> Archive:
    """Tables in memory that hold these orders, whatever their state, as if they had ended."""
    archive = Archive.open(None)
    projector = Projector(Fleet())
    projector.ended = [
        Placed(order=order, scene_name=SCENE_NAME, position=n) for n, order in enumerate(orders)
    ]
    projector.events = [
        CommandAnswered(
            scene=SCENE, position=1, command=CommandId("c"), digest="", status=200, body=""
        )
    ]
    archive.commit(projector)
    return archive


class Log:
    """Events of a history, read as a ledger is read."""

    def __init__(self, events: Sequence[AnyEvent]) -> None:
        self.events = list(events)

    def read(self, after: int) -> Iterator[AnyEvent]:
        return iter(self.events[after:])

    def fleet_at(self, position: int) -> Fleet:
        return fold(Fleet(), self.events[:position])

    def moment(self, at_ms: int) -> Fleet:
        return fold(Fleet(), [e for e in self.events if e.at_ms <= at_ms])


def long_log(count: int = 600, seed: int = 74) -> Log:
    """A history in which many orders have ended; the same for the same arguments."""
    return Log(_long(count, seed))


@lru_cache
def _long(count: int, seed: int) -> tuple[AnyEvent, ...]:
    return tuple(history(seed, count))


def all_orders(log: Log) -> dict[OrderId, Order]:
    """Every order there ever was, as it is at the end: the plain truth to compare with."""
    orders: dict[OrderId, Order] = {}
    for event in log.events:
        order: Any = getattr(event, "order", None)
        if order is None:
            continue
        orders[order] = (
            order_after(orders[order], event) if order in orders else order_created(event)
        )
    return orders


def scene_names(log: Log) -> dict[OrderId, str]:
    """The name of each order's scene: where it has ended, the one of that time."""
    orders = all_orders(log)
    names: dict[OrderId, str] = {}
    known: dict[SceneId, str] = {}
    for event in log.events:
        if isinstance(event, SceneImported | SceneRenamed):
            known[event.scene] = event.name
        elif isinstance(event, OrderFinished | OrderCancelled):
            names[event.order] = known[event.scene]
    return {id_: names.get(id_) or known[order.scene] for id_, order in orders.items()}


class Side:
    """The read side over a log that is known up to a position: everything but HTTP."""

    def __init__(self, folder: Path, log: Log, position: int) -> None:
        self.log = log
        self.live = Live(log.fleet_at(position))
        self.history = History(folder / "history.duckdb", self.live)
        self.history.start(Log(log.events[:position]).read, log.fleet_at, wait_s=20)
        self._dress()

    def _dress(self) -> None:
        log = self.log
        self.reader = Reader(self.history.cursor, self.history.damaged)
        self.find = Find(self.live, self.reader, log.moment, lambda: log.events[-1].at_ms)

    def reach(self, position: int) -> None:
        with self.history.moved:
            assert self.history.moved.wait_for(lambda: self.history.position >= position, 20)

    def go_on(self, until: int) -> None:
        events = self.log.events[self.live.position : until]
        self.live.apply(events)
        self.history.follow(events)

    def close(self) -> None:
        self.reader.close()
        self.history.close()
