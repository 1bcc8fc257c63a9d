"""Events of robots."""

from typing import TypeAlias

from ledger.events.base import Event
from ledger.ids import RobotName
from ledger.scene import RobotConfig


class OfRobot(Event, frozen=True, kw_only=True):
    """An event of one robot."""


class RobotAdded(OfRobot, frozen=True, kw_only=True):
    """A robot joined its scene (`robot/create`, or a scene file)."""

    config: RobotConfig


class RobotRemoved(OfRobot, frozen=True, kw_only=True):
    """A robot left its scene for good (`robot/remove`); it had no order."""

    robot: RobotName


class RobotWentOffDuty(OfRobot, frozen=True, kw_only=True):
    """A robot was told to take no more orders (`robots/off-duty`); it finishes those it has."""

    robot: RobotName


class RobotWentOnDuty(OfRobot, frozen=True, kw_only=True):
    """A robot was told to take orders again (`robots/off-duty`)."""

    robot: RobotName


class RobotDisabled(OfRobot, frozen=True, kw_only=True):
    """A robot was taken out of dispatch until enabled again (`robots/{scene}/disabled`)."""

    robot: RobotName


class RobotEnabled(OfRobot, frozen=True, kw_only=True):
    """A disabled robot came back (`robots/{scene}/disabled`)."""

    robot: RobotName


class RobotConnected(OfRobot, frozen=True, kw_only=True):
    """A robot began to answer; observed by its link."""

    robot: RobotName


class RobotDisconnected(OfRobot, frozen=True, kw_only=True):
    """A robot ceased to answer; observed by its link. It keeps its orders and its ground."""

    robot: RobotName


class RobotBinsCleared(OfRobot, frozen=True, kw_only=True):
    """Someone took left-over loads of cancelled orders off the robot by hand."""

    robot: RobotName


class RobotReconfigured(OfRobot, frozen=True, kw_only=True):
    """A robot was set up otherwise (`robot/update/config`, alone or in a batch)."""

    robot: RobotName
    config: RobotConfig  # whole; its name is the robot's


class RobotSoftStopped(OfRobot, frozen=True, kw_only=True):
    """Someone pressed the soft emergency stop (`robots/{scene}/set-soft-emc`), or the guard did."""

    robot: RobotName
    reason: str = ""  # the guard's: what must not be, who, where; empty = a person's


class RobotSoftStopLifted(OfRobot, frozen=True, kw_only=True):
    """Someone lifted the soft emergency stop (`robots/{scene}/set-soft-emc`), or the guard did."""

    robot: RobotName


class RobotPaused(OfRobot, frozen=True, kw_only=True):
    """Someone had the robot stop on its way (`robots/pause-nav`)."""

    robot: RobotName


class RobotResumed(OfRobot, frozen=True, kw_only=True):
    """Someone let a paused robot go on (`robots/resume-nav`)."""

    robot: RobotName


class RobotControlTaken(OfRobot, frozen=True, kw_only=True):
    """Someone had the dispatcher take control of the robot (`robots/master`, auto-recovery)."""

    robot: RobotName
    gently: bool = False  # only if nobody else holds it


class RobotControlReleased(OfRobot, frozen=True, kw_only=True):
    """Someone had the dispatcher let go of the robot (`robots/master`)."""

    robot: RobotName


class RobotAlarmsCleared(OfRobot, frozen=True, kw_only=True):
    """Someone had the robot clear its alarms (`robots/{scene}/clear-alarm`, auto-recovery)."""

    robot: RobotName


class RobotReconnectAsked(OfRobot, frozen=True, kw_only=True):
    """Someone had the robot reached for again (`robots/reconnect`, auto-recovery)."""

    robot: RobotName


class RobotGivenUp(OfRobot, frozen=True, kw_only=True):
    """A robot did not come back however often it was reached for; its link stops trying."""

    robot: RobotName


class RobotTrafficReset(OfRobot, frozen=True, kw_only=True):
    """Traffic is to forget what it holds for the robot and place it anew (auto-recovery)."""

    robot: RobotName


RobotEvent: TypeAlias = (
    RobotAdded
    | RobotRemoved
    | RobotWentOffDuty
    | RobotWentOnDuty
    | RobotDisabled
    | RobotEnabled
    | RobotConnected
    | RobotDisconnected
    | RobotBinsCleared
    | RobotReconfigured
    | RobotSoftStopped
    | RobotSoftStopLifted
    | RobotPaused
    | RobotResumed
    | RobotControlTaken
    | RobotControlReleased
    | RobotAlarmsCleared
    | RobotReconnectAsked
    | RobotGivenUp
    | RobotTrafficReset
)
