"""Robots that somebody has stopped, or that obey somebody else: nobody moves them."""

from ledger.link import DISPATCHER
from scheduler.dispatch.reasons import Why
from scheduler.view import RobotView


def stopped(robot: RobotView) -> Why | None:
    """Say by its own report why the robot would not move if it were told to; None = it would."""
    report = robot.report
    if report is None:
        return None
    if report.emergency_stop:
        return Why.ROBOT_EMERGENCY_STOP
    if report.soft_stop:
        return Why.ROBOT_SOFT_STOPPED
    if report.controller != DISPATCHER:
        return Why.ROBOT_NOT_CONTROLLED
    if report.paused:
        return Why.ROBOT_PAUSED
    return None
