"""Robots of a scene: added, one or a series, and removed (spec/m4.md §4)."""

import ipaddress

import msgspec

from commands.command import Command, Decision, Events, at_most, scene_of
from commands.rejected import Reason, Rejected
from commands.robot_config import check_config, check_name
from commands.robot_names import ROBOTS_MAX, OfRobots, known_robots
from ledger.events import RobotAdded, RobotRemoved
from ledger.ids import RobotName, SceneId, robot_key
from ledger.scene import ConnectionType, Group, RobotConfig
from ledger.state import Fleet

SERIES_MAX = 1_000


class CreateRobots(Command, frozen=True, kw_only=True):
    """Add robots to a scene; all of them, or none."""

    scene: SceneId
    robots: tuple[RobotConfig, ...]


def create(fleet: Fleet, command: CreateRobots) -> Decision:
    """A name is unique in its scene."""
    scene = scene_of(fleet, command.scene)
    return Decision(events=added(fleet, scene.id, scene.groups, command.robots))


def added(
    fleet: Fleet, scene: SceneId, groups: tuple[Group, ...], robots: tuple[RobotConfig, ...]
) -> Events:
    """Check new robots and let them join; the scene itself may be just being made."""
    at_most(len(robots), ROBOTS_MAX, "robots")
    names: set[str] = set()
    for config in robots:
        check_name(config.name)
        if config.name in names or robot_key(scene, config.name) in fleet.robots:
            message = f"Field 'robotName': the scene has a robot '{config.name}' already."
            raise Rejected(Reason.ROBOT_NAME_TAKEN, message, config.name)
        names.add(config.name)
        check_config(config, groups)
    return tuple(RobotAdded(scene=scene, config=config) for config in robots)


class CreateRobotSeries(Command, frozen=True, kw_only=True):
    """Add alike robots named `<prefix>-01`, `<prefix>-02`, … to a scene; all of them, or none."""

    scene: SceneId
    prefix: str
    count: int
    pattern: RobotConfig  # its name is not used, its host is the first robot's


def create_series(fleet: Fleet, command: CreateRobotSeries) -> Decision:
    """Hosts are consecutive addresses; the port is the first of each robot's own, so the same.

    A name that is taken refuses the call, rather than giving numbers that nobody expects.
    """
    scene = scene_of(fleet, command.scene)
    if not 1 <= command.count <= SERIES_MAX:
        message = f"Field 'count' must be from 1 to {SERIES_MAX}."
        raise Rejected(Reason.TOO_MANY, message, command.count)
    _check_pattern(command)
    width = max(2, len(str(command.count)))
    hosts = _hosts(command.pattern.host, command.count)
    robots = tuple(
        msgspec.structs.replace(
            command.pattern, name=RobotName(f"{command.prefix}-{n:0{width}}"), host=host
        )
        for n, host in enumerate(hosts, 1)
    )
    taken = [r.name for r in robots if robot_key(scene.id, r.name) in fleet.robots]
    if taken:
        message = f"Field 'robotNamePrefix': the scene has these robots already: {_list(taken)}."
        raise Rejected(Reason.ROBOT_NAME_TAKEN, message, *taken)
    return Decision(events=added(fleet, scene.id, scene.groups, robots))


def _check_pattern(command: CreateRobotSeries) -> None:
    """Refuse, in the words of this call, what would be wrong with each of the robots."""
    if not command.prefix.strip():
        message = "Field 'robotNamePrefix' must not be blank."
        raise Rejected(Reason.ROBOT_NAME_INVALID, message, command.prefix)
    if command.pattern.connection is ConnectionType.FLEET_TO_ROBOT and not command.pattern.host:
        message = "Field 'robotIpStart' is required where 'connectionType' is FleetToRobot."
        raise Rejected(Reason.ROBOT_CONFIG_INVALID, message)


def _hosts(first: str | None, count: int) -> list[str | None]:
    if not first:
        return [None] * count
    try:
        start = ipaddress.ip_address(first)
        return [str(start + n) for n in range(count)]
    except ValueError as error:  # not an address, or the last one would be beyond the last
        message = f"Field 'robotIpStart' must be an IP address with {count - 1} more behind it."
        raise Rejected(Reason.ROBOT_CONFIG_INVALID, message, first) from error


def _list(names: list[RobotName], most: int = 10) -> str:
    return ", ".join(names[:most]) + (", …" if len(names) > most else "")


class RemoveRobots(OfRobots, frozen=True, kw_only=True):
    """Take robots out of their scene for good; all of them, or none."""


def remove(fleet: Fleet, command: RemoveRobots) -> Decision:
    """A robot that has orders stays: cancel or finish them first."""
    scene = scene_of(fleet, command.scene)
    robots = known_robots(fleet, scene, command.robots)
    for robot in robots:
        if robot.orders:
            message = f"Robot '{robot.name}' still has orders: {', '.join(robot.orders)}."
            raise Rejected(Reason.ROBOT_HAS_ORDERS, message, robot.name, *robot.orders)
    return Decision(events=tuple(RobotRemoved(scene=scene.id, robot=r.name) for r in robots))
