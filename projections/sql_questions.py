"""Twenty questions that a plant asks its history, with their statements: docs and tests."""

from ledger.scene import Value


class Question(Value, frozen=True, kw_only=True):
    """A question, what its answer shows, and how it is asked."""

    title: str
    doc: str
    sql: str


QUESTIONS: tuple[Question, ...] = ()
