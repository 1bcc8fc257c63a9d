"""How long answers are kept for repeated Idempotency-Keys."""

from commands.command import Command, Decision
from ledger.events import AnswersWindowSet
from ledger.ids import SceneId
from ledger.state import Fleet


class SetAnswersWindow(Command, frozen=True, kw_only=True):
    """Keep so many answers, none older than so long; the server asks for it as it starts."""

    count_max: int
    age_s_max: int


def set_window(fleet: Fleet, command: SetAnswersWindow) -> Decision:
    """State it where it is another one than before."""
    window = fleet.answers_window
    if (window.count_max, window.age_ms_max) == (command.count_max, command.age_s_max * 1000):
        return Decision()
    event = AnswersWindowSet(
        scene=SceneId(""), count_max=command.count_max, age_s_max=command.age_s_max
    )
    return Decision(events=(event,))
