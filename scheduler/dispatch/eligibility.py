"""May this robot take that order? If not, one coded reason: the first that applies."""

import json

from ledger.link import AlarmLevel
from ledger.state import BinStatus, Order, OrderKind
from scheduler.dispatch.execution import CHARGE, keeps_robot
from scheduler.dispatch.reasons import Why
from scheduler.dispatch.stopped import stopped
from scheduler.view import RobotView, View

_SERIOUS = frozenset({AlarmLevel.ERROR, AlarmLevel.FATAL})


def charge_arguments(*, forced: bool) -> str:
    """Give the arguments of a charging order's step; `forced` survives in them over restarts."""
    return json.dumps({"operation": CHARGE, "forced": forced}, separators=(",", ":"))


def trouble(view: View, robot: RobotView) -> Why | None:
    """Say what is wrong with the robot itself, be it for taking orders or for getting on."""
    if robot.robot.config.disabled:
        return Why.ROBOT_DISABLED
    if not robot.robot.online:
        return Why.ROBOT_OFFLINE
    report = robot.report
    if report is None:  # not heard since we started: nothing is known to be wrong
        return None
    why = stopped(robot)
    if why is not None:
        return why
    if report.alarms and view.scene.config.pause_on_robot_error:
        return Why.ROBOT_FAULT if any(a.level in _SERIOUS for a in report.alarms) else None
    return None


def must_charge(view: View, robot: RobotView) -> bool:
    """Tell whether it may do nothing but charge (spec/m4.md, BasicChargingConfig).

    Forced charging begins below charge_only and ends at charge_ok, not before.
    """
    levels = view.levels(robot)
    if robot.battery_ratio < levels.charge_only:
        return True
    if robot.battery_ratio >= levels.charge_ok:
        return False
    order = robot.system_order
    return order is not None and _is_forced(order)


def _is_forced(order: Order) -> bool:
    if order.kind is not OrderKind.CHARGING:
        return False
    return any(json.loads(s.task.arguments or "{}").get("forced") is True for s in order.steps)


def has_just_begun_to_charge(view: View, robot: RobotView, now_ms: int) -> bool:
    """Tell whether charging_min_s is not over yet; breaking off sooner wears contacts."""
    since_ms = robot.charging_since_ms
    if since_ms is None or robot.system_order is None:
        return False
    return now_ms - since_ms < view.levels(robot).charging_min_s * 1000


def free_bins(robot: RobotView) -> list[int]:
    """Give the bins that may get an order, in the order of use: one active order for each bin.

    The bin of a parking, charging or avoiding order counts as free and comes first, for the core
    ends such an order when it assigns another one to its bin.
    """
    bins = [n for n, b in enumerate(robot.robot.bins) if b.status is BinStatus.EMPTY]
    system = robot.system_order
    if system is not None and system.bin is not None:
        bins.insert(0, system.bin)
    return bins


def standing_reason(view: View, robot: RobotView, now_ms: int) -> Why | None:
    """Say why the robot can take no order at all just now, whatever the order."""
    why = trouble(view, robot)
    if why in (Why.ROBOT_DISABLED, Why.ROBOT_OFFLINE):
        return why
    if robot.robot.off_duty:
        return Why.ROBOT_OFF_DUTY
    if not robot.ready:
        return Why.ROBOT_NOT_READY
    if why is not None:
        return why
    if must_charge(view, robot):
        return Why.ROBOT_BATTERY_LOW
    if has_just_begun_to_charge(view, robot, now_ms):
        return Why.ROBOT_CHARGING
    if not free_bins(robot):
        return Why.ROBOT_NO_MORE_BIN
    if keeps_robot(robot):
        return Why.ROBOT_BUSY_KEEPS_ORDER
    return None


def wants(view: View, order: Order, robot: RobotView) -> bool:
    """Tell whether the order allows the robot: by name, by group, or by saying nothing."""
    if not order.wanted_robots and not order.wanted_groups:
        return True
    if robot.name in order.wanted_robots:
        return True
    group = robot.robot.config.group
    return any(g.name in order.wanted_groups for g in view.scene.groups if g.id == group)
