"""What the dispatch phases see: one scene at one moment, state and reports side by side."""

from collections.abc import Mapping, Sequence

from ledger.ids import RobotName
from ledger.link import Report
from ledger.scene import Scene, Value
from ledger.scene_config import ChargingLevels
from ledger.state import Order, OrderKind, Robot
from scheduler.corridors import Corridors
from scheduler.current import Current
from scheduler.places import Place, Places
from scheduler.roads import Roads


class RobotView(Value, frozen=True, kw_only=True):
    """A robot as dispatch sees it: what the ledger knows and what the robot says."""

    name: RobotName  # unique in its scene
    robot: Robot
    orders: tuple[Order, ...] = ()  # assigned and not finished, first assigned first
    at: Current | None = None  # the step it is at, or would begin next
    report: Report | None = None  # its newest
    ready: bool = False  # traffic knows where it is and may move it
    blocked_by: tuple[RobotName, ...] = ()
    still_since_ms: int = 0  # since when it has not moved, as far as we have watched
    charging_since_ms: int | None = None  # since when it says that it charges

    @property
    def system_order(self) -> Order | None:
        """The order of the system's own that it has, if any; it never has two."""
        for order in self.orders:
            if order.kind is not OrderKind.BUSINESS:
                return order
        return None

    def stuck_ms(self, order: Order, now_ms: int) -> int:
        """Give for how long it has not moved while it should have, for this order."""
        begun_ms = [s.started_ms for s in order.steps if s.started_ms is not None]
        return now_ms - max(self.still_since_ms, order.assigned_ms or 0, *begun_ms)

    @property
    def battery_ratio(self) -> float:
        """Charge as last reported; full as long as nothing is known."""
        return 1.0 if self.report is None else self.report.battery_ratio


class View(Value, frozen=True, kw_only=True):
    """One scene at one moment. Everything that changes after the moment is in proposals."""

    scene: Scene
    places: Places
    corridors: Corridors = {}  # msgspec copies the default for each instance
    robots: Mapping[RobotName, RobotView]  # of this scene, sorted by name
    waiting: Sequence[Order]  # business orders without a robot, most urgent first; a limited slice
    roads: Roads
    broken_doors: frozenset[str] = frozenset()  # names: out of service, faulted, or not heard
    reallocate: bool = False  # may running orders change robots in this pass

    def place(self, location: str) -> Place | None:
        """Find a location on the map of the enabled areas."""
        return self.places.get(location)

    def stands_at(self, robot: RobotView, place: Place) -> bool:
        """Tell whether the robot rests at the place, which may be in another area."""
        if robot.report is None or robot.report.area != place.area:
            return False
        return self.roads.stands_at(robot.name, place.point.name)

    def cost_s(self, robot: RobotView, place: Place | None) -> float:
        """Give the driving time; infinite where no route leads there, as to another area."""
        if place is None or robot.report is None or robot.report.area != place.area:
            return float("inf")
        return self.roads.cost_s(robot.name, place.point.name)

    def reserved(self, robot: RobotView, place: Place | None) -> tuple[str, ...]:
        """Name the owners of reserved ground without which there would be a route."""
        if place is None or robot.report is None or robot.report.area != place.area:
            return ()
        return self.roads.reserved(robot.name, place.point.name)

    def levels(self, robot: RobotView) -> ChargingLevels:
        """Give the charging levels of its group."""
        charging = self.scene.config.charging
        return charging.by_group.get(robot.robot.config.group, charging.default)
