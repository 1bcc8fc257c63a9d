"""What robots have waited for, as the scheduler sums it up."""

from commands.command import Events, known_scene
from ledger.events import RobotsWaited
from ledger.proposals import NoteWaits
from ledger.state import Fleet


def note(fleet: Fleet, proposal: NoteWaits) -> Events:
    """Keep the sums; robots that have left the scene meanwhile have waited all the same."""
    known_scene(fleet, proposal.scene)
    return (
        RobotsWaited(
            scene=proposal.scene,
            from_ms=proposal.from_ms,
            waits=proposal.waits,
            left_out_ms=proposal.left_out_ms,
            cycles=proposal.cycles,
            pushes=proposal.pushes,
            plannings=proposal.plannings,
        ),
    )
