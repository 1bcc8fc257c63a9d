"""Events into rows of the history: an order becomes a row when it has ended and changes no more."""

from collections.abc import Iterable

from ledger.events import AnyEvent, OrderCreated, SceneImported, SceneRenamed
from ledger.events.orders import OfOrder
from ledger.evolve_order import order_after, order_created
from ledger.state import Fleet
from projections.tables import Placed


class Projector:
    """A fold of its own over the orders, for it may be behind or ahead of what queries see."""

    def __init__(self, fleet: Fleet) -> None:
        """Take the state to go on from; it is not changed."""
        self.position = fleet.position
        self._orders = dict(fleet.orders)
        self._scene_names = {id_: scene.name for id_, scene in fleet.scenes.items()}
        self.events: list[AnyEvent] = []
        self.ended: list[Placed] = []

    def take_all(self, events: Iterable[AnyEvent]) -> None:
        """Take in the next events."""
        for event in events:
            self.take(event)

    def take(self, event: AnyEvent) -> None:
        """Take in the next event."""
        assert event.position == self.position + 1, f"{event.position} after {self.position}"
        if isinstance(event, OrderCreated):
            self._orders[event.order] = order_created(event)
        elif isinstance(event, OfOrder):
            order = order_after(self._orders[event.order], event)
            if order.terminal:
                del self._orders[order.id]
                name = self._scene_names[order.scene]
                self.ended.append(Placed(order=order, scene_name=name, position=event.position))
            else:
                self._orders[order.id] = order
        elif isinstance(event, SceneImported | SceneRenamed):
            self._scene_names[event.scene] = event.name
        self.events.append(event)
        self.position = event.position

    def clear(self) -> None:
        """Begin the next batch."""
        self.events, self.ended = [], []
