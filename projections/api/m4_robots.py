"""A robot as M4's pages and clients see it: the UiRobotReport (spec/m4.md §5).

Fields without a value are absent, lists are there although empty. Doubles are rounded as in the
source's note and its example: 3 decimals, 4 for the heading, 5 for the confidence (C6).
"""

from collections.abc import Mapping
from typing import Any

import msgspec

from ledger.ids import OrderId
from ledger.link import ActionPhase, Alarm, AlarmLevel, Load, Plan, Report, Space
from ledger.scene import XY, Group, Scene, Value
from ledger.state import Order, OrderKind, OrderStatus, Robot, RobotBin
from projections.fields import Row

CONTROLLER = "fleetledger"  # holder of control, as robots are told
RUNNING, STANDING = 2, 0  # navigation states of Robokit


class Seen(Value, frozen=True, kw_only=True):
    """All that is known of a robot at one instant."""

    robot: Robot
    group: Group
    report: Report | None  # as brought to the instant
    own: Report | None  # as the robot sent it
    plan: Plan | None
    orders: Mapping[OrderId, Order]
    points: Mapping[str, str]  # bin -> its point


def ui_report(seen: Seen, *, raw: bool) -> Row:
    """Give the UiRobotReport."""
    robot, report = seen.robot, seen.report
    row: Row = {
        "name": robot.name,
        "offDuty": robot.off_duty,
        "online": robot.online,
        "disabled": robot.config.disabled,
        "mock": robot.config.simulated,
    }
    if not robot.online:
        row["connectMsg"] = "The robot does not answer."
    row |= _nothing_reported() if report is None else _reported(seen, report)
    row["collision"] = _collision(seen.group)
    if raw and seen.own is not None:
        row["raw"] = raw_report(seen.own, seen.plan)
    row["bins"] = [_bin(index, content) for index, content in enumerate(robot.bins)]
    row["noAc"] = False
    return row | _errand(seen) | _traffic(seen)


def bin_points(scene: Scene) -> dict[str, str]:
    """Say from which point each bin of the scene is reached."""
    return {bin_.name: bin_.point for area in scene.areas for bin_ in area.bins}


def _nothing_reported() -> Row:
    return {
        "cff": False,
        "emc": False,
        "sEmc": False,
        "blocked": False,
        "alarms": [],
        "charging": False,
        "reloc": "Init",
    }


def _reported(seen: Seen, report: Report) -> Row:
    row: Row = {
        "rTime": report.at_ms,
        "x": round(report.x_m, 3),
        "y": round(report.y_m, 3),
        "d": round(report.heading_rad, 4),
    }
    if report.point is not None:
        row["p"] = report.point
    start = report.point or _next_point(seen.plan)
    if start is not None:
        row["bp"] = start
    row |= {
        "v": round(report.speed_mps, 3),
        "rv": round(report.turn_radps, 3),
        "areaId": report.area,
        "map": report.map_name,
        "mapMd5": report.map_digest,
        "cff": seen.robot.online,
        "controller": CONTROLLER,
        "emc": report.emergency_stop,
        "sEmc": report.soft_stop,
        "blocked": report.blocked,
        "alarms": [_alarm(alarm) for alarm in report.alarms],
        "battery": round(report.battery_ratio, 3),
        "charging": report.charging,
        "c": round(report.confidence, 5),
        "reloc": "Success",
        "to": round(report.odometer_today_m, 3),
    }
    if report.blocked_reason is not None:
        row["blockedMsg"] = report.blocked_reason
    if report.loads:
        row["loads"] = [_load(load, seen.group) for load in report.loads]
    return row


def _next_point(plan: Plan | None) -> str | None:
    """Give the point where the path that it drives now ends."""
    if plan is None or not plan.untravelled:
        return None
    return plan.untravelled[0].partition("->")[2]


def _errand(seen: Seen) -> Row:
    """Say what orders the robot has, and how it gets on with the current one."""
    robot = seen.robot
    known = [seen.orders[id_] for id_ in robot.orders if id_ in seen.orders]
    executing = (order for order in known if order.status is OrderStatus.EXECUTING)
    current = next(executing, known[0] if known else None)
    automatic = next((o for o in known if o.kind is not OrderKind.BUSINESS), None)
    faulted = next((o for o in known if o.fault_reason is not None), None)
    driving = seen.plan is not None and seen.plan.moving
    action = seen.report.action if seen.report is not None else None
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


def _traffic(seen: Seen) -> Row:
    plan = seen.plan
    row: Row = {
        "unTravelled": list(plan.untravelled) if plan is not None else [],
        "spaces": [_space(space) for space in plan.spaces] if plan is not None else [],
        "tReady": plan is not None and plan.ready,
        "bbr": list(plan.blocked_by) if plan is not None else [],
    }
    target = (plan.target if plan is not None else None) or _goal(seen)
    if target is not None:
        row["targetPoint"] = target
    if plan is not None and plan.moving:
        row |= {"navId": str(plan.commit), "navStatus": RUNNING}
        row |= {"ttId": str(plan.commit), "ttStatus": "TrafficAccepted"}
    return row


def _goal(seen: Seen) -> str | None:
    for id_ in seen.robot.orders:
        order = seen.orders.get(id_)
        if order is not None and 0 <= order.current_step < len(order.steps):
            location = order.steps[order.current_step].task.location
            return seen.points.get(location, location)
    return None


def _bin(index: int, content: RobotBin) -> Row:
    row: Row = {"index": index, "status": content.status.value}
    if content.order is not None:
        row["orderId"] = content.order
    if content.container is not None:
        row["containerId"] = content.container
    return row


def _alarm(alarm: Alarm) -> Row:
    return {
        "level": alarm.level.value,
        "code": alarm.code,
        "message": alarm.message,
        "times": alarm.times,
        "timestamp": alarm.at_ms,
    }


def _load(load: Load, group: Group) -> Row:
    shape = _points(group.footprint)  # loads are taken to lie within the robot's own outline
    return {"type": "container", "id": load.container, "points": shape, "direction": 0.0}


def _collision(group: Group) -> Row:
    return {
        "points": _points(group.footprint),
        "type": "Other",
        "ignoreRobotSafeDist": None,
        "ignoreLoadSafeDist": None,
        "empty": not group.footprint,
    }


def _space(space: Space) -> Row:
    kind = "Rect" if len(space.points) == 4 and _is_rectangle(space.points) else "Polygon"
    return {"type": kind, "points": _points(space.points), "radius": None}


def _is_rectangle(p: tuple[XY, ...]) -> bool:
    """Both diagonals have the same middle and the same length."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = p
    middle = abs(ax + cx - bx - dx) < 1e-6 and abs(ay + cy - by - dy) < 1e-6
    one, other = (ax - cx) ** 2 + (ay - cy) ** 2, (bx - dx) ** 2 + (by - dy) ** 2
    return middle and abs(one - other) < 1e-6


def _points(points: tuple[XY, ...]) -> list[dict[str, float]]:
    return [{"x": round(x, 3), "y": round(y, 3)} for x, y in points]


def raw_report(report: Report, plan: Plan | None) -> Row:
    """Give what the robot itself said, in the words of Robokit 1100."""
    levels: dict[AlarmLevel, list[Any]] = {level: [] for level in AlarmLevel}
    for alarm in report.alarms:
        levels[alarm.level].append(_alarm(alarm))
    moving = plan is not None and plan.moving
    return {
        "ret_code": 0,
        "battery_level": report.battery_ratio,
        "x": report.x_m,
        "y": report.y_m,
        "vx": report.speed_mps,
        "w": report.turn_radps,
        "angle": report.heading_rad,
        "current_station": report.point or "",
        "blocked": report.blocked,
        "charging": report.charging,
        "current_map": report.map_name,
        "vehicle_id": report.robot,
        "current_lock": {"nick_name": CONTROLLER, "locked": True},
        "reloc_status": 1,
        "fatals": levels[AlarmLevel.FATAL],
        "errors": levels[AlarmLevel.ERROR],
        "warnings": levels[AlarmLevel.WARNING],
        "notices": levels[AlarmLevel.INFO],
        "current_map_md5": report.map_digest,
        "goods_region": None,
        "confidence": report.confidence,
        "emergency": report.emergency_stop,
        "soft_emc": report.soft_stop,
        "odo": report.odometer_m,
        "today_odo": report.odometer_today_m,
        "containers": [
            {"container_name": str(load.bin), "goods_id": load.container, "has_goods": True}
            for load in report.loads
        ],
        "loadmap_status": 0,
        "task_status": RUNNING if moving else STANDING,
        "task_type": 3 if moving else 0,  # 3 = navigation to a station
        "target_id": (plan.target or "") if plan is not None and moving else "",
        "task_id": str(plan.commit) if plan is not None and moving else "",
        "fork_height": 0.0,
    }
