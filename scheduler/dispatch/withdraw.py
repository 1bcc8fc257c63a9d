"""Phase *withdraw*: take orders back from robots that cannot be expected to begin them.

An order of the system's own is not given to another robot: the core ends it.
"""

from ledger.proposals import AnyProposal, WithdrawOrder
from ledger.scene import PointKind
from ledger.state import BinStatus, Order, OrderKind, OrderStatus
from scheduler.dispatch.eligibility import trouble
from scheduler.dispatch.execution import is_acting, is_busy
from scheduler.dispatch.reasons import Why
from scheduler.dispatch.spots import Spots
from scheduler.view import RobotView, View

PATIENCE_MS = 30_000  # a short outage is cheaper than another robot's way
HOPELESS_MS = 60_000  # a robot that could not get on for so long should try another spot


def is_withdrawable(view: View, robot: RobotView, order: Order) -> bool:
    """Tell whether another robot could still take over: no load yet, and nothing half done.

    True for an order whose robot has not set out, and while a step that allows it
    (withdrawOrderAllowed) is only being driven to.
    """
    if view.scene.config.reallocation_off or order.kind is not OrderKind.BUSINESS:
        return False
    if order.loaded or order.fault_reason is not None:
        return False
    if order.status is OrderStatus.ALLOCATED and order.done_step < 0:
        return True
    at = robot.at
    if order.status is not OrderStatus.EXECUTING or at is None or at.order.id != order.id:
        return False
    return at.begun and at.step.task.withdrawable and not is_busy(view, robot)


def withdraw(view: View, so_far: tuple[AnyProposal, ...], now_ms: int) -> list[AnyProposal]:
    """Free the orders of robots that are disabled, or out of action for longer than patience.

    In a scene that rests as a whole nobody else would be any quicker.
    """
    if view.scene.disabled:
        return []
    proposals: list[AnyProposal] = []
    for robot in view.robots.values():
        for order in robot.orders:
            why = _out_of_action(view, robot, order, now_ms)
            if order.kind is not OrderKind.BUSINESS:
                reason = why or _pointless(view, robot, order, now_ms)
            else:
                reason = why if why and _may_leave(view, robot, order, why) else None
            if reason is not None:
                proposals.append(
                    WithdrawOrder(scene=view.scene.id, order=order.id, reason=reason.value)
                )
    return proposals


def _may_leave(view: View, robot: RobotView, order: Order, why: Why) -> bool:
    """A disabled robot is gone for good: all goes to others but loads, faults and bare promises.

    What it was lifting when it was last heard may be on board by now.
    """
    if why is not Why.ROBOT_DISABLED:
        return is_withdrawable(view, robot, order)
    assert order.bin is not None
    loaded = robot.robot.bins[order.bin].status is BinStatus.FILLED
    waits_for_steps = order.status is OrderStatus.PENDING
    lifting = robot.at is not None and robot.at.order.id == order.id and is_acting(robot)
    return not loaded and not waits_for_steps and not lifting and order.fault_reason is None


def _pointless(view: View, robot: RobotView, order: Order, now_ms: int) -> Why | None:
    """Say why an order of the system's own should end: to charge first, or for another spot."""
    if order.kind is not OrderKind.CHARGING and _should_charge_instead(view, robot):
        return Why.ROBOT_BATTERY_LOW
    if robot.stuck_ms(order, now_ms) < HOPELESS_MS or is_busy(view, robot):
        return None
    place = view.place(order.steps[-1].task.location) if order.steps else None
    arrived = place is not None and view.stands_at(robot, place)
    return None if arrived or order.fault_reason is not None else Why.ROBOT_BLOCKED


def _should_charge_instead(view: View, robot: RobotView) -> bool:
    if robot.battery_ratio >= view.levels(robot).charge_only or view.scene.config.charging_paused:
        return False
    return Spots(view, (), PointKind.CHARGING).take_nearest(robot) is not None


def _out_of_action(view: View, robot: RobotView, order: Order, now_ms: int) -> Why | None:
    why = trouble(view, robot)
    if why is None or why is Why.ROBOT_DISABLED:
        return why
    if why is Why.ROBOT_PAUSED:
        return None  # whoever paused it means it to go on with what it has
    return why if robot.stuck_ms(order, now_ms) >= PATIENCE_MS else None
