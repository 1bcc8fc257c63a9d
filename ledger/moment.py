"""A past moment, as clients and people name it: a time, or a position in the ledger."""

import re
from datetime import UTC, datetime

from ledger.errors import Refused
from ledger.scene import Value

TIME_MS_MAX = 253_402_300_799_999  # the end of year 9999

# a plus sign of a zone that nobody encoded arrives as a space
_LOST_PLUS = re.compile(r"(T\S+) (\d\d:?\d\d)$")


class At(Value, frozen=True, kw_only=True):
    """After the event at `position`, or after all events up to `at_ms`; both None = now."""

    position: int | None = None
    at_ms: int | None = None


def parse_time(text: str, field: str = "asOf") -> int:
    """Read epoch milliseconds, or an ISO 8601 time (UTC where it names no zone).

    Raises Refused, naming the field.
    """
    text = text.strip()
    if text.isdecimal() and len(text) <= 20:  # int() itself refuses thousands of digits
        at_ms = int(text)
    else:
        try:
            moment = datetime.fromisoformat(_LOST_PLUS.sub(r"\1+\2", text))
        except ValueError:
            words = f"Field '{field}' is wrong: '{text[:40]}' is neither epoch milliseconds nor an"
            raise Refused(
                "errFieldInvalid", f"{words} ISO 8601 time like 2026-11-22T10:30:00Z.", field
            ) from None
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        at_ms = round(moment.timestamp() * 1000)
    if not 0 <= at_ms <= TIME_MS_MAX:
        words = f"Field '{field}' is wrong: '{text[:40]}' lies outside the years 1970 to 9999."
        raise Refused("errFieldInvalid", words, field)
    return at_ms


def parse_position(text: str, field: str = "position") -> int:
    """Read a position of the ledger; raises Refused, naming the field."""
    if not text.isdecimal() or len(text) > 18:
        words = f"Field '{field}' is wrong: '{text[:40]}' is no position of the ledger."
        raise Refused("errFieldInvalid", words, field)
    return int(text)


def time_text(at_ms: int) -> str:
    """Write a time as ISO 8601 in UTC, to the millisecond."""
    moment = datetime.fromtimestamp(at_ms // 1000, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{at_ms % 1000:03d}Z"
