"""Answers kept for repeated Idempotency-Keys: which are, and for how long.

The window stands in the ledger, not in the settings of a server: the same events give the same
answers, whoever folds them. Ages go by the times of events.
"""

from typing import assert_never

from ledger.events import AnswerEvent, AnswersWindowSet, CommandAnswered
from ledger.ids import CommandId
from ledger.state import Answer, AnswersWindow, Fleet

# All bodies together, in characters; beyond it the oldest go, whatever the window says. The answer
# to a call about one order has some 40, to one about all robots of a large fleet 100,000.
CHARS_MAX = 64_000_000


def evolve_answer(fleet: Fleet, event: AnswerEvent) -> None:
    """Keep an answer, or change the window; then forget what is outside it."""
    if isinstance(event, CommandAnswered):
        _drop(fleet, event.command)  # it had expired: its place is among the newest now
        fleet.answers[event.command] = Answer(
            digest=event.digest, status=event.status, body=event.body, at_ms=event.at_ms
        )
        fleet.answers_chars += len(event.body)
    elif isinstance(event, AnswersWindowSet):
        fleet.answers_window = AnswersWindow(
            count_max=event.count_max, age_ms_max=event.age_s_max * 1000
        )
    else:
        assert_never(event)
    _forget(fleet, event.at_ms)


def answer_to(fleet: Fleet, key: CommandId, at_ms: int) -> Answer | None:
    """Give the answer that a key got, unless it is too old at this instant."""
    known = fleet.answers.get(key)
    return None if known is None or _expired(fleet, known, at_ms) else known


def _forget(fleet: Fleet, at_ms: int) -> None:
    """Answers stand in order of time, so the ones to go are the first."""
    answers = fleet.answers
    while answers:
        oldest = next(iter(answers))
        fits = len(answers) <= fleet.answers_window.count_max and (
            fleet.answers_chars <= CHARS_MAX or len(answers) == 1
        )
        if fits and not _expired(fleet, answers[oldest], at_ms):
            return
        _drop(fleet, oldest)


def _expired(fleet: Fleet, answer: Answer, at_ms: int) -> bool:
    return at_ms - answer.at_ms > fleet.answers_window.age_ms_max


def _drop(fleet: Fleet, key: CommandId) -> None:
    gone = fleet.answers.pop(key, None)
    if gone is not None:
        fleet.answers_chars -= len(gone.body)
