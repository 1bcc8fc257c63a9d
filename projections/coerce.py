"""Values of queries, read by the type of the column: `"true"` for a boolean, dates as text.

A date without an offset is UTC, and so are days and weeks. A time alone is of today.
"""

import math
import re
from datetime import UTC, datetime
from typing import Any

from ledger.errors import Refused
from ledger.scene import Value
from projections.fields import FieldType

DAY_MS = 86_400_000
TEXT_LENGTH_MAX = 10_000  # characters of one value
INTEGER_MAX = 2**63 - 1

_BARE_DATE = re.compile(r"\d{4}[-/]\d{2}[-/]\d{2}")
_TIME = re.compile(r"\d{2}:\d{2}:\d{2}")
_INSTANT = re.compile(
    r"\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}(:\d{2}([.,]\d{1,9})?)?(Z|[+-]\d{2}(:?\d{2})?)?"
)


class Clock(Value, frozen=True, kw_only=True):
    """The moment of the request."""

    now_ms: int


def coerce(type_: FieldType, value: object, where: str, clock: Clock) -> Any:
    """Read a value as this type; raises Refused that names the place and what is expected."""
    if isinstance(value, str) and len(value) > TEXT_LENGTH_MAX:
        raise _refused(where, f"at most {TEXT_LENGTH_MAX} characters", value[:50] + "…")
    match type_:
        case FieldType.TEXT | FieldType.TEXTS:
            if isinstance(value, str):
                return value
            if isinstance(value, int) and not isinstance(value, bool):
                return str(value)  # clients that keep their numbers as numbers
            raise _refused(where, "a text", value)
        case FieldType.BOOLEAN:
            return _boolean(value, where)
        case FieldType.INTEGER:
            return _integer(value, where)
        case FieldType.NUMBER:
            return _number(value, where)
        case FieldType.DATE:
            return date_ms(value, where, clock)


def upper_end(type_: FieldType, value: object, where: str, clock: Clock) -> Any:
    """Read the upper end of a closed range: a bare date there counts to the end of that day."""
    end = coerce(type_, value, where, clock)
    if type_ is FieldType.DATE and isinstance(value, str) and _BARE_DATE.fullmatch(value.strip()):
        return end + DAY_MS - 1
    return end


def date_ms(value: object, where: str, clock: Clock) -> int:
    """Read a date: epoch milliseconds, also as text, or one of the formats of M4."""
    expected = "epoch milliseconds or a date like 2026-01-31, 2026-01-31 07:30 or ISO 8601"
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return _integer(value, where)
    if not isinstance(value, str):
        raise _refused(where, expected, value)
    text = value.strip()
    if re.fullmatch(r"-?\d{5,}", text):
        return _integer(text, where)
    try:
        if _TIME.fullmatch(text):
            hours, minutes, seconds = map(int, text.split(":"))
            if hours < 24 and minutes < 60 and seconds < 60:
                return day_start_ms(clock.now_ms) + ((hours * 60 + minutes) * 60 + seconds) * 1000
        elif _BARE_DATE.fullmatch(text) or _INSTANT.fullmatch(text):
            moment = datetime.fromisoformat(text.replace("/", "-").replace(",", "."))
            if moment.tzinfo is None:
                moment = moment.replace(tzinfo=UTC)
            return _epoch_ms(moment)
    except (ValueError, OverflowError):
        pass  # a date that no calendar has
    raise _refused(where, expected, value)


def day_start_ms(at_ms: int) -> int:
    """Give the first millisecond of the day, UTC."""
    return at_ms - at_ms % DAY_MS


def _epoch_ms(moment: datetime) -> int:
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    return since.days * DAY_MS + since.seconds * 1000 + since.microseconds // 1000


def _boolean(value: object, where: str) -> bool:
    if isinstance(value, bool):
        return value
    if isinstance(value, str) and value.lower() in ("true", "false"):
        return value.lower() == "true"
    raise _refused(where, "true or false", value)


def _integer(value: object, where: str) -> int:
    number = _finite(value)
    if number is None or number != int(number) or abs(int(number)) > INTEGER_MAX:
        raise _refused(where, "a whole number of 64 bits", value)
    return int(number)


def _number(value: object, where: str) -> float:
    number = _finite(value)
    try:
        return float(number)  # type: ignore[arg-type]
    except (TypeError, OverflowError):
        raise _refused(where, "a number", value) from None


def _finite(value: object) -> int | float | None:
    if isinstance(value, bool):
        return None
    if isinstance(value, str):
        try:
            return int(value)
        except ValueError:
            pass
        try:
            value = float(value)
        except ValueError:
            return None
    if isinstance(value, int):
        return value
    return value if isinstance(value, float) and math.isfinite(value) else None


def _refused(where: str, expected: str, value: object) -> Refused:
    return Refused("errValueInvalid", f"'{where}' must be {expected}, not {value!r}.", where)
