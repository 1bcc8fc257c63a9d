"""What all commands and all decisions have in common."""

from typing import TypeAlias

import msgspec

from commands.rejected import Reason, Rejected
from ledger.events import AnyEvent
from ledger.ids import CommandId, SceneId
from ledger.scene import Scene, Value
from ledger.state import Fleet

Events: TypeAlias = tuple[AnyEvent, ...]


class Command(Value, frozen=True, kw_only=True):
    """Something asked of the fleet. The shell that takes it knows who asks, and the time."""

    id: CommandId
    by: str
    at_ms: int


class Decision(msgspec.Struct, frozen=True, kw_only=True):
    """What a command leads to. Nothing at all is a decision too."""

    events: Events = ()
    refused: dict[str, Rejected] = {}  # entries of a batch that failed; the others went through
    made: str = ""  # id of the order or scene that the command made, or found as already there
    position: int = 0  # of the newest event that the decision rests on or states


def known_scene(fleet: Fleet, scene: SceneId) -> Scene:
    """Find a scene, in service or not; refuse a blank, unknown or removed one."""
    found = fleet.scenes.get(scene)
    if found is None or found.removed:
        if not scene.strip():
            raise Rejected(Reason.SCENE_BLANK, "Field 'sceneId' must not be blank.")
        raise Rejected(Reason.SCENE_UNKNOWN, f"There is no scene with id '{scene}'.", scene)
    return found


def scene_of(fleet: Fleet, scene: SceneId) -> Scene:
    """Find the scene of a command about its work; refuse what `known_scene` does, and disabled."""
    found = known_scene(fleet, scene)
    if found.disabled:
        raise Rejected(Reason.SCENE_DISABLED, f"The scene with id '{scene}' is disabled.", scene)
    return found


def at_most(count: int, most: int, field: str) -> None:
    """Refuse a list that is longer than its limit."""
    if count > most:
        message = f"Field '{field}' has {count} entries, at most {most} are allowed."
        raise Rejected(Reason.TOO_MANY, message, field, most)
