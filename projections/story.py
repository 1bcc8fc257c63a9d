"""What became of an order, and which orders ended lately: from DuckDB, and the ledger's newest."""

from collections.abc import Sequence

import msgspec

from ledger.events import AnyEvent
from ledger.events.orders import OfOrder
from ledger.ids import OrderId, SceneId
from ledger.state import Order
from projections.archive import Read
from projections.history import History
from projections.live import Live
from projections.order_keys import key_of

_event: msgspec.json.Decoder[AnyEvent] = msgspec.json.Decoder(AnyEvent)
_order = msgspec.json.Decoder(Order)

NEWS_MAX = 50_000  # events read from the ledger itself; behind more, DuckDB is waited for

_EVENTS = (
    "SELECT body FROM order_events WHERE id_key IS NOT DISTINCT FROM ? AND order_id = ? "
    'AND "position" <= ? ORDER BY "position"'
)
_ENDED = (
    "SELECT body FROM orders_done WHERE scene_id = ? AND done_position <= ? "
    "ORDER BY created_on DESC, id DESC LIMIT ?"
)


class Stories:
    """Answers the console. What DuckDB does not have yet is read from the ledger, or from memory.

    Slow (milliseconds): call it in a thread.
    """

    def __init__(self, history: History, live: Live, read: Read) -> None:
        """Take the two places where the past is, and how to read the ledger."""
        self._history = history
        self._live = live
        self._read = read

    def story(self, order: OrderId) -> Sequence[AnyEvent]:
        """Give all events of an order that are on disk."""
        projected = self._history.position
        behind = self._history.newest - NEWS_MAX
        with self._history.reading(max(projected, behind)) as cursor:
            key = key_of(order)
            keyed = None if key is None else key.key
            rows = cursor.execute(_EVENTS, [keyed, order, projected]).fetchall()
        found = [_event.decode(body) for (body,) in rows]
        news = self._read(projected)
        return [*found, *(e for e in news if isinstance(e, OfOrder) and e.order == order)]

    def finished(self, scene: SceneId, position: int, limit: int) -> Sequence[Order]:
        """Give orders of a scene that had ended by a position, newest created first."""
        # memory before DuckDB: an order on its way from one to the other is seen twice, not never
        ended = self._live.ended_by(position)
        need = min(self._live.history_position, position)
        with self._history.reading(need) as cursor:
            rows = cursor.execute(_ENDED, [scene, position, limit]).fetchall()
        orders = {order.id: order for order in (_order.decode(body) for (body,) in rows)}
        orders.update((order.id, order) for order in ended if order.scene == scene)
        return sorted(orders.values(), key=lambda o: (o.created_ms, o.id), reverse=True)[:limit]
