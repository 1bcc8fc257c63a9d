"""Conditions and sortings as DuckDB SQL: our own column names, and every value a parameter."""

from collections.abc import Sequence
from typing import Any, assert_never

from projections.fields import ID, Field, FieldType
from projections.order_keys import key_of
from projections.query import Both, Condition, Either, How, Not, Test
from projections.sorting import Key

FEW = 50  # so many choices of an In are spelt out, where DuckDB skips by minima and maxima

_COMPARE = (How.EQUAL, How.LESS, How.LESS_OR_EQUAL, How.GREATER, How.GREATER_OR_EQUAL)
_TEXT = {
    How.CONTAIN: "contains({}, ?)",
    How.CONTAIN_FOLDED: "contains(lower({}), ?)",
    How.START: "starts_with({}, ?)",
    How.END: "suffix({}, ?)",
}


def where(condition: Condition) -> tuple[str, list[Any]]:
    """Give the SQL of a condition and its parameters.

    Only below NOT can SQL's unknown become true, so only there is it turned into false.
    """
    parameters: list[Any] = []
    return _sql(condition, parameters), parameters


def order_by(keys: Sequence[Key], *, by_id_key: bool = False) -> str:
    """Give the ORDER BY list: nulls last either way, text by code point.

    Integers stand for ids where all have one: they sort alike, and faster.
    """
    return ", ".join(
        ("id_key" if by_id_key and key.field is ID else column(key.field))
        + (" DESC NULLS LAST" if key.descending else " ASC NULLS LAST")
        for key in keys
    )


def column(field: Field) -> str:
    """Quote the column of a field; it is one of our own names, never a client's."""
    return f'"{field.column}"'


def _sql(condition: Condition, parameters: list[Any]) -> str:
    match condition:
        case Both(items=items):
            return _joined(items, " AND ", "true", parameters)
        case Either(items=items):
            return _joined(items, " OR ", "false", parameters)
        case Not(item=item):
            return f"NOT coalesce({_sql(item, parameters)}, false)"
        case Test(field=field) if field.type is FieldType.TEXTS:
            return _list_test(condition, column(field), parameters)
        case Test(field=field):
            return _test(condition, column(field), parameters)
        case _:
            assert_never(condition)


def _joined(items: Sequence[Condition], word: str, of_nothing: str, parameters: list[Any]) -> str:
    if not items:
        return of_nothing
    return "(" + word.join(_sql(item, parameters) for item in items) + ")"


def _test(test: Test, name: str, parameters: list[Any]) -> str:
    if test.how is How.NULL:
        return f"{name} IS NULL"
    if test.how is How.EMPTY:
        return f"({name} IS NULL OR {name} = '')"
    if test.other is not None:
        return f"{name} {test.how.value} {column(test.other)}"
    if test.how is How.IN:
        return _in(test, name, parameters)
    if test.field is ID and test.how is How.EQUAL and (key := key_of(test.value)) is not None:
        parameters += (key.key, test.value)
        return f"(id_key = ? AND {name} = ?)"
    parameters.append(test.value)
    if test.how in _COMPARE:
        return f"{name} {test.how.value} ?"
    return _TEXT[test.how].format(name)


def _in(test: Test, name: str, parameters: list[Any]) -> str:
    if not test.value:
        return "false"
    if len(test.value) <= FEW:
        parameters.extend(test.value)
        return f"{name} IN ({', '.join('?' * len(test.value))})"
    parameters.append(list(test.value))
    return f"{name} IN (SELECT unnest(?))"


def _list_test(test: Test, name: str, parameters: list[Any]) -> str:
    if test.how is How.NULL:
        return f"{name} IS NULL"
    if test.how is How.EMPTY:
        return f"({name} IS NULL OR len({name}) = 0)"
    if test.how is How.IN:
        parameters.append(list(test.value))
        return f"list_has_any({name}, ?::VARCHAR[])"
    parameters.append(test.value)
    if test.how is How.EQUAL:
        return f"list_contains({name}, ?)"
    return f"len(list_filter({name}, lambda x: {_TEXT[test.how].format('x')})) > 0"
