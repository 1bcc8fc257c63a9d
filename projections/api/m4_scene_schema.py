"""A scene as it is set up: what `scenes/schema/{id}` answers (spec/protocols.md 1.6).

What is not held is left out of robot groups, and is an empty list or map in an area. One map
serves all robot groups, so `gmMap` names it for each and `groupsMap` is empty. Secrets are not
answered, nor are they held.
"""

from collections.abc import Callable
from functools import lru_cache

import msgspec

from ledger.scene import Area, ContainerType, Door, Group, Lift, RobotConfig, Scene
from ledger.scene_config import SceneConfig
from ledger.state import Fleet
from projections.api.m4_scenes import Unhashed, bound, drawn
from projections.fields import Row

SCHEMAS_KEPT = 16  # encoded maps, newest used


def schema(fleet: Fleet, scene: Scene, config: Callable[[SceneConfig], Row]) -> Row:
    """Give the schema; its areas are encoded once for each version of the scene."""
    robots = [robot.config for robot in fleet.robots.values() if robot.scene == scene.id]
    return {
        "id": scene.id,
        "basic": {
            "name": scene.name,
            "disabled": scene.disabled,
            "displayOrder": scene.display_order,
            "version": scene.version,
            "lastModifiedOn": scene.modified_ms,
        },
        "newConfig": config(scene.config) | {"parkIdleTime": scene.config.parking_idle_s},
        "structure": {
            "robotGroups": [_group(group) for group in scene.groups],
            "robotTags": sorted({tag for robot in robots for tag in robot.tags}),
            "robots": [_robot(robot) for robot in robots],
            "areas": msgspec.Raw(_areas(scene.id, scene.digest, scene.version, Unhashed(scene))),
            "containerTypes": [_container_type(kind) for kind in scene.container_types],
            "doors": [_door(door) for door in scene.doors],
            "lifts": [_lift(lift) for lift in scene.lifts],
        },
    }


def _group(group: Group) -> Row:
    motion = group.kinematics
    return {
        "id": group.id,
        "name": group.name,
        "collisionModel": {"points": [{"x": x, "y": y} for x, y in group.footprint]},
        "maxSpeed": motion.speed_mps_max,
        "maxAcc": motion.acceleration_mps2_max,
        "maxRotSpeed": motion.turn_radps_max,
        "maxRotAcc": motion.turn_radps2_max,
    }


def _robot(robot: RobotConfig) -> Row:
    """SceneRobot without its secret (spec/m4.md §8)."""
    return {
        "robotName": robot.name,
        "disabled": robot.disabled,
        "remark": robot.remark,
        "groupId": robot.group,
        "tags": robot.tags,
        "vendor": robot.vendor,
        "selfBinNum": robot.bin_count,
        "image": None if robot.image is None else msgspec.Raw(robot.image.encode()),
        "connectionType": robot.connection,
        "robotIp": robot.host,
        "robotPortStart": robot.port_first,
        "ssl": robot.tls,
        "gwAuthId": robot.gateway_user,
        "simulated": robot.simulated,
        "plusOne": robot.plus_one,
    }


@lru_cache(maxsize=SCHEMAS_KEPT)
def _areas(id_: str, digest: str, version: int, carrier: Unhashed) -> bytes:
    scene = carrier.scene
    return msgspec.json.encode([_area(area, scene.groups) for area in scene.areas])


def _area(area: Area, groups: tuple[Group, ...]) -> Row:
    map_ = {"name": area.map_name, "md5": area.map_digest}
    return {
        "id": area.id,
        "name": area.name,
        "disabled": area.disabled,
        "mergedMap": {
            "bound": bound(area),
            **drawn(area),
            "zones": [],
            "topoAreas": [],
            "restrictedLines": [
                {"start": {"x": a[0], "y": a[1]}, "end": {"x": b[0], "y": b[1]}}
                for a, b in area.walls
            ],
            "sourceMaps": [map_],
        },
        "gmMap": {str(group.id): map_ for group in groups},
        "groupsMap": {},
    }


def _container_type(kind: ContainerType) -> Row:
    return {
        "name": kind.name,
        "collisionModel": {"points": [{"x": x, "y": y} for x, y in kind.footprint]},
    }


def _door(door: Door) -> Row:
    """SceneDoor; it controls paths or points, never both."""
    controlled: Row = {"controlledPathKeys": door.paths}
    if door.points:
        controlled = {"controlledPointNames": door.points}
    return {
        "id": door.id,
        "name": door.name,
        "disabled": door.disabled,
        "areaId": door.area,
        **controlled,
        "openPre": door.open_ahead_m > 0,
        "openPreDist": door.open_ahead_m,
        "x": door.x_m,
        "y": door.y_m,
        "theta": door.heading_rad,
        "width": door.width_m,
        "mock": door.simulated,
    }


def _lift(lift: Lift) -> Row:
    return {
        "id": lift.id,
        "name": lift.name,
        "disabled": lift.disabled,
        "floors": [
            {"name": floor.name, "areaId": floor.area, "pointName": floor.point}
            for floor in lift.floors
        ],
        "openDoorCost": lift.door_s,
        "closeDoorCost": lift.door_s,
        "changeFloorCost": lift.floor_s,
        "mock": lift.simulated,
    }
