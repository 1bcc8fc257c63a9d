"""Access is kept outside the ledger; here it is only told there what was changed and refused."""

from commands.command import Command, Decision, at_most
from ledger.events import AccessEvent
from ledger.state import Fleet

EVENTS_MAX = 10_000  # of one command


class RecordAccess(Command, frozen=True, kw_only=True):
    """State what happened to access; it has happened, so nothing of it can be refused."""

    events: tuple[AccessEvent, ...]


def record(fleet: Fleet, command: RecordAccess) -> Decision:
    """Take it as it is: these events change no state of the fleet."""
    at_most(len(command.events), EVENTS_MAX, "events")
    return Decision(events=command.events)
