"""The robots that a command names: found all together, or each on its own."""

from collections.abc import Callable

from commands.command import Command, Decision, Events, at_most, scene_of
from commands.rejected import Reason, Rejected
from ledger.events import AnyEvent
from ledger.ids import RobotName, SceneId, robot_key
from ledger.scene import Scene
from ledger.state import Fleet, Robot

ROBOTS_MAX = 10_000  # named by one call, or in one scene file


class OfRobots(Command, frozen=True, kw_only=True):
    """Base of commands for robots of one scene."""

    scene: SceneId
    robots: tuple[RobotName, ...]


def known_robots(fleet: Fleet, scene: Scene, names: tuple[RobotName, ...]) -> list[Robot]:
    """Find all, each once; refuse the call over the first unknown one."""
    robots, refused = _found(fleet, scene, names)
    for no in refused.values():
        raise no
    return robots


def for_each(fleet: Fleet, command: OfRobots, decide: Callable[[Robot], Events]) -> Decision:
    """Decide for each robot on its own; a refusal is about its robot and stops no other."""
    scene = scene_of(fleet, command.scene)
    robots, refused = _found(fleet, scene, command.robots)
    events: list[AnyEvent] = []
    for robot in robots:
        try:
            events.extend(decide(robot))
        except Rejected as no:
            refused[robot.name] = no.with_traceback(None)
    return Decision(events=tuple(events), refused=refused)


def check_enabled(robot: Robot) -> None:
    """Refuse a robot that is out of dispatch."""
    if robot.config.disabled:
        message = f"Robot '{robot.name}' is disabled: enable it first."
        raise Rejected(Reason.ROBOT_NOT_AVAILABLE, message, robot.name)


def check_reachable(robot: Robot) -> None:
    """Refuse a robot that cannot be told anything now."""
    check_enabled(robot)
    if not robot.online:
        message = f"Robot '{robot.name}' does not answer."
        raise Rejected(Reason.ROBOT_NOT_AVAILABLE, message, robot.name)


def _found(
    fleet: Fleet, scene: Scene, names: tuple[RobotName, ...]
) -> tuple[list[Robot], dict[str, Rejected]]:
    at_most(len(names), ROBOTS_MAX, "robotNames")
    robots: list[Robot] = []
    refused: dict[str, Rejected] = {}
    for name in dict.fromkeys(names):
        robot = fleet.robots.get(robot_key(scene.id, name))
        if robot is None:
            refused[name] = unknown_robot(name, "robotNames")
        else:
            robots.append(robot)
    return robots, refused


def unknown_robot(name: RobotName, field: str) -> Rejected:
    """Say that the scene has no robot of this name."""
    return Rejected(
        Reason.ROBOT_UNKNOWN, f"Field '{field}': the scene has no robot '{name}'.", name
    )
