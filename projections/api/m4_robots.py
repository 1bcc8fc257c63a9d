"""A robot as M4's pages and clients see it: the UiRobotReport (spec/m4.md §5).

Fields without a value are absent, lists are there although empty. Doubles are rounded as in the
source's note and its example: 3 decimals, 4 for the heading, 5 for the confidence (C6).

The row comes in parts, each of different inputs, so that who follows a robot makes anew only the
part whose inputs have changed.
"""

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import TypeAlias

import msgspec

from ledger.ids import OrderId
from ledger.link import DISPATCHER, DOOR, EXTERNAL, ActionPhase, Load, Plan, Report, Space
from ledger.scene import XY, Group, Scene, Value
from ledger.state import Order, OrderKind, OrderStatus, Robot, RobotBin
from projections.api.m4_raw_report import alarm_row, navigation_status, raw_report
from projections.fields import Row

OURS = frozenset({"", DISPATCHER})  # holders of control under whom a robot may be dispatched
SPACES_KEPT = 50_000  # encoded ground, newest used; the same cells come again and again
EXACT_MAX = 2.0**53  # beyond, a double has no decimals to round

# name on the wire, field of the report, 10 to the number of decimals kept
NUMBERS: tuple[tuple[str, str, float], ...] = (
    ("x", "x_m", 1e3),
    ("y", "y_m", 1e3),
    ("d", "heading_rad", 1e4),
    ("v", "speed_mps", 1e3),
    ("rv", "turn_radps", 1e3),
    ("battery", "battery_ratio", 1e3),
    ("c", "confidence", 1e5),
    ("to", "odometer_today_m", 1e3),
)

Points: TypeAlias = Mapping[str, str]  # bin -> the point from which it is reached


class Seen(Value, frozen=True, kw_only=True):
    """All that is known of a robot at one instant."""

    robot: Robot
    group: Group
    report: Report | None  # as brought to the instant
    own: Report | None  # as the robot sent it
    plan: Plan | None
    orders: Mapping[OrderId, Order]
    points: Points


def ui_report(seen: Seen, *, raw: bool, raw_fields: Collection[str] | None = None) -> Row:
    """Give the UiRobotReport."""
    known = orders_of(seen.robot, seen.orders)
    row = identity(seen.robot, seen.group)
    if seen.report is not None:
        row |= numbers(seen.report)
    row |= said(seen.robot, seen.group, seen.report)
    if raw and seen.own is not None:
        row["raw"] = raw_report(seen.own, seen.plan, raw_fields)
    row |= errand(seen.robot, known, seen.report, seen.plan)
    return row | traffic(known, seen.report, seen.plan, seen.points)


def bin_points(scene: Scene) -> dict[str, str]:
    """Say from which point each bin of the scene is reached."""
    return {bin_.name: bin_.point for area in scene.areas for bin_ in area.bins}


def orders_of(robot: Robot, orders: Mapping[OrderId, Order]) -> tuple[Order, ...]:
    """Give the orders that a robot has."""
    return tuple([orders[id_] for id_ in robot.orders if id_ in orders])


def identity(robot: Robot, group: Group) -> Row:
    """Give what the ledger says of the robot itself."""
    row: Row = {
        "name": robot.name,
        "offDuty": robot.off_duty,
        "online": robot.online,
        "disabled": robot.config.disabled,
        "mock": robot.config.simulated,
        "collision": _collision(group),
        "bins": [_bin(index, content) for index, content in enumerate(robot.bins)],
        "noAc": robot.given_up,
    }
    if robot.given_up:
        row["connectMsg"] = "The robot does not answer; nobody tries any more until asked to."
    elif not robot.online:
        row["connectMsg"] = "The robot does not answer."
    return row


def rounded(value: float, scale: float) -> float:
    """Round so that arrays of numpy give the same, to the last digit."""
    scaled = value * scale
    return round(scaled) / scale if -EXACT_MAX < scaled < EXACT_MAX else value


def numbers(report: Report) -> Row:
    """Give what changes with every report while a robot drives."""
    row: Row = {"rTime": report.at_ms}
    for name, field, scale in NUMBERS:
        row[name] = rounded(getattr(report, field), scale)
    return row


def said(robot: Robot, group: Group, report: Report | None) -> Row:
    """Give the rest of what the robot reports."""
    if report is None:
        return {
            "cff": False,
            "emc": False,
            "sEmc": False,
            "blocked": False,
            "charging": False,
            "reloc": "Init",
        }
    row: Row = {
        "areaId": report.area,
        "map": report.map_name,
        "mapMd5": report.map_digest,
        "cff": robot.online and report.controller in OURS,
        "emc": report.emergency_stop,
        "sEmc": report.soft_stop,
        "blocked": report.blocked,
        "charging": report.charging,
        "reloc": "Success",
    }
    if report.point is not None:
        row["p"] = report.point
    if report.controller:
        row["controller"] = report.controller
    if report.blocked_reason is not None:
        row["blockedMsg"] = report.blocked_reason
    if report.loads:
        row["loads"] = [load_row(load, group) for load in report.loads]
    return row


def errand(robot: Robot, known: tuple[Order, ...], report: Report | None, plan: Plan | None) -> Row:
    """Say what orders the robot has, and how it gets on with the current one."""
    executing = (order for order in known if order.status is OrderStatus.EXECUTING)
    current = next(executing, known[0] if known else None)
    automatic = next((o for o in known if o.kind is not OrderKind.BUSINESS), None)
    faulted = next((o for o in known if o.fault_reason is not None), None)
    driving = plan is not None and plan.moving
    action = report.action if report is not None else None
    status = "Idle"
    if faulted is not None:
        status = "Failed"
    elif driving or (current is not None and current.status is OrderStatus.EXECUTING):
        status = "Moving"
    row: Row = {
        "cmdStatus": status,
        "withBzOrder": any(order.kind is OrderKind.BUSINESS for order in known),
        "orders": list(robot.orders),
        "ka": action is not None and action.phase is ActionPhase.RUNNING,
    }
    if faulted is not None:
        row["oFaultMsg"] = faulted.fault_reason
    if automatic is not None:
        row["autoOrder"] = automatic.id
    if current is not None:
        row |= _current(current)
    return row


def _current(order: Order) -> Row:
    row: Row = {"cuOrderId": order.id}
    if 0 <= order.current_step < len(order.steps):
        task = order.steps[order.current_step].task
        row |= {"cuStepIndex": order.current_step, "cuStepLocation": task.location}
        arguments = msgspec.json.decode(task.arguments or "{}")
        operation = arguments.get("binTask") or arguments.get("operation")
        if isinstance(operation, str):
            row["op"] = operation
    return row


def traffic(
    known: tuple[Order, ...], report: Report | None, plan: Plan | None, points: Points
) -> Row:
    """Say where it goes, and what ground it has for that."""
    row: Row = {
        "alarms": alarms(report, plan),
        "unTravelled": list(plan.untravelled) if plan is not None else [],
        "spaces": spaces(plan),
        "tReady": plan is not None and plan.ready,
        "bbr": _robots_in_way(plan) if plan is not None else [],
    }
    start = (report.point if report is not None else None) or _next_point(plan)
    if start is not None and report is not None:
        row["bp"] = start
    target = target_point(known, plan, points)
    if target is not None:
        row["targetPoint"] = target
    if plan is not None and plan.moving:
        row |= {"navId": str(plan.commit), "navStatus": navigation_status(report, plan)}
        row |= {"ttId": str(plan.commit), "ttStatus": "TrafficAccepted"}
    return row


def alarms(report: Report | None, plan: Plan | None) -> list[Row]:
    """Give the robot's own alarms, and traffic's if it cannot get on without a person."""
    found = list(report.alarms) if report is not None else []
    if plan is not None and plan.alarm is not None:
        found.append(plan.alarm)
    return [alarm_row(alarm) for alarm in found]


def _robots_in_way(plan: Plan) -> list[str]:
    return [name for name in plan.blocked_by if not name.startswith((DOOR, EXTERNAL))]


def _next_point(plan: Plan | None) -> str | None:
    """Give the point where the path that it drives now ends."""
    if plan is None or not plan.untravelled:
        return None
    return plan.untravelled[0].partition("->")[2]


def target_point(known: tuple[Order, ...], plan: Plan | None, points: Points) -> str | None:
    """Give where traffic takes it, or else where its current step is."""
    if plan is not None and plan.target is not None:
        return plan.target
    for order in known:
        if 0 <= order.current_step < len(order.steps):
            location = order.steps[order.current_step].task.location
            return points.get(location, location)
    return None


def spaces(plan: Plan | None) -> list[msgspec.Raw]:
    """Give the SpaceResources that it holds, as JSON."""
    return [_space(space) for space in plan.spaces] if plan is not None else []


def _bin(index: int, content: RobotBin) -> Row:
    row: Row = {"index": index, "status": content.status.value}
    if content.order is not None:
        row["orderId"] = content.order
    if content.container is not None:
        row["containerId"] = content.container
    return row


def load_row(load: Load, group: Group) -> Row:
    """Give a RobotLoadRelation; a load lies within the outline of robot and load together."""
    shape = _points(group.footprint_loaded or group.footprint)
    return {"type": "container", "id": load.container, "points": shape, "direction": 0.0}


def _collision(group: Group) -> Row:
    return {
        "points": _points(group.footprint),
        "type": "Other",
        "ignoreRobotSafeDist": None,
        "ignoreLoadSafeDist": None,
        "empty": not group.footprint,
    }


@lru_cache(maxsize=SPACES_KEPT)
def _space(space: Space) -> msgspec.Raw:
    kind = "Rect" if len(space.points) == 4 and _is_rectangle(space.points) else "Polygon"
    row = {"type": kind, "points": _points(space.points), "radius": None}
    return msgspec.Raw(msgspec.json.encode(row))


def _is_rectangle(p: tuple[XY, ...]) -> bool:
    """Both diagonals have the same middle and the same length."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = p
    middle = abs(ax + cx - bx - dx) < 1e-6 and abs(ay + cy - by - dy) < 1e-6
    one, other = (ax - cx) ** 2 + (ay - cy) ** 2, (bx - dx) ** 2 + (by - dy) ** 2
    return middle and abs(one - other) < 1e-6


def _points(points: tuple[XY, ...]) -> list[dict[str, float]]:
    return [{"x": rounded(x, 1e3), "y": rounded(y, 1e3)} for x, y in points]
