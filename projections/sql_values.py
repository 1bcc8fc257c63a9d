"""Values of DuckDB as JSON can hold them."""

import math
from datetime import date, datetime, time
from decimal import Decimal
from typing import Any

import pyarrow as pa

# what Python's own types cannot hold (year 290000, nanoseconds) comes as Arrow writes it
_TOO_LARGE = (OverflowError, ValueError, pa.ArrowInvalid, pa.ArrowNotImplementedError)


def plain_column(column: pa.Array) -> list[Any]:
    """Give the values of a column, safe for JSON."""
    try:
        values = column.to_pylist()
    except _TOO_LARGE:
        values = _as_text(column)
    kind = column.type
    if pa.types.is_integer(kind) or pa.types.is_string(kind) or pa.types.is_boolean(kind):
        return list(values)
    return [plain(value) for value in values]


def _as_text(column: pa.Array) -> list[Any]:
    try:
        return list(column.cast(pa.string()).to_pylist())
    except _TOO_LARGE:  # nested: value by value, for one is to blame
        return [_one_as_text(value) for value in column]


def _one_as_text(value: pa.Scalar) -> Any:
    try:
        return value.as_py()
    except _TOO_LARGE:
        return "out of range"


def plain(value: Any) -> Any:
    """Give one value as JSON can hold it: no NaN, times in UTC, whole numbers as such."""
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return value if math.isfinite(value) else None
        case Decimal():
            return _number(value)
        case datetime():
            text = value.replace(tzinfo=None).isoformat()
            return f"{text}Z"  # the database's zone is UTC
        case date() | time():
            return value.isoformat()
        case bytes():
            return value.hex()
        case pa.MonthDayNano():
            return _duration(value)
        case dict():
            return {str(key): plain(one) for key, one in value.items()}
        case list() if value and all(isinstance(one, tuple) for one in value):  # a map
            return {str(plain(key)): plain(one) for key, one in value}
        case list() | tuple():
            return [plain(one) for one in value]
        case _:
            return str(value)


def _number(value: Decimal) -> int | float | str:
    if value == value.to_integral_value():
        return int(value)
    near = float(value)
    return near if Decimal(repr(near)) == value else str(value)


def _duration(value: "pa.MonthDayNano") -> str:
    """Write an interval as ISO 8601 does; its parts have signs of their own."""
    seconds = Decimal(value.nanoseconds) / 1_000_000_000
    return f"P{value.months}M{value.days}DT{seconds.normalize():f}S"
