"""A scene followed: what has changed since the last look, and all of it for who comes new.

What applying the changes gives is what a scene query with NoFinishedOrders shows, field by field;
`replyTimestamp` alone is not followed. The rules for applying are in docs/api-websocket.md.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias

import msgspec

from ledger.ids import OrderId, SceneId
from ledger.scene import Scene
from ledger.state import Order
from projections.api.m4_order_rows import (
    UNFINISHED_MAX,
    EncodedOrders,
    newest,
    record,
    unfinished,
)
from projections.api.m4_scene_query import FIELDS, Beside, Look, field_value, plans_of
from projections.api.m4_scenes import scene_asked
from projections.api.robot_changes import RobotChanges
from projections.fields import Row
from projections.live import Live

FOLLOWED = tuple(field for field in FIELDS if field != "replyTimestamp")
# what a client gets that names no fields: all that changes while a scene is at work
USUAL = (
    "status",
    "robots",
    "orders",
    "goingCount",
    "faultCount",
    "trafficConditions",
    "doors",
    "lifts",
    "pauseStatus",
    "externalMapRes",
)
KEYED = frozenset({"ordersRecords", "trafficConditions", "doors", "lifts"})  # change by entry
# which top-level fields can only change with the ledger, or with what traffic intends
OF_LEDGER = (
    frozenset(FOLLOWED)
    - {"status", "robots", "trafficConditions", "trafficDebug"}
    - {
        "doors",
        "lifts",
    }
)
OF_TRAFFIC = frozenset({"status", "trafficConditions", "trafficDebug"})

Fragments: TypeAlias = dict[str, bytes]  # JSON by top-level field


class SceneChanges:
    """Follows one scene."""

    def __init__(
        self,
        live: Live,
        scene: SceneId,
        beside: Beside,
        encoded: EncodedOrders,
        now_ms: Callable[[], int],
    ) -> None:
        """Take the live view, what others know of a scene, and the JSON of orders."""
        self._live = live
        self._id = scene
        self._beside = beside
        self._encoded = encoded
        self._now_ms = now_ms
        self._robots = RobotChanges()
        self._orders: dict[OrderId, tuple[Order, str]] = {}
        self._values: dict[str, Any] = {}  # of the other fields, as they were shown last
        self._wanted: frozenset[str] = frozenset()
        self._position = -1

    @property
    def instant_ms(self) -> int | None:
        """The instant of all robots who answer."""
        return self._robots.instant_ms

    def look(self, wanted: frozenset[str]) -> Fragments:
        """Give what has changed of these fields; raises Refused once the scene is gone.

        A field that was not wanted before comes whole.
        """
        live = self._live
        scene = scene_asked(live.fleet, self._id, None)
        new_fields = wanted - self._wanted
        moved = live.fleet.position != self._position or bool(new_fields)
        self._position, self._wanted = live.fleet.position, wanted
        found: Fragments = {}
        changes = self._robots.look(live, scene, moved=moved)
        if changes and "robots" in wanted:
            found["robots"] = msgspec.json.encode(changes)
        orders = tuple(unfinished(live.fleet, scene)) if moved else ()
        if moved:
            self._look_at_orders(orders, scene, wanted, found)
        stale = {"doors", "lifts"} | (OF_LEDGER if moved else frozenset())
        stale |= OF_TRAFFIC if self._robots.plans_changed or new_fields else frozenset()
        fields = (wanted & stale) - {"robots", "orders", "ordersRecords"}
        if fields:
            self._look_at_values(fields, scene, orders, found)
        return found

    def _look_at_orders(
        self,
        orders: tuple[Order, ...],
        scene: Scene,
        wanted: frozenset[str],
        found: Fragments,
    ) -> None:
        if wanted.isdisjoint({"orders", "ordersRecords"}):
            return
        known = orders if len(orders) <= UNFINISHED_MAX else newest(orders, UNFINISHED_MAX)
        before, now = self._orders, {order.id: (order, scene.name) for order in known}
        changed = [
            id_
            for id_, (order, name) in now.items()
            if (old := before.get(id_)) is None or old[0] is not order or old[1] != name
        ]
        self._orders = now
        gone = dict.fromkeys(before.keys() - now.keys())
        if not (changed or gone):
            return
        if "orders" in wanted:
            rows = {id_: self._encoded.row(*now[id_]) for id_ in changed}
            found["orders"] = msgspec.json.encode(rows | gone)
        if "ordersRecords" in wanted:
            records = {id_: record(now[id_][0]) for id_ in changed}
            found["ordersRecords"] = msgspec.json.encode(records | gone)

    def _look_at_values(
        self, fields: Iterable[str], scene: Scene, orders: tuple[Order, ...], found: Fragments
    ) -> None:
        look = self._seen_now(scene, orders)
        for field in fields:
            value = field_value(field, look, self._beside)
            if field not in self._values:
                found[field] = msgspec.json.encode(value)
            elif field in KEYED:
                changes = _entries(self._values[field], value)
                if changes:
                    found[field] = msgspec.json.encode(changes)
            elif value != self._values[field]:
                found[field] = msgspec.json.encode(value)
            self._values[field] = value

    def _seen_now(self, scene: Scene, orders: tuple[Order, ...]) -> Look:
        return Look(
            fleet=self._live.fleet,
            scene=scene,
            live=self._live,
            plans=plans_of(self._live, self._robots.shown()),
            orders=orders,
            at_ms=self._now_ms(),
        )

    def whole(self, fields: Iterable[str]) -> Fragments:
        """Give these fields as of the last look."""
        return {field: self._whole(field) for field in fields}

    def _whole(self, field: str) -> bytes:
        if field == "robots":
            return msgspec.json.encode(self._robots.rows())
        if field in ("orders", "ordersRecords"):
            orders = newest((order for order, _ in self._orders.values()), UNFINISHED_MAX)
            if field == "ordersRecords":
                return msgspec.json.encode({order.id: record(order) for order in orders})
            rows = [self._encoded.row(*self._orders[order.id]) for order in orders]
            return msgspec.json.encode(rows)
        return msgspec.json.encode(self._values[field])


def _entries(before: Mapping[str, Any], now: Mapping[str, Any]) -> Row:
    """Give the entries that differ, and null for those that are gone."""
    changes: Row = {key: value for key, value in now.items() if before.get(key) != value}
    return changes | dict.fromkeys(before.keys() - now.keys())
