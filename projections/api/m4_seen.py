"""The robots of a scene as they are seen at one instant, now or in the past."""

from collections.abc import Iterator, Mapping

from ledger.errors import Refused
from ledger.ids import RobotKey, RobotName, robot_key
from ledger.link import Plan, Report
from ledger.scene import Group, Scene
from ledger.state import Fleet, Robot
from projections.api.m4_robots import Seen, bin_points
from projections.live import Live
from projections.poses import at_instant, carried, common_instant

NO_SUCH_ROBOT = "NoSuchRobot"  # the vendor's own word


def robots_of(fleet: Fleet, scene: Scene) -> dict[RobotKey, Robot]:
    """Give the robots of a scene, disabled ones too."""
    return {key: robot for key, robot in fleet.robots.items() if robot.scene == scene.id}


def robot_asked(fleet: Fleet, scene: Scene, name: str) -> Robot:
    """Find the robot of a request."""
    robot = fleet.robots.get(robot_key(scene.id, RobotName(name)))
    if robot is None:
        words = f"Field 'robotName': scene '{scene.name}' has no robot '{name}'."
        raise Refused(NO_SUCH_ROBOT, words, name)
    return robot


def instant_of(live: Live, robots: Mapping[RobotKey, Robot]) -> int | None:
    """Give the newest instant at which all robots who answer have reported."""
    reports = live.reports
    return common_instant(
        reports[key] for key, robot in robots.items() if robot.online and key in reports
    )


def seen_now(live: Live, scene: Scene) -> Iterator[Seen]:
    """See the enabled robots at the newest instant at which all who answer have reported."""
    robots = robots_of(live.fleet, scene)
    instant_ms = instant_of(live, robots)
    groups, points = groups_of(scene), bin_points(scene)
    for key, robot in robots.items():
        if robot.config.disabled:
            continue
        own = report = live.reports.get(key)
        if robot.online and report is not None and instant_ms is not None:
            report = at_instant(tuple(live.recent[key]), instant_ms)
        yield Seen(
            robot=robot,
            group=groups[robot.config.group],
            report=report,
            own=own,
            plan=live.plans.get(key),
            orders=live.fleet.orders,
            points=points,
        )


def seen_then(
    fleet: Fleet,
    scene: Scene,
    reports: Mapping[RobotName, Report],
    plans: Mapping[RobotName, Plan],
    at_ms: int,
) -> Iterator[Seen]:
    """See the enabled robots of a past moment by what was written of them."""
    groups, points = groups_of(scene), bin_points(scene)
    for robot in robots_of(fleet, scene).values():
        if robot.config.disabled:
            continue
        own = report = reports.get(robot.name)
        if robot.online and report is not None:
            report = carried(report, at_ms)
        yield Seen(
            robot=robot,
            group=groups[robot.config.group],
            report=report,
            own=own,
            plan=plans.get(robot.name),
            orders=fleet.orders,
            points=points,
        )


def groups_of(scene: Scene) -> dict[int, Group]:
    """Give the robot groups by id."""
    return {group.id: group for group in scene.groups}
