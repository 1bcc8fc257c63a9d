"""Conditions as Python functions over live orders, with the same answers as the SQL."""

import operator
from collections.abc import Callable
from typing import Any, TypeAlias, assert_never

from ledger.state import Order
from projections.fields import FieldType
from projections.query import Both, Condition, Either, How, Not, Test, folded

Predicate: TypeAlias = Callable[[Order, str], bool]  # order, name of its scene

_COMPARE: dict[How, Callable[[Any, Any], bool]] = {
    How.EQUAL: operator.eq,
    How.LESS: operator.lt,
    How.LESS_OR_EQUAL: operator.le,
    How.GREATER: operator.gt,
    How.GREATER_OR_EQUAL: operator.ge,
    How.IN: lambda value, choices: value in choices,
    How.CONTAIN: lambda text, part: part in text,
    How.CONTAIN_FOLDED: lambda text, part: part in folded(text),
    How.START: lambda text, part: text.startswith(part),
    How.END: lambda text, part: text.endswith(part),
}


def predicate(condition: Condition) -> Predicate:
    """Give the function that says whether an order meets the condition."""
    match condition:
        case Both(items=items):
            parts = [predicate(item) for item in items]
            return lambda order, scene: all(part(order, scene) for part in parts)
        case Either(items=items):
            parts = [predicate(item) for item in items]
            return lambda order, scene: any(part(order, scene) for part in parts)
        case Not(item=item):
            part = predicate(item)
            return lambda order, scene: not part(order, scene)
        case Test():
            return _test(condition)
        case _:
            assert_never(condition)


def _test(test: Test) -> Predicate:
    read = test.field.read
    if test.how is How.NULL:
        return lambda order, scene: read(order, scene) is None
    if test.how is How.EMPTY:
        return lambda order, scene: not read(order, scene)
    compare = _COMPARE[test.how]
    if test.other is not None:
        other = test.other.read
        return lambda order, scene: _both_known(compare, read(order, scene), other(order, scene))
    value = frozenset(test.value) if test.how is How.IN else test.value
    if test.field.type is FieldType.TEXTS:
        return lambda order, scene: any(
            compare(element, value) for element in read(order, scene) or ()
        )
    return lambda order, scene: _both_known(compare, read(order, scene), value)


def _both_known(compare: Callable[[Any, Any], bool], one: Any, other: Any) -> bool:
    return one is not None and other is not None and compare(one, other)
