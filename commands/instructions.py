"""What operators tell robots beside orders: stop, pause, obey, come back (spec/m4.md §4).

The ledger knows what a robot was told, not what it is: someone may have pressed or lifted its stop
at the robot itself. So a stop, a pause, control and the clearing of alarms are stated each time
they are asked for, and a robot that is so already has nothing to do.
"""

from typing import TypeAlias

from commands.command import Decision, Events
from commands.robot_names import OfRobots, check_enabled, check_reachable, for_each
from ledger.events import (
    OrderFaulted,
    RobotAlarmsCleared,
    RobotControlReleased,
    RobotControlTaken,
    RobotPaused,
    RobotReconnectAsked,
    RobotResumed,
    RobotSoftStopLifted,
    RobotSoftStopped,
)
from ledger.state import Fleet, Order, Robot, StepStatus

NAVIGATION_CANCELLED = "NavigationCancelled"  # reason of the fault; a retry goes on
Told: TypeAlias = (
    RobotSoftStopped
    | RobotSoftStopLifted
    | RobotPaused
    | RobotResumed
    | RobotControlTaken
    | RobotControlReleased
    | RobotAlarmsCleared
)


class SoftStopRobots(OfRobots, frozen=True, kw_only=True):
    """Press the soft emergency stop of robots, or lift it; each on its own."""

    stopped: bool


def soft_stop(fleet: Fleet, command: SoftStopRobots) -> Decision:
    """The robot stops at once, wherever it is."""
    return _told(fleet, command, RobotSoftStopped if command.stopped else RobotSoftStopLifted)


class PauseRobots(OfRobots, frozen=True, kw_only=True):
    """Have robots stop on their way, or go on; each on its own."""

    paused: bool


def pause(fleet: Fleet, command: PauseRobots) -> Decision:
    """The robot keeps its way and its order."""
    return _told(fleet, command, RobotPaused if command.paused else RobotResumed)


class ControlRobots(OfRobots, frozen=True, kw_only=True):
    """Take control of robots, or let go of it; each on its own."""

    taken: bool


def control(fleet: Fleet, command: ControlRobots) -> Decision:
    """Asked for outright, control is taken from whoever holds it."""
    return _told(fleet, command, RobotControlTaken if command.taken else RobotControlReleased)


class ClearRobotAlarms(OfRobots, frozen=True, kw_only=True):
    """Clear the alarms that robots report; each on its own."""


def clear_alarms(fleet: Fleet, command: ClearRobotAlarms) -> Decision:
    """What is still wrong is reported again by the robot itself."""
    return _told(fleet, command, RobotAlarmsCleared)


def _told(fleet: Fleet, command: OfRobots, event: type[Told]) -> Decision:
    def one(robot: Robot) -> Events:
        check_reachable(robot)
        return (event(scene=robot.scene, robot=robot.name),)

    return for_each(fleet, command, one)


class ReconnectRobots(OfRobots, frozen=True, kw_only=True):
    """Reach for robots that do not answer; each on its own."""


def reconnect(fleet: Fleet, command: ReconnectRobots) -> Decision:
    """A robot that answers is left alone."""

    def one(robot: Robot) -> Events:
        check_enabled(robot)
        if robot.online:
            return ()
        return (RobotReconnectAsked(scene=robot.scene, robot=robot.name),)

    return for_each(fleet, command, one)


class CancelNavigation(OfRobots, frozen=True, kw_only=True):
    """Have robots not drive on for the orders that they are at; each on its own."""


def cancel_navigation(fleet: Fleet, command: CancelNavigation) -> Decision:
    """The order has a fault until it is retried; what traffic has committed is driven to its end.

    Works for a robot that does not answer too: it must not drive on when it is back.
    """

    def one(robot: Robot) -> Events:
        check_enabled(robot)
        order = order_at(fleet, robot)
        if order is None or order.fault_reason is not None:
            return ()
        return (OrderFaulted(scene=order.scene, order=order.id, reason=NAVIGATION_CANCELLED),)

    return for_each(fleet, command, one)


def order_at(fleet: Fleet, robot: Robot) -> Order | None:
    """Find the order that a robot is at: the one it has set out for, or will before the others."""
    orders = [fleet.orders[id_] for id_ in robot.orders]
    going = [o for o in orders if any(s.status is StepStatus.EXECUTING for s in o.steps)]
    todo = [o for o in orders if any(s.status is not StepStatus.DONE for s in o.steps)]
    return next(iter(going or todo), None)
