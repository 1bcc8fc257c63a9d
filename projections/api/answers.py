"""What all questions of the read side share: the moment they ask of, and how they are answered."""

from typing import Protocol

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from ledger.moment import parse_time
from projections.api.m4_models import AsOf

JSON = "application/json"


class OfAMoment(Protocol):
    """A body that may name a moment."""

    @property
    def as_of(self) -> int | str | None:
        """Epoch milliseconds, ISO 8601, or None for now."""


def moment(request: Request, query: AsOf, body: OfAMoment | None = None) -> int | None:
    """Read the past moment that is asked for, wherever it stands; None = now."""
    asked = query.as_of or (None if body is None else body.as_of) or request.headers.get("asOf")
    return parsed(asked)


def parsed(as_of: int | str | None) -> int | None:
    """Read a moment; None = now."""
    return None if as_of is None else parse_time(str(as_of))


def answered(body: object, position: int) -> Response:
    """Answer JSON, and the position at which it is so."""
    headers = {"X-Ledger-Position": str(position)}
    return Response(msgspec.json.encode(body), media_type=JSON, headers=headers)
