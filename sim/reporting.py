"""What a simulated robot says of itself, built only when somebody asks."""

import msgspec

from ledger.ids import RobotName
from ledger.link import Alarm, AlarmLevel, Report
from sim.robot import SimRobot, own, place, settle, stands_on

DAY_MS = 86_400_000
BATTERY_EMPTY = "BatteryEmpty"


def report(robot: SimRobot, at_ms: int, now_s: float) -> Report:
    """Report as of now. Numbers follow the clock, so they also grow over a lost memory."""
    settle(robot, now_s)
    body = robot.body
    x, y, heading, turn = place(robot)
    leg = robot.legs[0] if robot.legs else None
    driving = leg is not None and leg.track is not None
    backward = driving and leg is not None and leg.piece.backward
    if at_ms // DAY_MS != robot.today:
        robot.today, robot.today_m = at_ms // DAY_MS, robot.odometer_m
    robot.number = max(robot.number + 1, at_ms)
    route = None
    if robot.tell_route:
        route = tuple(leg.piece for leg in robot.legs if not own(robot, leg))
        robot.tell_route = False
    robot.changed = False
    return Report(
        scene=body.scene,
        robot=RobotName(body.name),
        number=robot.number,
        at_ms=at_ms,
        area=body.area,
        x_m=x,
        y_m=y,
        heading_rad=heading,
        speed_mps=(-robot.speed if backward else robot.speed) if driving else robot.hand_mps,
        turn_radps=turn,
        point=stands_on(robot),
        battery_ratio=robot.battery,
        charging=robot.charging,
        soft_stop=robot.soft_stop,
        paused=robot.paused,
        controller=robot.controller,
        obeyed=robot.obeyed,
        odometer_m=robot.odometer_m,
        odometer_today_m=robot.odometer_m - robot.today_m,
        map_name=body.map_name,
        map_digest=body.map_digest,
        alarms=_alarms(robot, at_ms),
        action=robot.actions.report,
        session=robot.session,
        progress=robot.progress,
        authority=robot.authority,
        route=route,
    )


def _alarms(robot: SimRobot, at_ms: int) -> tuple[Alarm, ...]:
    if robot.battery <= 0.0 and BATTERY_EMPTY not in robot.alarms:
        robot.alarms[BATTERY_EMPTY] = Alarm(
            level=AlarmLevel.ERROR, code=BATTERY_EMPTY, message="the battery is empty", at_ms=at_ms
        )
    elif robot.battery > 0.0:
        robot.alarms.pop(BATTERY_EMPTY, None)
    for code, alarm in robot.alarms.items():
        if not alarm.at_ms:  # who raised it had no calendar
            robot.alarms[code] = msgspec.structs.replace(alarm, at_ms=at_ms)
    return tuple(robot.alarms.values())
