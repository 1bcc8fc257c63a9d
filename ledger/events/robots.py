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
)
