"""The header that every event carries."""

from typing import TypeVar

import msgspec

from ledger.ids import CommandId, SceneId
from ledger.scene import Value


class Event(Value, frozen=True, kw_only=True, tag=True):
    """Something that happened. Decisions leave the header blank; `stamped` fills it in."""

    position: int = 0  # dense, from 1
    at_ms: int = 0  # epoch milliseconds
    scene: SceneId
    by: str = ""  # who asked: a user, an app id, or `scheduler`
    command: CommandId = CommandId("")  # the command that caused it


E = TypeVar("E", bound=Event)


def stamped(event: E, position: int, at_ms: int, by: str, command: CommandId) -> E:
    """Give an event its place, time, author and cause."""
    return msgspec.structs.replace(event, position=position, at_ms=at_ms, by=by, command=command)
