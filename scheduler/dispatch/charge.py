"""Phase *charge*: robots that need it go to a free charger (spec/m4.md, BasicChargingConfig).

Below charge_only at once, and then up to charge_ok before any other order; below charge_need when
idle, and then any order may call the robot away. Charging ends at charge_full (phase *continue*).
"""

from ledger.proposals import AnyProposal, CreateSystemOrder
from ledger.scene import PointKind
from ledger.state import OrderKind
from scheduler.dispatch.eligibility import charge_arguments, trouble
from scheduler.dispatch.spots import Spots, engaged, is_idle
from scheduler.view import RobotView, View


def charge(view: View, so_far: tuple[AnyProposal, ...], now_ms: int) -> list[AnyProposal]:
    """Make charging orders, the emptiest robot first: one robot to one charger."""
    if view.scene.config.charging_paused or view.scene.dispatch_paused or view.scene.disabled:
        return []
    taken = engaged(so_far)
    robots = [
        robot
        for robot in view.robots.values()
        if robot.name not in taken and is_idle(robot) and _needs_charge(view, robot, now_ms)
    ]
    if not robots:
        return []
    chargers = Spots(view, so_far, PointKind.CHARGING)
    proposals: list[AnyProposal] = []
    for robot in sorted(robots, key=lambda r: (r.battery_ratio, r.name)):
        spot = chargers.take_nearest(robot)
        if spot is not None:
            forced = robot.battery_ratio < view.levels(robot).charge_only
            proposals.append(
                CreateSystemOrder(
                    scene=view.scene.id,
                    kind=OrderKind.CHARGING,
                    robot=robot.name,
                    location=spot[0],
                    cost_s=spot[1],
                    arguments=charge_arguments(forced=forced),
                )
            )
    return proposals


def _needs_charge(view: View, robot: RobotView, now_ms: int) -> bool:
    levels = view.levels(robot)
    if trouble(view, robot) is not None or robot.battery_ratio >= levels.charge_need:
        return False
    idle_ms = now_ms - robot.robot.idle_since_ms
    return robot.battery_ratio < levels.charge_only or idle_ms >= levels.idle_s * 1000
