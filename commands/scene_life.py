"""The life of a scene beside its files: made, renamed, taken out of service, paused, removed.

All of these work on a scene that is out of service too. Only the work of a scene is refused then:
orders and calls about robots.
"""

from commands.command import Command, Decision, at_most, known_scene
from commands.rejected import Reason, Rejected
from commands.scenes import EMPTY
from ledger.events import (
    AnyEvent,
    OrderCancelled,
    SceneDisabled,
    SceneDispatchPaused,
    SceneDispatchResumed,
    SceneEnabled,
    SceneImported,
    SceneRemoved,
    SceneRenamed,
)
from ledger.ids import SceneId
from ledger.scene import SceneFile
from ledger.state import Fleet, OrderKind

NAME_CHARS_MAX = 200
SCENES_MAX = 1_000  # present ones
ORDERS_NAMED_MAX = 10  # in a refusal


class CreateScene(Command, frozen=True, kw_only=True):
    """Make an empty scene, to be filled by the import of a file with its name."""

    scene: SceneId  # id of the new scene
    name: str


def create(fleet: Fleet, command: CreateScene) -> Decision:
    """It has no map yet, and the one robot group that scene files have if they name none."""
    _check_name(fleet, command.name)
    present = sum(not scene.removed for scene in fleet.scenes.values())
    if present >= SCENES_MAX:
        message = f"There are {present} scenes, at most {SCENES_MAX} are allowed: remove some."
        raise Rejected(Reason.TOO_MANY, message, SCENES_MAX)
    blank = SceneFile(name=command.name, areas=())
    made = SceneImported(
        scene=command.scene, name=blank.name, digest=EMPTY, areas=(), groups=blank.groups
    )
    return Decision(events=(made,), made=command.scene)


class RenameScene(Command, frozen=True, kw_only=True):
    """Give a scene another name, or another place in lists; None = as before."""

    scene: SceneId
    name: str | None = None
    display_order: int | None = None


def rename(fleet: Fleet, command: RenameScene) -> Decision:
    """A name is unique among the scenes that are there."""
    scene = known_scene(fleet, command.scene)
    name = scene.name if command.name is None else command.name
    place = scene.display_order if command.display_order is None else command.display_order
    if name != scene.name:
        _check_name(fleet, name)
    if (name, place) == (scene.name, scene.display_order):
        return Decision()
    return Decision(events=(SceneRenamed(scene=scene.id, name=name, display_order=place),))


class DisableScene(Command, frozen=True, kw_only=True):
    """Take a scene out of service, or put it back."""

    scene: SceneId
    disabled: bool


def disable(fleet: Fleet, command: DisableScene) -> Decision:
    """Orders stay as they are: robots drive what they were granted to its end, and wait."""
    scene = known_scene(fleet, command.scene)
    if scene.disabled is command.disabled:
        return Decision()
    event = SceneDisabled if command.disabled else SceneEnabled
    return Decision(events=(event(scene=scene.id),))


class PauseDispatch(Command, frozen=True, kw_only=True):
    """Let no order of a scene get a robot, or let them again."""

    scene: SceneId
    paused: bool


def pause_dispatch(fleet: Fleet, command: PauseDispatch) -> Decision:
    """What is assigned goes on."""
    scene = known_scene(fleet, command.scene)
    if scene.dispatch_paused is command.paused:
        return Decision()
    event = SceneDispatchPaused if command.paused else SceneDispatchResumed
    return Decision(events=(event(scene=scene.id),))


class RemoveScenes(Command, frozen=True, kw_only=True):
    """Take scenes away for good, with their robots; all of them, or none."""

    scenes: tuple[SceneId, ...]


def remove(fleet: Fleet, command: RemoveScenes) -> Decision:
    """A scene with clients' live orders stays; parking, charging and making way just end."""
    at_most(len(command.scenes), SCENES_MAX, "ids")
    events: list[AnyEvent] = []
    for id_ in dict.fromkeys(command.scenes):
        scene = known_scene(fleet, id_)
        orders = [order for order in fleet.orders.values() if order.scene == scene.id]
        business = [order.id for order in orders if order.kind is OrderKind.BUSINESS]
        if business:
            named = business[:ORDERS_NAMED_MAX]
            more = ", …" if len(business) > len(named) else ""
            message = (
                f"Scene '{scene.name}' has {len(business)} live orders: {', '.join(named)}{more}. "
                "Finish or cancel them first."
            )
            raise Rejected(Reason.SCENE_HAS_ORDERS, message, scene.id, *named)
        events.extend(OrderCancelled(scene=scene.id, order=order.id) for order in orders)
        events.append(SceneRemoved(scene=scene.id))
    return Decision(events=tuple(events))


def _check_name(fleet: Fleet, name: str) -> None:
    message = ""
    if not name.strip() or name != name.strip():
        message = "must not be blank, nor begin or end with a blank"
    elif len(name) > NAME_CHARS_MAX:
        message = f"may have {NAME_CHARS_MAX} characters"
    elif not name.isprintable():
        message = "must have no control character"
    if message:
        raise Rejected(Reason.SCENE_NAME_INVALID, f"Field 'name' {message}.", name[:NAME_CHARS_MAX])
    if any(scene.name == name and not scene.removed for scene in fleet.scenes.values()):
        message = f"Field 'name': there is a scene '{name}' already."
        raise Rejected(Reason.SCENE_NAME_TAKEN, message, name)
