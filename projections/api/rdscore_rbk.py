"""What a robot itself reports, in the words of RDSCore: `rbk_report` (spec/rdscore.md §2).

What our robots do not report is null where the source allows it, or zero or empty of its type.
"""

from ledger.ids import RobotKey
from ledger.link import Alarm, AlarmLevel, Plan, Report
from ledger.scene import Scene, Value
from ledger.state import BinStatus, Order, Robot
from projections.fields import Row

CONTROLLER = "fleetledger"
ALARM_NAMES = {
    AlarmLevel.FATAL: "fatals",
    AlarmLevel.ERROR: "errors",
    AlarmLevel.WARNING: "warnings",
    AlarmLevel.INFO: "notices",
}
ON_BOARD = (BinStatus.FILLED, BinStatus.CANCELLED)
# task_status of a navigation
NONE, RUNNING, SUSPENDED, FAILED = 0, 2, 3, 5
LOCK = {
    "desc": "",
    "ip": "",
    "locked": True,
    "nick_name": CONTROLLER,
    "port": 0,
    "time_t": "0",
    "type": 0,
}


class Known(Value, frozen=True, kw_only=True):
    """All that a robot's element is made from; equal ones give equal bytes."""

    key: RobotKey
    robot: Robot
    scene: Scene
    report: Report | None
    plan: Plan | None
    order: Order | None  # the one it is executing, or the first it was given


def rbk_report(known: Known, alarms: dict[str, list[Row]]) -> Row:
    """Give the robot's own report; its keys are there also while it has not reported."""
    report, bins = known.report, known.robot.bins
    row: Row = {
        "DI": [],
        "DO": [],
        "alarms": alarms,
        "arm_info": _no_arm(),
        "available_containers": sum(b.status is BinStatus.EMPTY for b in bins),
        "brake": None,
        "containers": [
            {
                "container_name": str(index),
                "desc": "",
                "goods_id": content.container or "",
                "has_goods": content.status in ON_BOARD,
            }
            for index, content in enumerate(bins)
        ],
        "current": 0.0,
        "errors": legacy(alarms["errors"]),
        "fatals": legacy(alarms["fatals"]),
        "fork": _no_fork(),
        "info": {},
        "jack": _jack(known),
        "last_station": "",
        "lock_info": LOCK,
        "requestCurrent": 0.0,
        "requestVoltage": 0.0,
        "roller": None,
        "steer": 0.0,
        "task_status": _task_status(known),
        "total_containers": len(bins),
        "voltage": 0.0,
        "vy": 0.0,
        "warnings": legacy(alarms["warnings"]),
    }
    return row | _measured(report)


def _measured(report: Report | None) -> Row:
    stamp = "0" if report is None else str(report.at_ms * 1_000_000)
    return {
        "angle": 0.0 if report is None else report.heading_rad,
        "battery_level": 0.0 if report is None else report.battery_ratio,
        "blocked": False if report is None else report.blocked,
        "charging": False if report is None else report.charging,
        "confidence": 0.0 if report is None else report.confidence,
        "current_map": "" if report is None else report.map_name,
        "current_map_md5": "" if report is None else report.map_digest,
        "current_station": "" if report is None else report.point or "",
        "emergency": None if report is None else report.emergency_stop,
        "odo": 0.0 if report is None else report.odometer_m,
        "received_on": {
            "data_nsec": stamp,
            "frame_id": "",
            "pub_nsec": stamp,
            "seq": "0" if report is None else str(report.number),
        },
        "reloc_status": 0 if report is None else 1,
        "soft_emc": None if report is None else report.soft_stop,
        "time": 0,
        "today_odo": 0.0 if report is None else report.odometer_today_m,
        "total_time": 0,
        "vx": 0.0 if report is None else report.speed_mps,
        "w": 0.0 if report is None else report.turn_radps,
        "x": 0.0 if report is None else report.x_m,
        "y": 0.0 if report is None else report.y_m,
    }


def _task_status(known: Known) -> int:
    if known.order is not None and known.order.fault_reason is not None:
        return FAILED
    if known.plan is not None and known.plan.moving:
        blocked = known.report is not None and known.report.blocked
        return SUSPENDED if blocked else RUNNING
    return NONE


def _no_arm() -> Row:
    pose = dict.fromkeys(("rx", "ry", "rz", "w", "x", "y", "z"), 0)
    return {"endpos": pose, "joints": [], "task_status": 0}


def _no_fork() -> Row:
    return {
        "fork_auto_flag": False,
        "fork_height": 0.0,
        "fork_height_in_place": False,
        "fork_pressure_actual": 0.0,
        "forward_in_place": False,
        "forward_val": 0.0,
    }


def _jack(known: Known) -> Row:
    return {
        "jack_emc": known.report is not None and known.report.emergency_stop,
        "jack_enable": False,
        "jack_error_code": 0,
        "jack_height": 0.0,
        "jack_isFull": loaded(known),
        "jack_load_times": 0,
        "jack_mode": False,
        "jack_speed": 0,
        "jack_state": 0,
    }


def alarms_of(alarms: tuple[Alarm, ...]) -> dict[str, list[Row]]:
    """Sort alarms by level; RDSCore's are numbered, and timed in seconds."""
    found: dict[str, list[Row]] = {name: [] for name in ALARM_NAMES.values()}
    for alarm in alarms:
        found[ALARM_NAMES[alarm.level]].append(
            {
                "code": int(alarm.code) if alarm.code.isdecimal() else 0,
                "desc": alarm.message,
                "times": alarm.times,
                "timestamp": alarm.at_ms // 1000,
            }
        )
    return found


def legacy(alarms: list[Row]) -> list[Row]:
    """Give alarms in the old format, where the code is a key."""
    return [
        {str(a["code"]): a["timestamp"], "desc": a["desc"], "times": a["times"]} for a in alarms
    ]


def loaded(known: Known) -> bool:
    """Whether anything is on board."""
    return any(content.status in ON_BOARD for content in known.robot.bins)
