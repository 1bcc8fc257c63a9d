"""A robot in the words of RDSCore: one element of `report` (spec/rdscore.md §2)."""

from ledger.link import Plan
from ledger.scene import Area, Group, PointKind, Scene
from ledger.state import Order, OrderKind, OrderStatus, Step, StepStatus
from projections.api.rdscore_rbk import LOCK, Known, alarms_of, loaded, rbk_report
from projections.fields import Row

BLOCK_STATES = {
    StepStatus.EXECUTABLE: "CREATED",
    StepStatus.EXECUTING: "RUNNING",
    StepStatus.DONE: "FINISHED",
    StepStatus.SKIPPED: "FINISHED",
}
ORDER_STATES = {
    OrderStatus.TO_BE_ALLOCATED: "TOBEDISPATCHED",
    OrderStatus.ALLOCATED: "RUNNING",
    OrderStatus.EXECUTING: "RUNNING",
    OrderStatus.PENDING: "WAITING",
    OrderStatus.DONE: "FINISHED",
    OrderStatus.CANCELLED: "STOPPED",
}


def vehicle(known: Known) -> Row:
    """Give the Report of one robot."""
    robot, report, order = known.robot, known.report, known.order
    group = next(g for g in known.scene.groups if g.id == robot.config.group)
    alarms = alarms_of(report.alarms if report is not None else ())
    error = bool(alarms["fatals"] or alarms["errors"]) or (
        order is not None and order.fault_reason is not None
    )
    reasons = _reasons(known)
    return {
        "area_resources_occupied": _resources(known),
        "basic_info": _basic(known, group),
        "changes": {"maps": [], "model": False},
        "chassis": _chassis(known, group),
        "connection_status": int(robot.online),
        "current_order": {} if order is None else _order(order),
        "dispatchable": reasons["dispatchable_status"] == 0 and not reasons["disconnect"],
        "finished_path": _finished(order),
        "is_error": error,
        "isLoaded": loaded(known),
        "lock_info": LOCK,
        "network_delay": 0,
        "procBusiness": order is not None and order.kind is OrderKind.BUSINESS,
        "rbk_report": rbk_report(known, alarms),
        "undispatchable_reason": reasons,
        "unfinished_path": _unfinished(known.plan),
        "uuid": robot.name,
        "vehicle_id": robot.name,
    }


def _area(known: Known) -> Area | None:
    if known.report is None:
        return None
    return next((a for a in known.scene.areas if a.id == known.report.area), None)


def _resources(known: Known) -> list[Row]:
    area = _area(known)
    if area is None:
        return []
    paths = []
    if known.plan is not None and known.plan.moving:
        for path in known.plan.untravelled[:1]:
            start, _, end = path.partition("->")
            paths.append(
                {"source_id": start, "end_id": end, "start_percentage": 0.0, "end_percentage": 1.0}
            )
    return [
        {
            "area_name": area.name,
            "avoidObs_area_occupied": {"radius": -1, "x": 0, "y": 0},
            "blocks_occupied": [],
            "path_occupied": paths,
        }
    ]


def _basic(known: Known, group: Group) -> Row:
    report, config = known.report, known.robot.config
    same_map = [a.name for a in known.scene.areas if report and a.map_name == report.map_name]
    return {
        "controller_humi": 0.0,
        "controller_temp": 0.0,
        "controller_voltage": 0.0,
        "current_area": same_map,
        "current_group": group.name,
        "current_map": report.map_name if report is not None else "",
        "dsp_version": "simulation" if config.simulated else "",
        "ip": config.host or "",
        "model": group.name,
        "robot_note": config.remark or "",
        "version": "",
    }


def _chassis(known: Known, group: Group) -> Row:
    xs = [x for x, _ in group.footprint] or [0.0]
    ys = [y for _, y in group.footprint] or [0.0]
    region: Row = {"name": "", "point": []}
    report = known.report
    if report is not None and report.loads:
        points = [{"x": x, "y": y} for x, y in group.footprint]
        region = {"name": report.loads[0].container, "point": points}
    return {
        "goods_region": region,
        "head": max(xs),
        "radius": 0.0,
        "shape": 1,
        "tail": -min(xs),
        "width": max(ys) - min(ys),
    }


def _order(order: Order) -> Row:
    return {
        "blocks": [_block(step) for step in order.steps],
        "candidates": [],
        "complete": order.sealed,
        "deadline": None,
        "group": order.wanted_groups[0] if order.wanted_groups else None,
        "id": order.id,
        "keyRoute": list(order.key_locations),
        "msg": order.fault_reason or "",
        "priority": order.priority,
        "state": "FAILED" if order.fault_reason is not None else ORDER_STATES[order.status],
        "tag": [],
        "vehicle": order.robot or "",
    }


def _block(step: Step) -> Row:
    return {
        "blockId": step.id,
        "location": step.task.location,
        "state": BLOCK_STATES[step.status],
    }


def _finished(order: Order | None) -> list[str]:
    if order is None:
        return []
    return [step.task.location for step in order.steps if step.status is StepStatus.DONE]


def _unfinished(plan: Plan | None) -> list[str]:
    """Give the points of the paths still to be driven, the one it comes from first."""
    if plan is None or not plan.untravelled:
        return []
    ends = [path.partition("->") for path in plan.untravelled]
    return [ends[0][0], *(end for _, _, end in ends)]


def _reasons(known: Known) -> Row:
    robot, report = known.robot, known.report
    levels = known.scene.config.charging
    level = levels.by_group.get(robot.config.group, levels.default).charge_only
    maps = {area.map_digest for area in known.scene.areas}
    return {
        "current_map_invalid": report is not None and report.map_digest not in maps,
        "disconnect": not robot.online,
        "dispatchable_status": 2 if robot.config.disabled else 1 if robot.off_duty else 0,
        "low_battery": report is not None and report.battery_ratio < level,
        "suspended": known.order is not None and known.order.fault_reason is not None,
        "unconfirmed_reloc": False,
        "unlock": 0,
    }


def missing_kinds(scene: Scene) -> list[PointKind]:
    """Say which kinds of point that robots need the scene has not: charging, parking."""
    kinds = {point.kind for area in scene.areas for point in area.points}
    return [kind for kind in (PointKind.CHARGING, PointKind.PARKING) if kind not in kinds]
