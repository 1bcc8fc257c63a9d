"""The order of answers: asked keys, then ascending id, which is the order of storage."""

from collections.abc import Sequence
from functools import total_ordering
from typing import Any, TypeAlias

from ledger.errors import Refused
from ledger.scene import Value
from projections.fields import ID, Field
from projections.query import field_named

KEYS_MAX = 10

Rank: TypeAlias = tuple[tuple[bool, Any], ...]  # compares as the rows are to be ordered


class Key(Value, frozen=True, kw_only=True):
    """One key of a sorting."""

    field: Field
    descending: bool = False


def parse_sort(names: Sequence[str] | None) -> tuple[Key, ...]:
    """Read `["-createdOn", "id"]`; the id always comes last and makes the order total."""
    names = names or ()
    if len(names) > KEYS_MAX:
        raise Refused("errSortTooLong", f"'sort' may have {KEYS_MAX} fields.", KEYS_MAX)
    keys = []
    for n, name in enumerate(names):
        field = field_named(name.removeprefix("-").removeprefix("+"), f"sort[{n}]")
        keys.append(Key(field=field, descending=name.startswith("-")))
        if field is ID:
            break  # ids are unique: nothing behind decides anything
    if not any(key.field is ID for key in keys):
        keys.append(Key(field=ID))
    return tuple(keys)


@total_ordering
class _Falling:
    """A value that compares the other way round."""

    __slots__ = ("value",)

    def __init__(self, value: Any) -> None:
        self.value = value

    def __lt__(self, other: "_Falling") -> bool:
        return bool(other.value < self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Falling) and bool(other.value == self.value)

    __hash__ = None  # type: ignore[assignment]


def rank(keys: Sequence[Key], values: Sequence[Any]) -> Rank:
    """Give what sorts a row among others: one value a key, nulls last either way."""
    return tuple(
        (True, None) if v is None else (False, _Falling(v) if key.descending else v)
        for key, v in zip(keys, values, strict=True)
    )
