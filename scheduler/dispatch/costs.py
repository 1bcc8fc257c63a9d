"""What it costs to have an order done by a robot: seconds of driving on the real roads."""

from ledger.ids import RobotName
from ledger.state import Order, OrderKind
from scheduler.current import next_step
from scheduler.places import Place
from scheduler.view import RobotView, View

# A robot with orders in hand will not come at once. The figure is a guess at one errand's length;
# it only decides between robots of several bins, for a robot of one bin has no order in hand.
ORDER_IN_HAND_S = 60.0


def first_place(view: View, order: Order) -> Place | None:
    """Find where the order begins: its next step, else its first key location."""
    index = next_step(order)
    if index is not None:
        return view.place(order.steps[index].task.location)
    return view.place(order.key_locations[0]) if order.key_locations else None


class Costs:
    """Driving times of one pass, asked of traffic once for each robot and point."""

    def __init__(self, view: View) -> None:
        self._view = view
        self._known: dict[tuple[RobotName, str], float] = {}

    def cost_s(self, robot: RobotView, place: Place | None) -> float:
        """Give the driving time to the place; infinite = no route."""
        if place is None:
            return float("inf")
        key = (robot.name, place.point.name)
        cost_s = self._known.get(key)
        if cost_s is None:
            cost_s = self._known[key] = self._view.cost_s(robot, place)
        return cost_s


def in_hand(robot: RobotView) -> int:
    """Count the business orders it has already."""
    return sum(1 for o in robot.orders if o.kind is OrderKind.BUSINESS)
