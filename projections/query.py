"""ComplexQuery, parsed: a small logic of tests over order fields (spec/protocols.md §1.3).

Logic is two-valued: a test of a null is false, except Null and Empty, and `not` and Ne give exactly
the rest. So Ne finds orders whose field is null, and Eq and Ne together find all.
On a list a text test holds where it holds for any element; Ne holds where Eq holds for none.
An empty Compound holds if its items are joined by AND, and does not if they are joined by OR.
"""

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Any, TypeAlias

from ledger.errors import Refused
from ledger.scene import Value
from projections.coerce import DAY_MS, Clock, coerce, day_start_ms, upper_end
from projections.fields import BY_NAME, Field, FieldType

DEPTH_MAX = 16  # of nested Compounds
ITEMS_MAX = 200  # conditions in one query
CHOICES_MAX = 10_000  # values of one In


class How(StrEnum):
    """The tests that all operators come down to."""

    EQUAL = "="
    LESS = "<"
    LESS_OR_EQUAL = "<="
    GREATER = ">"
    GREATER_OR_EQUAL = ">="
    IN = "in"
    CONTAIN = "contain"
    CONTAIN_FOLDED = "contain folded"  # the value is folded already
    START = "start"
    END = "end"
    NULL = "null"
    EMPTY = "empty"  # null, "" or a list of nothing


class Test(Value, frozen=True, kw_only=True):
    """One test of a field against a value or, with `other`, against another field of its type."""

    field: Field
    how: How
    value: Any = None
    other: Field | None = None


class Both(Value, frozen=True, kw_only=True):
    """All of these hold; none at all holds too."""

    items: tuple["Condition", ...] = ()


class Either(Value, frozen=True, kw_only=True):
    """At least one of these holds."""

    items: tuple["Condition", ...]


class Not(Value, frozen=True, kw_only=True):
    """This does not hold."""

    item: "Condition"


Condition: TypeAlias = Test | Both | Either | Not
ALL = Both()


class Asker(Value, frozen=True, kw_only=True):
    """Who asks, and when: CurrentUser and ThisDay depend on it."""

    user: str
    now_ms: int


def parse(query: object, asker: Asker) -> Condition:
    """Read the ComplexQuery of a request; raises Refused that names the place and the choices."""
    return ALL if query is None else _Parser(asker).condition(query, "query", 1)


def field_named(name: object, where: str) -> Field:
    """Give the field of this name; raises Refused that lists all there are."""
    if not isinstance(name, str) or name not in BY_NAME:
        raise Refused(
            "errFieldUnknown",
            f"'{where}': TransportOrder has no field {name!r}; it has {', '.join(BY_NAME)}.",
            where,
            str(name),
        )
    return BY_NAME[name]


_COMPARISONS = {
    "Eq": How.EQUAL,
    "Ne": How.EQUAL,
    "Gt": How.GREATER,
    "Gte": How.GREATER_OR_EQUAL,
    "Lt": How.LESS,
    "Lte": How.LESS_OR_EQUAL,
}
_TEXT_TESTS = {
    "Contain": How.CONTAIN,
    "ContainIgnoreCase": How.CONTAIN_FOLDED,
    "Start": How.START,
    "End": How.END,
}
_NEGATED = frozenset({"Ne", "NotNull", "NotEmpty"})
_EVERY = ("Eq", "Ne", "In", "Null", "NotNull", "Empty", "NotEmpty")
_ORDERED = (*_EVERY, "Gt", "Gte", "Lt", "Lte", "Between")
_USER = ("CurrentUser", "CurrentUsername")
OPERATORS: dict[FieldType, tuple[str, ...]] = {
    FieldType.TEXT: (*_ORDERED, *_TEXT_TESTS, *_USER),
    FieldType.INTEGER: _ORDERED,
    FieldType.NUMBER: _ORDERED,
    FieldType.BOOLEAN: _EVERY,
    FieldType.DATE: (*_ORDERED, "ThisWeek", "ThisDay"),
    FieldType.TEXTS: (*_EVERY, *_TEXT_TESTS, *_USER),
}


class _Parser:
    """Reads one query; counts its conditions."""

    def __init__(self, asker: Asker) -> None:
        self._asker = asker
        self._clock = Clock(now_ms=asker.now_ms)
        self._items = 0
        self._types: dict[str, Callable[[dict[str, Any], str, int], Condition]] = {
            "All": lambda query, where, depth: ALL,
            "Compound": self._compound,
            "General": lambda query, where, depth: self._general(query, where),
        }

    def condition(self, query: object, where: str, depth: int) -> Condition:
        if not isinstance(query, dict):
            raise _wrong(where, "must be an object with a type: All, Compound or General")
        self._items += 1
        if depth > DEPTH_MAX:
            raise _too_much(where, f"is nested deeper than {DEPTH_MAX} levels", DEPTH_MAX)
        if self._items > ITEMS_MAX:
            raise _too_much(where, f"is one of more than {ITEMS_MAX} conditions", ITEMS_MAX)
        kind = query.get("type")
        if not isinstance(kind, str) or kind not in self._types:
            raise _wrong(f"{where}.type", f"must be All, Compound or General, not {kind!r}")
        found = self._types[kind](query, where, depth)
        return Not(item=found) if _flag(query, "not", where) else found

    def _compound(self, query: dict[str, Any], where: str, depth: int) -> Condition:
        items = query.get("items")
        if items is None:
            items = []
        if not isinstance(items, list):
            raise _wrong(f"{where}.items", "must be a list of conditions")
        any_of = _flag(query, "or", where)
        parsed = tuple(
            self.condition(item, f"{where}.items[{n}]", depth + 1) for n, item in enumerate(items)
        )
        return Either(items=parsed) if any_of else Both(items=parsed)

    def _general(self, query: dict[str, Any], where: str) -> Condition:
        field = field_named(query.get("field1"), f"{where}.field1")
        operator = query.get("operator")
        possible = OPERATORS[field.type]
        if not isinstance(operator, str) or operator not in possible:
            raise Refused(
                "errOperatorUnknown",
                f"'{where}.operator': {field.name} is of type {field.type} and takes no "
                f"{operator!r}; it takes {', '.join(possible)}.",
                where,
                str(operator),
            )
        if query.get("field2") is not None:
            found: Condition = self._two_fields(query, field, operator, where)
        else:
            found = self._test(field, operator, query.get("value"), f"{where}.value")
        return Not(item=found) if operator in _NEGATED else found

    def _two_fields(self, query: dict[str, Any], field: Field, operator: str, where: str) -> Test:
        where = f"{where}.field2"
        other = field_named(query["field2"], where)
        if operator not in _COMPARISONS or field.type is FieldType.TEXTS:
            raise _wrong(where, f"goes only with {', '.join(_COMPARISONS)}, and not with lists")
        if other.type is not field.type:
            raise _wrong(where, f"is of type {other.type}, but {field.name} of type {field.type}")
        return Test(field=field, how=_COMPARISONS[operator], other=other)

    def _test(self, field: Field, operator: str, value: Any, where: str) -> Condition:
        match operator:
            case "Null" | "NotNull":
                return Test(field=field, how=How.NULL)
            case "Empty" | "NotEmpty":
                texts = field.type in (FieldType.TEXT, FieldType.TEXTS)
                return Test(field=field, how=How.EMPTY if texts else How.NULL)
            case "CurrentUser" | "CurrentUsername":  # a caller's id is its name here
                return Test(field=field, how=How.EQUAL, value=self._asker.user)
            case "ThisDay":
                start_ms = day_start_ms(self._asker.now_ms)
                return _between(field, start_ms, start_ms + DAY_MS - 1)
            case "ThisWeek":  # from Monday, UTC; 1970-01-01 was a Thursday
                today_ms = day_start_ms(self._asker.now_ms)
                start_ms = today_ms - (today_ms // DAY_MS + 3) % 7 * DAY_MS
                return _between(field, start_ms, start_ms + 7 * DAY_MS - 1)
            case "Between":
                low, high = _pair(value, where)
                return _between(
                    field,
                    coerce(field.type, low, f"{where}[0]", self._clock),
                    upper_end(field.type, high, f"{where}[1]", self._clock),
                )
            case "In":
                return Test(field=field, how=How.IN, value=self._choices(field, value, where))
            case _:  # the others take one value
                pass
        value = coerce(field.type, value, where, self._clock)
        if operator == "ContainIgnoreCase":
            value = folded(value)
        return Test(field=field, how=(_COMPARISONS | _TEXT_TESTS)[operator], value=value)

    def _choices(self, field: Field, value: Any, where: str) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise _wrong(where, "must be a list for operator In")
        if len(value) > CHOICES_MAX:
            raise _too_much(where, f"has more than {CHOICES_MAX} values", CHOICES_MAX)
        return tuple(
            coerce(field.type, v, f"{where}[{n}]", self._clock) for n, v in enumerate(value)
        )


def folded(text: str) -> str:
    """Lower case, character by character, as DuckDB's `lower` gives it for all of Unicode."""
    if text.isascii():
        return text.lower()
    return "".join("i" if c == "\u0130" else c.lower() for c in text)  # the one that would grow


def _between(field: Field, low: Any, high: Any) -> Both:
    return Both(
        items=(
            Test(field=field, how=How.GREATER_OR_EQUAL, value=low),
            Test(field=field, how=How.LESS_OR_EQUAL, value=high),
        )
    )


def _pair(value: Any, where: str) -> Sequence[Any]:
    if not isinstance(value, list) or len(value) != 2:
        raise _wrong(where, "must be a list of two for operator Between, both ends included")
    return value


def _flag(query: dict[str, Any], name: str, where: str) -> bool:
    value = query.get(name)
    if value is None or isinstance(value, bool):
        return bool(value)
    raise _wrong(f"{where}.{name}", "must be true or false")


def _wrong(where: str, what: str) -> Refused:
    return Refused("errQueryInvalid", f"'{where}' {what}.", where)


def _too_much(where: str, what: str, limit: int) -> Refused:
    return Refused("errQueryTooLarge", f"'{where}' {what}.", where, limit)
