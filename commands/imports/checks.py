"""What must hold in every scene file, whichever format it came from."""

import json
from collections.abc import Iterable
from math import isfinite

from ledger.errors import Refused
from ledger.ids import PointName, RobotName
from ledger.scene import Area, Bin, Door, Group, Lift, Path, RobotConfig, SceneFile

BAD_SCENE = "BadSceneFile"
COORDINATE_M_MAX = 100_000.0
ROBOTS_MAX = 5_000
CONTROLS_MAX = 16
DEVICES_MAX = 1_000  # doors of a scene, and lifts
DEVICE_ID_MAX = 2**31 - 1  # an Int of M4
OPEN_AHEAD_M_MAX = 1_000.0
LIFT_S_MAX = 3_600.0


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
    _once("areas", "name", (area.name for area in scene.areas))
    _once("groups", "id", (group.id for group in scene.groups))
    _once("groups", "name", (group.name for group in scene.groups))
    _once("container_types", "name", (kind.name for kind in scene.container_types))
    _once("areas[].points", "name", (p.name for area in scene.areas for p in area.points))
    _once("areas[].bins", "name", (b.name for area in scene.areas for b in area.bins))
    for i, area in enumerate(scene.areas):
        _check_area(f"areas[{i}]", area)
    for i, group in enumerate(scene.groups):
        _check_group(f"groups[{i}]", group)
    _check_doors(scene)
    _check_lifts(scene)
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
    for field, corners in (
        ("footprint", group.footprint),
        ("footprint_loaded", group.footprint_loaded),
    ):
        if corners is None:
            continue
        if len(corners) < 3:
            _refuse(f"{where}.{field}", f"{group.name} has less than three corners", group.name)
        if not all(_within(x) and _within(y) for x, y in corners):
            _refuse(f"{where}.{field}", f"{group.name} is not within 100 km", group.name)
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


def _check_doors(scene: SceneFile) -> None:
    _check_devices("doors", scene.doors)
    areas = {area.id: area for area in scene.areas}
    for i, door in enumerate(scene.doors):
        where, area = f"doors[{i}]", areas.get(door.area)
        if area is None:
            _refuse(f"{where}.area", f"no area has the id {door.area} (door {door.name})")
        else:
            _check_ground(where, door, area)
        if not 0 <= door.open_ahead_m <= OPEN_AHEAD_M_MAX:
            what = f"{door.name} has {door.open_ahead_m}, not 0 to {OPEN_AHEAD_M_MAX:g} m"
            _refuse(f"{where}.open_ahead_m", what, door.name)
        if not (_within(door.x_m) and _within(door.y_m) and isfinite(door.heading_rad)):
            _refuse(where, f"{door.name} is not within 100 km", door.name)
        if not _positive(door.width_m):
            _refuse(f"{where}.width_m", f"{door.name} has {door.width_m}, not above 0", door.name)


def _check_ground(where: str, door: Door, area: Area) -> None:
    """A door is across paths, or around points: M4 has one of both."""
    if bool(door.paths) == bool(door.points):
        given = "both paths and points" if door.paths else "neither paths nor points"
        _refuse(where, f"{door.name} has {given}: give one of both", door.name)
    _once(f"{where}.paths", "key", door.paths)
    _once(f"{where}.points", "name", door.points)
    keys, names = {path.key for path in area.paths}, {point.name for point in area.points}
    for key in door.paths:
        if key not in keys:
            what = f"area {area.name} has no path {key!r} (door {door.name})"
            _refuse(f"{where}.paths", what, key)
    for name in door.points:
        if name not in names:
            what = f"area {area.name} has no point {name!r} (door {door.name})"
            _refuse(f"{where}.points", what, name)


def _check_lifts(scene: SceneFile) -> None:
    _check_devices("lifts", scene.lifts)
    areas = {area.id: {point.name for point in area.points} for area in scene.areas}
    for i, lift in enumerate(scene.lifts):
        where = f"lifts[{i}].floors"
        if not lift.floors:
            _refuse(where, f"{lift.name} has no floor", lift.name)
        _once(where, "name", (floor.name for floor in lift.floors))
        _once(where, "area", (floor.area for floor in lift.floors))
        for k, floor in enumerate(lift.floors):
            if floor.area not in areas:
                what = f"no area has the id {floor.area} (lift {lift.name}, floor {floor.name})"
                _refuse(f"{where}[{k}].area", what, floor.area)
            if floor.point is not None and floor.point not in areas[floor.area]:
                what = f"area {floor.area} has no point {floor.point!r} (lift {lift.name})"
                _refuse(f"{where}[{k}].point", what, floor.point)
        for field, seconds in (("door_s", lift.door_s), ("floor_s", lift.floor_s)):
            if not 0 < seconds <= LIFT_S_MAX:
                what = f"{lift.name} has {seconds}, not above 0 and up to {LIFT_S_MAX:g} s"
                _refuse(f"lifts[{i}].{field}", what, lift.name)


def _check_devices(where: str, devices: tuple[Door | Lift, ...]) -> None:
    if len(devices) > DEVICES_MAX:
        _refuse(where, f"a scene has at most {DEVICES_MAX}, not {len(devices)}", len(devices))
    _once(where, "id", (device.id for device in devices))
    _once(where, "name", (device.name for device in devices))
    for i, device in enumerate(devices):
        if not 0 <= device.id <= DEVICE_ID_MAX:
            _refuse(f"{where}[{i}].id", f"{device.id} is not from 0 to {DEVICE_ID_MAX}", device.id)


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
