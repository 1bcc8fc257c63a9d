"""Events of the command API itself."""

from typing import TypeAlias

from ledger.events.base import Event


class CommandAnswered(Event, frozen=True, kw_only=True):
    """A request with an Idempotency-Key got its answer, which every repetition will get too."""

    digest: str  # SHA-256 of the request
    status: int  # HTTP status
    body: str


class AnswersWindowSet(Event, frozen=True, kw_only=True):
    """From here on so many answers are kept for repeated keys, and none longer than so long.

    A server states it when it starts with other settings than before (docs/operations.md). Until
    the first one the window is 10,000 answers and one day.
    """

    count_max: int
    age_s_max: int  # by the times of events


AnswerEvent: TypeAlias = CommandAnswered | AnswersWindowSet
