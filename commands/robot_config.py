"""How robots are set up: what a set-up must be, and how it is changed (spec/m4.md, SceneRobot)."""

import msgspec

from commands.command import Command, Decision, Events, scene_of
from commands.rejected import Reason, Rejected
from commands.robot_names import OfRobots, for_each, unknown_robot
from ledger.events import RobotReconfigured
from ledger.ids import RobotName, SceneId, robot_key
from ledger.scene import ConnectionType, Group, RobotConfig, RobotVendor, Value
from ledger.state import BinStatus, Fleet, Robot

BINS_MAX = 50  # of one robot
NAME_CHARS_MAX = 100
NAME_CHARS_BARRED = frozenset("/*$?#")  # they mean something in the keys of the bus


class RobotConfigPatch(Value, frozen=True, kw_only=True):
    """New values of a set-up; None leaves the robot's own (C11), an empty text takes it away."""

    group: int | None = None
    disabled: bool | None = None
    simulated: bool | None = None
    remark: str | None = None
    tags: tuple[str, ...] | None = None
    vendor: RobotVendor | None = None
    bin_count: int | None = None
    image: str | None = None  # JSON text
    connection: ConnectionType | None = None
    host: str | None = None
    port_first: int | None = None
    tls: bool | None = None
    gateway_user: str | None = None
    gateway_secret_kept: bool | None = None  # True = a new secret came with the call
    plus_one: bool | None = None

    def over(self, config: RobotConfig) -> RobotConfig:
        """Give a robot's set-up with these values in it."""
        given = {f: v for f in self.__struct_fields__ if (v := getattr(self, f)) is not None}
        return msgspec.structs.replace(
            config, **{field: None if value == "" else value for field, value in given.items()}
        )


class ReconfigureRobot(Command, frozen=True, kw_only=True):
    """Set a robot up anew, as a whole."""

    scene: SceneId
    config: RobotConfig  # its name says which robot; the secret is "kept" if one came with it


def reconfigure(fleet: Fleet, command: ReconfigureRobot) -> Decision:
    """What the caller leaves out is at its default again, but for the secret nobody can read."""
    scene = scene_of(fleet, command.scene)
    check_name(command.config.name)
    robot = fleet.robots.get(robot_key(scene.id, command.config.name))
    if robot is None:
        raise unknown_robot(command.config.name, "robotName")
    given = command.config.gateway_secret_kept
    return Decision(events=_reconfigured(fleet, robot, command.config, secret_given=given))


class ReconfigureRobots(OfRobots, frozen=True, kw_only=True):
    """Change the same things in the set-up of several robots, each on its own."""

    patch: RobotConfigPatch


def reconfigure_each(fleet: Fleet, command: ReconfigureRobots) -> Decision:
    """A robot that cannot be set up so keeps its old set-up whole."""
    given = command.patch.gateway_secret_kept is True

    def one(robot: Robot) -> Events:
        after = command.patch.over(robot.config)
        return _reconfigured(fleet, robot, after, secret_given=given)

    return for_each(fleet, command, one)


def _reconfigured(
    fleet: Fleet, robot: Robot, after: RobotConfig, *, secret_given: bool
) -> tuple[RobotReconfigured, ...]:
    """Only news is an event; a secret is always news, for what it was is not known here."""
    kept = secret_given or robot.config.gateway_secret_kept
    after = msgspec.structs.replace(after, gateway_secret_kept=kept)
    if after == robot.config and not secret_given:
        return ()
    check_config(after, fleet.scenes[robot.scene].groups)
    if robot.orders:
        _check_load(robot, after)
    _check_bins(robot, after.storage_places)
    return (RobotReconfigured(scene=robot.scene, robot=robot.name, config=after),)


def _check_load(robot: Robot, after: RobotConfig) -> None:
    """Traffic has cleared the ground for the old footprint; orders have the old bins."""
    before = robot.config
    for field, changed in (
        ("groupId", before.group != after.group),
        ("selfBinNum", before.storage_places != after.storage_places),
    ):
        if changed:
            message = (
                f"Field '{field}' of robot '{robot.name}' cannot change while it has orders: "
                f"{', '.join(robot.orders)}."
            )
            raise Rejected(Reason.ROBOT_HAS_ORDERS, message, robot.name, *robot.orders)


def _check_bins(robot: Robot, places: int) -> None:
    if any(content.status is not BinStatus.EMPTY for content in robot.bins[places:]):
        message = f"Field 'selfBinNum': robot '{robot.name}' has a load beyond its first {places}."
        raise Rejected(Reason.ROBOT_BIN_TAKEN, message, robot.name, places)


def check_name(name: RobotName) -> None:
    """Refuse a name that is empty (C16), or that the bus could not carry."""
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


def check_config(config: RobotConfig, groups: tuple[Group, ...]) -> None:
    """Refuse an unknown group, and what contradicts itself (spec/m4.md, SceneRobot)."""
    if all(group.id != config.group for group in groups):
        message = f"Field 'groupId': the scene has no robot group {config.group}."
        raise Rejected(Reason.GROUP_UNKNOWN, message, config.name, config.group)
    message = ""
    if not 1 <= config.bin_count <= BINS_MAX:
        message = f"Field 'selfBinNum' must be from 1 to {BINS_MAX}"
    elif config.connection is ConnectionType.FLEET_TO_ROBOT and not config.host:
        message = "Field 'robotIp' is required where 'connectionType' is FleetToRobot"
    elif config.connection is ConnectionType.GATEWAY and not config.gateway_user:
        message = "Field 'gwAuthId' is required where 'connectionType' is GwWs"
    elif config.connection is ConnectionType.GATEWAY and not config.gateway_secret_kept:
        message = "Field 'gwAuthSecret' is required where 'connectionType' is GwWs"
    elif config.port_first is not None and not 1 <= config.port_first <= 65_535:
        message = "Field 'robotPortStart' must be from 1 to 65535"
    if message:
        message += f" (robot '{config.name}')."
        raise Rejected(Reason.ROBOT_CONFIG_INVALID, message, config.name)
