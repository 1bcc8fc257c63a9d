"""What the events of robots mean: the part of the fold that is theirs."""

from typing import assert_never

import msgspec

from ledger.events.robots import (
    RobotAdded,
    RobotBinsCleared,
    RobotConnected,
    RobotDisabled,
    RobotDisconnected,
    RobotEnabled,
    RobotEvent,
    RobotRemoved,
    RobotWentOffDuty,
    RobotWentOnDuty,
)
from ledger.ids import robot_key
from ledger.scene import RobotConfig
from ledger.state import BinStatus, Fleet, Robot, RobotBin

replace = msgspec.structs.replace


def evolve_robot(fleet: Fleet, event: RobotEvent) -> None:
    """Take one event of a robot into the state."""
    if isinstance(event, RobotAdded):
        robot = Robot(
            scene=event.scene,
            config=event.config,
            bins=(RobotBin(),) * event.config.bin_count,
            idle_since_ms=event.at_ms,
        )
        fleet.robots[robot_key(event.scene, robot.name)] = robot
        return
    key = robot_key(event.scene, event.robot)
    robot = fleet.robots[key]
    match event:
        case RobotRemoved():
            del fleet.robots[key]
            return
        case RobotWentOffDuty():
            robot = replace(robot, off_duty=True)
        case RobotWentOnDuty():
            robot = replace(robot, off_duty=False, idle_since_ms=event.at_ms)
        case RobotDisabled():
            robot = replace(robot, config=_disabled(robot.config, disabled=True))
        case RobotEnabled():
            config = _disabled(robot.config, disabled=False)
            robot = replace(robot, config=config, idle_since_ms=event.at_ms)
        case RobotConnected():
            robot = replace(robot, online=True)
        case RobotDisconnected():
            robot = replace(robot, online=False)
        case RobotBinsCleared():
            bins = (RobotBin() if b.status is BinStatus.CANCELLED else b for b in robot.bins)
            robot = replace(robot, bins=tuple(bins))
        case _:
            assert_never(event)
    fleet.robots[key] = robot


def _disabled(config: RobotConfig, *, disabled: bool) -> RobotConfig:
    return replace(config, disabled=disabled)
