"""Phases *park* and *avoid*: idle robots go where they are in nobody's way."""

from ledger.ids import PointName
from ledger.proposals import AnyProposal, CreateSystemOrder
from ledger.scene import PointKind
from ledger.state import OrderKind
from scheduler.dispatch.eligibility import trouble
from scheduler.dispatch.execution import goals
from scheduler.dispatch.spots import Spots, engaged, is_idle
from scheduler.view import RobotView, View

IN_THE_WAY_MS = 5_000  # traffic pushes idle robots aside sooner than this, where it can


def park(view: View, so_far: tuple[AnyProposal, ...], now_ms: int) -> list[AnyProposal]:
    """Send robots that have been idle and still to the nearest free parking point."""
    if view.scene.config.parking_paused:
        return []
    robots = [r for r in _idle(view, so_far) if _should_park(view, r, now_ms)]
    return _send(view, so_far, robots, OrderKind.PARKING)


def avoid(view: View, so_far: tuple[AnyProposal, ...], now_ms: int) -> list[AnyProposal]:
    """Send idle robots off the points that others want and have not been pushed off in time."""
    wanted = {(goal.point, name) for name, goal in goals(view).items()}
    points: dict[PointName, set[str]] = {}
    for point, name in wanted:
        points.setdefault(point, set()).add(name)
    robots = [
        robot
        for robot in _idle(view, so_far)
        if now_ms - robot.still_since_ms >= IN_THE_WAY_MS
        and robot.report is not None
        and robot.report.point is not None
        and points.get(robot.report.point, set()) - {robot.name}
    ]
    return _send(view, so_far, robots, OrderKind.IDLE_AVOID)


def _idle(view: View, so_far: tuple[AnyProposal, ...]) -> list[RobotView]:
    if view.scene.disabled or view.scene.dispatch_paused:
        return []
    taken = engaged(so_far)
    return [
        robot
        for robot in view.robots.values()
        if robot.name not in taken and is_idle(robot) and trouble(view, robot) is None
    ]


def _should_park(view: View, robot: RobotView, now_ms: int) -> bool:
    place = _standing_on(view, robot)
    if place is PointKind.PARKING:
        return False
    if place is PointKind.CHARGING:
        levels = view.levels(robot)
        if robot.battery_ratio >= levels.charge_full:
            return True  # others may need the charger (spec/m4.md, chargeFull)
        if robot.battery_ratio < levels.charge_need:
            return False
    since_ms = max(robot.robot.idle_since_ms, robot.still_since_ms)
    return now_ms - since_ms >= view.scene.config.parking_idle_s * 1000


def _standing_on(view: View, robot: RobotView) -> PointKind | None:
    point = robot.report.point if robot.report is not None else None
    place = view.place(point) if point is not None else None
    return place.point.kind if place is not None else None


def _send(
    view: View, so_far: tuple[AnyProposal, ...], robots: list[RobotView], kind: OrderKind
) -> list[AnyProposal]:
    if not robots:
        return []
    parking = Spots(view, so_far, PointKind.PARKING)
    proposals: list[AnyProposal] = []
    for robot in robots:
        here = robot.report.point if robot.report is not None else None
        spot = parking.take_nearest(robot, but=here)
        if spot is not None:
            proposals.append(
                CreateSystemOrder(
                    scene=view.scene.id,
                    kind=kind,
                    robot=robot.name,
                    location=spot[0],
                    cost_s=spot[1],
                )
            )
    return proposals
