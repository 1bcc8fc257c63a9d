"""What the ledger's newest events tell without any database: orders that ended, one order's events.

The front door may hand in something that knows the whole past by heart; this needs nothing but the
ledger, and is quick for what people look at: what has just happened.
"""

from collections import OrderedDict
from collections.abc import Sequence
from threading import Lock

from ledger.events import AnyEvent
from ledger.events.orders import OfOrder, OrderCreated
from ledger.evolve_order import order_after, order_created
from ledger.ids import OrderId, SceneId
from ledger.snapshot import Read
from ledger.state import Order

EVENTS_BACK = 2_000  # that are searched for ended orders; about 10 ms
POSITIONS_KEPT = 16
STORIES_KEPT = 64


class Recent:
    """Remembers a little of what it found, for it is asked again and again. Thread-safe."""

    def __init__(self, read: Read) -> None:
        """Take how to read the ledger."""
        self._read = read
        self._lock = Lock()
        self._ended: OrderedDict[int, list[Order]] = OrderedDict()
        self._stories: OrderedDict[OrderId, tuple[int, list[AnyEvent]]] = OrderedDict()

    def finished(self, scene: SceneId, position: int, limit: int) -> Sequence[Order]:
        """Give orders of a scene that had ended shortly before a position, newest created first."""
        with self._lock:
            ended = self._ended.get(position)
            if ended is None:
                ended = self._ended[position] = self._search(position)
                while len(self._ended) > POSITIONS_KEPT:
                    self._ended.popitem(last=False)
        return [order for order in ended if order.scene == scene][:limit]

    def _search(self, position: int) -> list[Order]:
        orders: dict[OrderId, Order] = {}
        for event in self._read(max(0, position - EVENTS_BACK), position):
            if isinstance(event, OrderCreated):
                orders[event.order] = order_created(event)
            elif isinstance(event, OfOrder) and event.order in orders:
                orders[event.order] = order_after(orders[event.order], event)
        ended = [order for order in orders.values() if order.terminal]
        return sorted(ended, key=lambda order: (order.created_ms, order.id), reverse=True)

    def story(self, order: OrderId, position: int) -> Sequence[AnyEvent]:
        """Give all events of an order up to a position. The first look reads the whole ledger."""
        with self._lock:
            searched, found = self._stories.pop(order, (0, []))
            if position > searched:
                news = self._read(searched, position)
                found = [*found, *(e for e in news if isinstance(e, OfOrder) and e.order == order)]
            self._stories[order] = (max(searched, position), found)
            while len(self._stories) > STORIES_KEPT:
                self._stories.popitem(last=False)
            return found
