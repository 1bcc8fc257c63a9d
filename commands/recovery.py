"""Smart recovery: what helps a robot that is stuck, all at once (spec/m4.md, auto-recovery)."""

from commands.command import Decision, Events
from commands.orders import retried
from commands.robot_names import OfRobots, check_enabled, for_each
from ledger.events import (
    AnyEvent,
    RobotAlarmsCleared,
    RobotControlTaken,
    RobotReconnectAsked,
    RobotTrafficReset,
)
from ledger.state import Fleet, Robot


class RecoverRobots(OfRobots, frozen=True, kw_only=True):
    """Do what may get robots going again; each on its own."""


def recover(fleet: Fleet, command: RecoverRobots) -> Decision:
    """Five rules, in the order of the specification.

    Control is taken gently, which the robot judges: only if nobody holds it. A robot that carries
    several orders is at any of them soon, so each one with a fault is retried.
    """

    def one(robot: Robot) -> Events:
        check_enabled(robot)
        scene, name = robot.scene, robot.name
        events: list[AnyEvent] = []
        if not robot.online:
            events.append(RobotReconnectAsked(scene=scene, robot=name))
        events.append(RobotControlTaken(scene=scene, robot=name, gently=True))
        if not robot.orders:
            events.append(RobotTrafficReset(scene=scene, robot=name))
        for order in map(fleet.orders.__getitem__, robot.orders):
            if order.fault_reason is not None:
                events.extend(retried(order))
        events.append(RobotAlarmsCleared(scene=scene, robot=name))
        return tuple(events)

    return for_each(fleet, command, one)
