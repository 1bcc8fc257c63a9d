"""Which order comes first: the setting dispatch_sort as a key that sorts."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

from ledger.state import Order

# what two keys are compared by, field after field; of one setting they have one shape
Urgency: TypeAlias = tuple[object, ...]
_Field: TypeAlias = Callable[[Order], Urgency]

_BY_PRIORITY: tuple[str, ...] = ("-priority",)
_END = 1  # behind every letter of a descending text, which are below zero


def _number(value: int, *, descending: bool) -> Urgency:
    return (-value if descending else value,)


def _text(value: str | None, *, descending: bool) -> Urgency:
    """Orders without the text come last either way."""
    if value is None:
        return (True, ())
    if descending:
        return (False, (*(-ord(letter) for letter in value), _END))
    return (False, tuple(ord(letter) for letter in value))


def _field(name: str) -> _Field | None:
    descending = name.startswith("-")
    match name.removeprefix("-").removeprefix("+") if name[:1] in "+-" else name:
        case "priority":
            return lambda order: _number(order.priority, descending=descending)
        case "createdOn":
            return lambda order: _number(order.created_ms, descending=descending)
        case "externalId":
            return lambda order: _text(order.external_id, descending=descending)
        case "id":
            return lambda order: _text(order.id, descending=descending)
        case _:
            return None  # of a ledger from before names were checked


def rank(sort: Sequence[str]) -> Callable[[Order], Urgency]:
    """Give the fields that the setting sorts by, as one key for each order; none = by priority.

    Orders of equal keys are one class: within it the cheapest way wins.
    """
    fields = [f for f in map(_field, sort or _BY_PRIORITY) if f is not None]
    return lambda order: tuple(field(order) for field in fields)


def urgency(sort: Sequence[str]) -> Callable[[Order], Urgency]:
    """Give a key that no two orders share: the setting's, then priority, age and id."""
    by = rank(sort)
    return lambda order: (by(order), -order.priority, order.created_ms, order.id)
