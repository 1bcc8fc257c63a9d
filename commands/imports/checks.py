"""What must hold in every scene file, whichever format it came from."""

import json
from collections.abc import Iterable
from math import isfinite

from ledger.errors import Refused
from ledger.ids import PointName, RobotName
from ledger.scene import Area, Bin, Group, Path, RobotConfig, SceneFile

BAD_SCENE = "BadSceneFile"
COORDINATE_M_MAX = 100_000.0
ROBOTS_MAX = 5_000
CONTROLS_MAX = 16


def simulated(robots: int, groups: tuple[Group, ...]) -> tuple[RobotConfig, ...]:
    """Name so many simulated robots, of the first group."""
    if not 0 <= robots <= ROBOTS_MAX:
        raise Refused(BAD_SCENE, f"robots must be from 0 to {ROBOTS_MAX}, not {robots}", robots)
    group = groups[0].id if groups else 0
    return tuple(
        RobotConfig(name=RobotName(f"AMB-{n:02}"), group=group, simulated=True)
        for n in range(1, robots + 1)
    )


def checked(scene: SceneFile) -> SceneFile:
    """Give the scene back if nothing is wrong with it."""
    check_references(scene)
    return scene


def check_references(scene: SceneFile) -> None:
    """Raise Refused for the first name that is there twice or means nothing, or bad number."""
    if not scene.name.strip():
        _refuse("name", "a scene needs a name")
    if not scene.areas:
        _refuse("areas", "a scene needs at least one area")
    _once("areas", "id", (area.id for area in scene.areas))
    _once("groups", "id", (group.id for group in scene.groups))
    _once("groups", "name", (group.name for group in scene.groups))
    _once("container_types", "name", (kind.name for kind in scene.container_types))
    _once("areas[].points", "name", (p.name for area in scene.areas for p in area.points))
    _once("areas[].bins", "name", (b.name for area in scene.areas for b in area.bins))
    for i, area in enumerate(scene.areas):
        _check_area(f"areas[{i}]", area)
    for i, group in enumerate(scene.groups):
        _check_group(f"groups[{i}]", group)
    _check_robots(scene)


def _refuse(where: str, what: str, *args: object) -> None:
    raise Refused(BAD_SCENE, f"{where}: {what}", where, *args)


def _once(where: str, field: str, values: Iterable[object]) -> None:
    seen: set[object] = set()
    for value in values:
        if value in seen:
            _refuse(where, f"{field} {value!r} is there twice", value)
        if value == "":
            _refuse(where, f"an empty {field}")
        seen.add(value)


def _check_area(where: str, area: Area) -> None:
    if not area.points:
        _refuse(f"{where}.points", "an area needs at least one point")
    names: set[PointName] = set()
    for i, point in enumerate(area.points):
        names.add(point.name)
        if "->" in point.name:
            _refuse(f"{where}.points[{i}].name", f"{point.name!r} holds '->'", point.name)
        if not (_within(point.x_m) and _within(point.y_m)):
            _refuse(f"{where}.points[{i}]", f"{point.name} is not within 100 km", point.name)
    keys = set()
    for i, path in enumerate(area.paths):
        _check_path(f"{where}.paths[{i}]", path, names)
        if path.key in keys:
            _refuse(f"{where}.paths[{i}]", f"{path.key} is there twice", path.key)
        keys.add(path.key)
    for i, spot in enumerate(area.bins):
        _check_bin(f"{where}.bins[{i}]", spot, names)


def _check_path(where: str, path: Path, names: set[PointName]) -> None:
    for field, end in (("start", path.start), ("end", path.end)):
        if end not in names:
            _refuse(f"{where}.{field}", f"no point is named {end!r} ({path.key})", end)
    if path.start == path.end:
        _refuse(where, f"{path.key} ends where it starts", path.key)
    if len(path.controls) > CONTROLS_MAX:
        _refuse(f"{where}.controls", f"{path.key} has more than {CONTROLS_MAX}", path.key)
    if not all(_within(x) and _within(y) for x, y in path.controls):
        _refuse(f"{where}.controls", f"{path.key} is not within 100 km", path.key)
    for field, limit in (
        ("speed_mps_max", path.speed_mps_max),
        ("acceleration_mps2_max", path.acceleration_mps2_max),
    ):
        if limit is not None and not _positive(limit):
            _refuse(f"{where}.{field}", f"{path.key} has {limit}, not above 0", path.key)


def _check_bin(where: str, spot: Bin, names: set[PointName]) -> None:
    if spot.point not in names:
        _refuse(f"{where}.point", f"no point is named {spot.point!r} (bin {spot.name})", spot.point)
    _once(f"{where}.tasks", "name", (task.name for task in spot.tasks))
    for i, task in enumerate(spot.tasks):
        try:
            whole = isinstance(json.loads(task.arguments), dict)
        except ValueError:
            whole = False
        if not whole:
            field = f"{where}.tasks[{i}].arguments"
            _refuse(field, f"{task.name} of bin {spot.name} has no JSON object", spot.name)


def _check_group(where: str, group: Group) -> None:
    if len(group.footprint) < 3:
        _refuse(f"{where}.footprint", f"{group.name} has less than three corners", group.name)
    if not all(_within(x) and _within(y) for x, y in group.footprint):
        _refuse(f"{where}.footprint", f"{group.name} is not within 100 km", group.name)
    motion = group.kinematics
    for field, limit in (
        ("speed_mps_max", motion.speed_mps_max),
        ("acceleration_mps2_max", motion.acceleration_mps2_max),
        ("turn_radps_max", motion.turn_radps_max),
        ("turn_radps2_max", motion.turn_radps2_max),
    ):
        if not _positive(limit):
            field = f"{where}.kinematics.{field}"
            _refuse(field, f"{group.name} has {limit}, not above 0", group.name)


def _check_robots(scene: SceneFile) -> None:
    _once("robots", "name", (robot.name for robot in scene.robots))
    groups = {group.id for group in scene.groups}
    for i, robot in enumerate(scene.robots):
        if robot.group not in groups:
            what = f"no group has the id {robot.group} (robot {robot.name})"
            _refuse(f"robots[{i}].group", what, robot.group)
        if any(letter in robot.name for letter in "/*#?$"):
            # it is part of a key on the bus
            _refuse(f"robots[{i}].name", f"{robot.name!r} holds one of / * # ? $", robot.name)
        if robot.bin_count < 0:
            _refuse(f"robots[{i}].bin_count", f"{robot.name} has {robot.bin_count}", robot.name)


def _within(coordinate_m: float) -> bool:
    return isfinite(coordinate_m) and abs(coordinate_m) <= COORDINATE_M_MAX


def _positive(value: float) -> bool:
    return isfinite(value) and value > 0.0
