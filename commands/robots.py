"""Robots of a scene: added, removed, sent off duty, disabled (spec/m4.md §4)."""

import ipaddress

from commands.command import Command, Decision, Events, at_most, scene_of
from commands.rejected import Reason, Rejected
from ledger.events import (
    RobotAdded,
    RobotBinsCleared,
    RobotDisabled,
    RobotEnabled,
    RobotRemoved,
    RobotWentOffDuty,
    RobotWentOnDuty,
)
from ledger.ids import RobotName, SceneId, robot_key
from ledger.scene import ConnectionType, Group, RobotConfig, Scene
from ledger.state import BinStatus, Fleet, Robot

BINS_MAX = 50  # of one robot
NAME_CHARS_MAX = 100
ROBOTS_MAX = 10_000  # named by one call, or in one scene file
SERIES_MAX = 1_000
NAME_CHARS_BARRED = frozenset("/*$?#")  # they mean something in the keys of the bus


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
    known = {group.id for group in groups}
    names: set[str] = set()
    for config in robots:
        _check_name(config.name)
        if config.name in names or robot_key(scene, config.name) in fleet.robots:
            message = f"Field 'robotName': the scene has a robot '{config.name}' already."
            raise Rejected(Reason.ROBOT_NAME_TAKEN, message, config.name)
        names.add(config.name)
        if config.group not in known:
            message = f"Field 'groupId': the scene has no robot group {config.group}."
            raise Rejected(Reason.GROUP_UNKNOWN, message, config.name, config.group)
        _check_config(config)
    return tuple(RobotAdded(scene=scene, config=config) for config in robots)


def _check_name(name: str) -> None:
    message = ""
    if not name.strip() or name != name.strip():
        message = "must not be blank, nor begin or end with a blank"
    elif len(name) > NAME_CHARS_MAX:
        message = f"may have {NAME_CHARS_MAX} characters"
    elif not name.isprintable() or not NAME_CHARS_BARRED.isdisjoint(name):
        message = (
            f"must have none of {' '.join(sorted(NAME_CHARS_BARRED))} and no control character"
        )
    if message:
        raise Rejected(Reason.ROBOT_NAME_INVALID, f"Field 'robotName' {message}.", name)


def _check_config(config: RobotConfig) -> None:
    message = ""
    if not 1 <= config.bin_count <= BINS_MAX:
        message = f"Field 'selfBinNum' must be from 1 to {BINS_MAX}"
    elif config.connection is ConnectionType.FLEET_TO_ROBOT and not config.host:
        message = "Field 'robotIp' is required where 'connectionType' is FleetToRobot"
    elif config.connection is ConnectionType.GATEWAY and not config.gateway_user:
        message = "Field 'gwAuthId' is required where 'connectionType' is GwWs"
    elif config.connection is ConnectionType.GATEWAY and not config.gateway_secret:
        message = "Field 'gwAuthSecret' is required where 'connectionType' is GwWs"
    elif config.port_first is not None and not 1 <= config.port_first <= 65_535:
        message = "Field 'robotPortStart' must be from 1 to 65535"
    if message:
        message += f" (robot '{config.name}')."
        raise Rejected(Reason.ROBOT_CONFIG_INVALID, message, config.name)


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
    width = max(2, len(str(command.count)))
    hosts = _hosts(command.pattern.host, command.count)
    robots = tuple(
        _copy(command.pattern, RobotName(f"{command.prefix}-{n:0{width}}"), host)
        for n, host in enumerate(hosts, 1)
    )
    taken = [r.name for r in robots if robot_key(scene.id, r.name) in fleet.robots]
    if taken:
        message = f"Field 'robotNamePrefix': the scene has these robots already: {_list(taken)}."
        raise Rejected(Reason.ROBOT_NAME_TAKEN, message, *taken)
    return Decision(events=added(fleet, scene.id, scene.groups, robots))


def _copy(pattern: RobotConfig, name: RobotName, host: str | None) -> RobotConfig:
    fields = {field: getattr(pattern, field) for field in pattern.__struct_fields__}
    return RobotConfig(**{**fields, "name": name, "host": host})


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


class RemoveRobots(Command, frozen=True, kw_only=True):
    """Take robots out of their scene for good; all of them, or none."""

    scene: SceneId
    robots: tuple[RobotName, ...]


def remove(fleet: Fleet, command: RemoveRobots) -> Decision:
    """A robot that has orders stays: cancel or finish them first."""
    scene = scene_of(fleet, command.scene)
    robots = _known(fleet, scene, command.robots)
    for robot in robots:
        if robot.orders:
            message = f"Robot '{robot.name}' still has orders: {', '.join(robot.orders)}."
            raise Rejected(Reason.ROBOT_HAS_ORDERS, message, robot.name, *robot.orders)
    return Decision(events=tuple(RobotRemoved(scene=scene.id, robot=r.name) for r in robots))


class DisableRobots(Command, frozen=True, kw_only=True):
    """Take robots out of dispatch, or put them back; all of them, or none."""

    scene: SceneId
    robots: tuple[RobotName, ...]
    disabled: bool


def disable(fleet: Fleet, command: DisableRobots) -> Decision:
    """Orders stay with a disabled robot until they are withdrawn or cancelled."""
    scene = scene_of(fleet, command.scene)
    event = RobotDisabled if command.disabled else RobotEnabled
    return Decision(
        events=tuple(
            event(scene=scene.id, robot=robot.name)
            for robot in _known(fleet, scene, command.robots)
            if robot.config.disabled is not command.disabled
        )
    )


class SendRobotsOffDuty(Command, frozen=True, kw_only=True):
    """Let robots take no more orders, or let them take some again; each on its own."""

    scene: SceneId
    robots: tuple[RobotName, ...]
    off_duty: bool


def send_off_duty(fleet: Fleet, command: SendRobotsOffDuty) -> Decision:
    """True = takes no orders (spec/m4.md, C1); it finishes those it has."""
    scene = scene_of(fleet, command.scene)
    robots, refused = _each(fleet, scene, command.robots)
    event = RobotWentOffDuty if command.off_duty else RobotWentOnDuty
    return Decision(
        events=tuple(
            event(scene=scene.id, robot=robot.name)
            for robot in robots
            if robot.off_duty is not command.off_duty
        ),
        refused=refused,
    )


class ClearRobotBins(Command, frozen=True, kw_only=True):
    """State that left-over loads of cancelled orders were taken off by hand; each on its own."""

    scene: SceneId
    robots: tuple[RobotName, ...]


def clear_bins(fleet: Fleet, command: ClearRobotBins) -> Decision:
    """Only what a cancelled order left behind goes; a live order's load stays on the books."""
    scene = scene_of(fleet, command.scene)
    robots, refused = _each(fleet, scene, command.robots)
    return Decision(
        events=tuple(
            RobotBinsCleared(scene=scene.id, robot=robot.name)
            for robot in robots
            if any(content.status is BinStatus.CANCELLED for content in robot.bins)
        ),
        refused=refused,
    )


def _known(fleet: Fleet, scene: Scene, names: tuple[RobotName, ...]) -> list[Robot]:
    """Find all, each once; refuse the call over the first unknown one."""
    robots, refused = _each(fleet, scene, names)
    for no in refused.values():
        raise no
    return robots


def _each(
    fleet: Fleet, scene: Scene, names: tuple[RobotName, ...]
) -> tuple[list[Robot], dict[str, Rejected]]:
    at_most(len(names), ROBOTS_MAX, "robotNames")
    robots: list[Robot] = []
    refused: dict[str, Rejected] = {}
    for name in dict.fromkeys(names):
        robot = fleet.robots.get(robot_key(scene.id, name))
        if robot is None:
            message = f"Field 'robotNames': the scene has no robot '{name}'."
            refused[name] = Rejected(Reason.ROBOT_UNKNOWN, message, name)
        else:
            robots.append(robot)
    return robots, refused
