"""How many orders lead into each single-lane corridor: a third robot there only waits for two."""

from collections import Counter
from collections.abc import Iterable

from ledger.ids import PointName
from ledger.state import Order, OrderKind, StepStatus
from scheduler.view import View


class Crowding:
    """The counts of one pass. Orders of the system's own do not count: they hold up no business."""

    def __init__(self, view: View) -> None:
        self._view = view
        self._counts: Counter[PointName] = Counter()
        for robot in view.robots.values():
            for order in robot.orders:
                if order.kind is OrderKind.BUSINESS:
                    self.enter(order)

    def _corridors(self, order: Order) -> dict[PointName, int]:
        found: dict[PointName, int] = {}  # corridor -> how many orders it takes
        for step in order.steps:
            place = self._view.place(step.task.location)
            if place is not None and step.status is not StepStatus.DONE:
                corridor = self._view.corridors.get(place.point.name)
                if corridor is not None:
                    found[corridor.name] = corridor.orders_max
        return found

    def is_full(self, order: Order) -> bool:
        """Tell whether one of the corridors that a waiting order leads to has enough of them."""
        return any(self._counts[c] >= n for c, n in self._corridors(order).items())

    def enter(self, order: Order) -> None:
        """Count one more order."""
        self._counts.update(self._corridors(order).keys())

    def leave(self, orders: Iterable[Order]) -> None:
        """Take back orders that found no robot after all."""
        for order in orders:
            self._counts.subtract(self._corridors(order).keys())
