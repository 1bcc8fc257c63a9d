"""Scenes from files: taken in as new ones, or as updates of those that are there.

`commands.scene_life` has what else becomes of a scene, `commands.scene_config` its settings.
"""

import hashlib

from commands import robots
from commands.command import Command, Decision, Events
from commands.places import Places, check_location, check_task, places_in
from commands.rejected import Reason, Rejected
from commands.scene_config import check_settings
from ledger.canonical import canonical_json
from ledger.events import OrderCancelled, SceneConfigured, SceneImported, SceneMapReplaced
from ledger.ids import SceneId
from ledger.scene import Scene, SceneFile
from ledger.scene_config import SceneConfig
from ledger.state import Fleet, Order, OrderKind, StepStatus

EMPTY = ""  # digest of a scene that no file has filled yet


def scene_digest(file: SceneFile) -> str:
    """Digest of the content: how the file is indented, or orders its keys, does not matter."""
    return hashlib.sha256(canonical_json(file)).hexdigest()


class ImportScene(Command, frozen=True, kw_only=True):
    """Take a scene file in, as a new scene or as an update of the one with its name."""

    scene: SceneId  # id of the scene if it turns out to be new
    digest: str  # scene_digest of the file
    file: SceneFile  # as a reader of commands.imports gave it, which has checked its references


def import_scene(fleet: Fleet, command: ImportScene) -> Decision:
    """The same content is the same scene, so a server may be started again with the same file.

    An update replaces the map and adds the robots that are new; settings and the robots that the
    ledger knows stay as they are, for they may have been changed by command since. Only a scene
    that was created empty and not configured takes the file's settings too. A removed scene is
    none: its file makes a new one.
    """
    file = command.file
    present = [scene for scene in fleet.scenes.values() if not scene.removed]
    for scene in present:
        if scene.digest == command.digest:
            return Decision(made=scene.id)
    check_settings(file.config, file.groups)
    for scene in present:
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
        doors=file.doors,
        lifts=file.lifts,
    )
    joined = robots.added(fleet, command.scene, file.groups, file.robots)
    return Decision(events=(imported, *joined), made=command.scene)


def _update(fleet: Fleet, scene: Scene, command: ImportScene) -> Decision:
    file = command.file
    present = {r.name: r for r in fleet.robots.values() if r.scene == scene.id}
    groups = {group.id for group in file.groups}
    ended = _with_the_map(fleet, scene, places_in(file.areas))
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
        doors=file.doors,
        lifts=file.lifts,
    )
    new = tuple(config for config in file.robots if config.name not in present)
    joined = robots.added(fleet, scene.id, file.groups, new)
    configured: Events = ()
    if scene.digest == EMPTY and scene.config == SceneConfig() != file.config:
        configured = (SceneConfigured(scene=scene.id, config=file.config),)
    return Decision(events=(*ended, replaced, *configured, *joined), made=scene.id)


def _with_the_map(fleet: Fleet, scene: Scene, places: Places) -> Events:
    """Refuse a map that lacks where live orders are still to go; end the system's own ones.

    Those would not be missed: dispatch makes new ones where they are needed.
    """
    ended = []
    for order in fleet.orders.values():
        if order.scene != scene.id:
            continue
        try:
            _check_places(order, places)
        except Rejected as lacking:
            if order.kind is not OrderKind.BUSINESS:
                ended.append(OrderCancelled(scene=scene.id, order=order.id))
                continue
            message = (
                f"Order '{order.id}' cannot go on with this map: {lacking.message} "
                "Finish or cancel the order first, or keep the place."
            )
            raise Rejected(Reason.LOCATION_IN_USE, message, order.id, *lacking.arguments) from None
    return tuple(ended)


def _check_places(order: Order, places: Places) -> None:
    for index, step in enumerate(order.steps):
        if step.status is not StepStatus.DONE:
            check_task(places, step.task, f"steps[{index}]")
    for index, location in enumerate(() if order.steps else order.key_locations):
        check_location(places, location, f"keyLocations[{index}]")
