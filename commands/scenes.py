"""Scenes: taken from files, updated by changed files, configured."""

import hashlib

import msgspec

from commands import robots
from commands.command import Command, Decision, scene_of
from commands.rejected import Reason, Rejected
from ledger.events import SceneConfigured, SceneImported, SceneMapReplaced
from ledger.ids import SceneId
from ledger.scene import Scene, SceneFile
from ledger.scene_config import ChargingLevels, SceneConfig
from ledger.state import Fleet


def scene_digest(file: SceneFile) -> str:
    """Digest of the content: how the file is indented, or orders its keys, does not matter."""
    return hashlib.sha256(msgspec.json.encode(file, order="deterministic")).hexdigest()


class ImportScene(Command, frozen=True, kw_only=True):
    """Take a scene file in, as a new scene or as an update of the one with its name."""

    scene: SceneId  # id of the scene if it turns out to be new
    digest: str  # scene_digest of the file
    file: SceneFile  # as a reader of commands.imports gave it, which has checked its references


def import_scene(fleet: Fleet, command: ImportScene) -> Decision:
    """The same content is the same scene, so a server may be started again with the same file.

    An update replaces the map and adds the robots that are new; settings and the robots that the
    ledger knows stay as they are, for they may have been changed by command since.
    """
    file = command.file
    for scene in fleet.scenes.values():
        if scene.digest == command.digest:
            return Decision(made=scene.id)
    _check_levels(file.config)
    for scene in fleet.scenes.values():
        if scene.name == file.name:
            return _update(fleet, scene, command)
    imported = SceneImported(
        scene=command.scene,
        name=file.name,
        digest=command.digest,
        areas=file.areas,
        groups=file.groups,
        container_types=file.container_types,
        config=file.config,
    )
    joined = robots.added(fleet, command.scene, file.groups, file.robots)
    return Decision(events=(imported, *joined), made=command.scene)


def _update(fleet: Fleet, scene: Scene, command: ImportScene) -> Decision:
    file = command.file
    present = {r.name: r for r in fleet.robots.values() if r.scene == scene.id}
    groups = {group.id for group in file.groups}
    for robot in present.values():
        if robot.config.group not in groups:
            message = (
                f"Robot '{robot.name}' is of group {robot.config.group}, which the file lacks: "
                "keep the group, or remove the robot first."
            )
            raise Rejected(Reason.GROUP_UNKNOWN, message, robot.name, robot.config.group)
    replaced = SceneMapReplaced(
        scene=scene.id,
        digest=command.digest,
        areas=file.areas,
        groups=file.groups,
        container_types=file.container_types,
    )
    new = tuple(config for config in file.robots if config.name not in present)
    joined = robots.added(fleet, scene.id, file.groups, new)
    return Decision(events=(replaced, *joined), made=scene.id)


class ConfigureScene(Command, frozen=True, kw_only=True):
    """Change the settings of a scene."""

    scene: SceneId
    config: SceneConfig  # all of them


def configure(fleet: Fleet, command: ConfigureScene) -> Decision:
    """Refuse charging levels that contradict each other or are for groups that do not exist."""
    scene = scene_of(fleet, command.scene)
    _check_levels(command.config)
    groups = {group.id for group in scene.groups}
    for group in command.config.charging.by_group:
        if group not in groups:
            message = f"Field 'chargingConfig.groupedConfigs': there is no robot group {group}."
            raise Rejected(Reason.GROUP_UNKNOWN, message, group)
    if command.config == scene.config:
        return Decision()
    return Decision(events=(SceneConfigured(scene=scene.id, config=command.config),))


def _check_levels(config: SceneConfig) -> None:
    charging = config.charging
    named = {"chargingConfig.defaultConfig": charging.default}
    named |= {f"chargingConfig.groupedConfigs.{g}": c for g, c in charging.by_group.items()}
    for field, levels in named.items():
        if not _ordered(levels):
            message = (
                f"Field '{field}': 0 <= chargeOnly <= chargeNeed <= chargeOk <= chargeFull <= 1 "
                "must hold."
            )
            raise Rejected(Reason.SCENE_CONFIG_INVALID, message, field)


def _ordered(levels: ChargingLevels) -> bool:
    only, need = levels.charge_only, levels.charge_need
    return 0 <= only <= need <= levels.charge_ok <= levels.charge_full <= 1
