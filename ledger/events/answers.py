"""Events of the command API itself."""

from typing import TypeAlias

from ledger.events.base import Event


class CommandAnswered(Event, frozen=True, kw_only=True):
    """A request with an Idempotency-Key got its answer, which every repetition will get too."""

    digest: str  # SHA-256 of the request
    status: int  # HTTP status
    body: str


AnswerEvent: TypeAlias = CommandAnswered
