"""Order ids as integers, whose order is that of the ids as text.

Ids are `TO<yyyymmdd>-<6 to 9 digits>` and a letter for the system's own orders. Of text DuckDB
compares the first eight characters when it looks which blocks it may skip, and those are the same
for a month; of integers it compares all, and reads them ten times as fast (measured).
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import date, timedelta
from functools import lru_cache

import duckdb

from ledger.scene import Value

MARKS = "0123456789ACP"  # all that stands behind the hyphen, in order: 1 … 13, and 0 is the end
BASE = len(MARKS) + 1
PLACES = 10  # nine digits and a letter
# a number of more digits than six does not begin with zero, so each has one text
_ID = re.compile(r"TO([0-9]{8})-([0-9]{6}|[1-9][0-9]{6,8})([ACP]?)")

_PART_OF_DAY = re.compile(r"t?o?[0-9]{0,8}", re.ASCII)
_PART_OF_NUMBER = re.compile(r"([0-9]*)([acp]?)", re.ASCII)
_DIGITS = "CASE WHEN n < 1000000 THEN lpad(n::VARCHAR, 6, '0') ELSE n::VARCHAR END"
_NUMBERS = "SELECT n FROM range(?) numbers(n) WHERE {}({}, ?)"
DAYS_MAX = 40_000  # in the span of a history; what is longer has ids of other systems

Sql = tuple[str, list[object]]


class OrderKey(Value, frozen=True, kw_only=True):
    """An id of our pattern: `key` is the whole of it, the others are its parts."""

    key: int
    day: int  # yyyymmdd
    number: int


@lru_cache(maxsize=4096)  # the events of an order come close to each other
def key_of(id_: str) -> OrderKey | None:
    """Read an id; None where it is not of our pattern.

    The day counts most, then mark by mark what stands behind the hyphen, as text is compared.
    """
    found = _ID.fullmatch(id_)
    if found is None:
        return None
    day, digits, letter = found[1], found[2], found[3]
    with suppress(ValueError):  # no day of the calendar
        key = _date(int(day)).toordinal()
        for place in range(PLACES):
            mark = (digits + letter)[place : place + 1]
            key = key * BASE + (MARKS.index(mark) + 1 if mark else 0)
        return OrderKey(key=key, day=int(day), number=int(digits))
    return None


def id_of(key: int) -> str:
    """Give the id back."""
    marks = ""
    for _ in range(PLACES):
        key, mark = divmod(key, BASE)
        marks = (MARKS[mark - 1] if mark else "") + marks
    day = date.fromordinal(key)
    return f"TO{day.year:04}{day.month:02}{day.day:02}-{marks}"


def was_made(counts: Mapping[str, int], id_: str) -> bool:
    """Tell whether an order with this id may ever have been made, by the days' counts."""
    key = key_of(id_)
    return key is not None and 1 <= key.number <= counts.get(str(key.day), 0)


def contains(cursor: duckdb.DuckDBPyConnection, part: str) -> Sql:
    """Give the SQL that finds a part, in small letters, in the ids of our pattern.

    A part lies in the day, in the number, or in both with the hyphen between them. So it is looked
    for among the few days and numbers there are, and the orders are searched for integers.
    """
    spans = "SELECT min(id_day), max(id_day), max(id_number) FROM orders_done"
    first, last, number_max = cursor.execute(spans).fetchone() or (None, None, None)
    if first is None or not part:
        return ("id_key IS NOT NULL", [])
    days = list(_days(first, last))
    ways: list[Sql] = []
    before, hyphen, behind = part.partition("-")
    if hyphen:
        in_days = [day for day in days if f"to{day}".endswith(before)]
        in_number = _number(cursor, behind, "starts_with", number_max, part)
        if in_number is not None:
            sql, parameters = _one_of(in_days, len(days))
            ways.append((f"({sql} AND {in_number[0]})", [*parameters, *in_number[1]]))
    else:
        if _PART_OF_DAY.fullmatch(part):
            ways.append(_one_of([day for day in days if part in f"to{day}"], len(days)))
        in_number = _number(cursor, part, "contains", number_max, part)
        if in_number is not None:
            ways.append(in_number)
    ways = [way for way in ways if way[0] != "false"]
    if any(sql == "true" for sql, _ in ways):
        return ("id_key IS NOT NULL", [])
    if not ways:
        return ("false", [])
    joined = " OR ".join(sql for sql, _ in ways)
    return (f"({joined})", [value for _, values in ways for value in values])


def _number(
    cursor: duckdb.DuckDBPyConnection, text: str, how: str, number_max: int, part: str
) -> Sql | None:
    """Find the numbers with a text at the place that `how` says; None where none can have it."""
    found = _PART_OF_NUMBER.fullmatch(text)
    if found is None:
        return None
    digits, letter = found[1], found[2]
    if not digits and not letter:
        return ("true", [])
    # found once, for the page and for the count; a letter stands at the end, so do those before it
    numbers = cursor.execute(
        _NUMBERS.format("suffix" if letter else how, _DIGITS), [number_max + 1, digits]
    )
    values: list[object] = [[n for (n,) in numbers.fetchall()]]
    sql = "id_number IN (SELECT unnest(?))"
    if letter:
        return (f"({sql} AND contains(lower(id), ?))", [*values, part])
    return (sql, values)


def _one_of(days: list[int], of: int) -> Sql:
    if len(days) == of:
        return ("true", [])
    if not days:
        return ("false", [])
    return ("id_day IN (SELECT unnest(?))", [days])


def _days(first: int, last: int) -> Iterator[int]:
    day, end = _date(first), _date(last)
    for _ in range(DAYS_MAX):
        yield day.year * 10_000 + day.month * 100 + day.day
        if day >= end:
            return
        day += timedelta(days=1)


def _date(day: int) -> date:
    return date(day // 10_000, day // 100 % 100, day % 100)
