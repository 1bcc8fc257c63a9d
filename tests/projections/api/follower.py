"""A client that follows a scene by the rules of docs/api-websocket.md."""

import json
from collections.abc import Mapping
from typing import Any

BY_ENTRY = ("ordersRecords", "trafficConditions", "doors", "lifts")


class Follower:
    """Holds a scene: from a snapshot, and then from every change."""

    def __init__(self, snapshot: Mapping[str, bytes], r_time: int | None) -> None:
        self._fields = {name: json.loads(part) for name, part in snapshot.items()}
        if "orders" in self._fields:
            self._fields["orders"] = {order["id"]: order for order in self._fields["orders"]}

    def apply(self, changes: Mapping[str, bytes], r_time: int | None) -> None:
        fields = self._fields
        decoded = {name: json.loads(part) for name, part in changes.items()}
        for name, change in decoded.items():
            if name == "robots":
                for robot, entry in change.items():
                    if entry is None:
                        fields["robots"].pop(robot, None)
                        continue
                    row = fields["robots"].setdefault(robot, {})
                    row |= entry
                    for field in [field for field, value in row.items() if value is None]:
                        del row[field]
            elif name == "orders" or name in BY_ENTRY:
                fields[name] |= change
                for key in [key for key, value in change.items() if value is None]:
                    del fields[name][key]
            else:
                fields[name] = change
        named = {r for r, e in decoded.get("robots", {}).items() if e and "rTime" in e}
        for robot, row in fields.get("robots", {}).items():
            if row["online"] and "rTime" in row and robot not in named and r_time is not None:
                row["rTime"] = r_time

    def scene(self) -> Any:
        """Give the scene as a query shows it."""
        shown = dict(self._fields)
        if "orders" in shown:
            newest = sorted(shown["orders"].values(), key=lambda o: (-o["createdOn"], o["id"]))
            shown["orders"] = newest
        return shown
