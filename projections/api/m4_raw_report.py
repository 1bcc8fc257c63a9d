"""What a robot itself said, in the words of Robokit 1100: the `raw` of spec/m4.md §5."""

from collections.abc import Collection
from typing import Any

from ledger.link import Alarm, AlarmLevel, Plan, Report
from projections.fields import Row

STANDING, RUNNING, SUSPENDED = 0, 2, 3  # navigation states of Robokit
TO_A_STATION = 3  # Robokit's kind of navigation


def navigation_status(report: Report | None, plan: Plan | None) -> int:
    """Say in Robokit's number how far the robot is with its way."""
    if plan is None or not plan.moving:
        return STANDING
    return SUSPENDED if report is not None and report.paused else RUNNING


def alarm_row(alarm: Alarm) -> Row:
    """Give a RobotAlarm."""
    return {
        "level": alarm.level.value,
        "code": alarm.code,
        "message": alarm.message,
        "times": alarm.times,
        "timestamp": alarm.at_ms,
    }


def raw_report(report: Report, plan: Plan | None, fields: Collection[str] | None = None) -> Row:
    """Give the robot's own report, or these fields of it."""
    row = _whole(report, plan)
    return row if fields is None else {name: row[name] for name in row if name in fields}


def _whole(report: Report, plan: Plan | None) -> Row:
    levels: dict[AlarmLevel, list[Any]] = {level: [] for level in AlarmLevel}
    for alarm in report.alarms:
        levels[alarm.level].append(alarm_row(alarm))
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
        "current_lock": {"nick_name": report.controller, "locked": bool(report.controller)},
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
        "task_status": navigation_status(report, plan),
        "task_type": TO_A_STATION if moving else 0,
        "target_id": (plan.target or "") if plan is not None and moving else "",
        "task_id": str(plan.commit) if plan is not None and moving else "",
        "fork_height": 0.0,
    }
