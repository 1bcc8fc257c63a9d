"""What all questions of the read side share: the moment they ask of, and how they are answered."""

from collections.abc import Awaitable, Callable
from typing import Protocol

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from ledger.moment import parse_time
from projections.api.m4_models import AsOf
from projections.shared import Shared

JSON = "application/json"
QUESTION_BYTES_MAX = 4_096  # longer ones are hardly asked twice
ORDERS_AGE_S_MAX = 1.0  # of a shared answer about orders: nothing changes them but events
ROBOTS_AGE_S_MAX = 0.05  # about robots, which report between events


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


async def sharing(
    shared: Shared | None,
    request: Request,
    age_s_max: float,
    make: Callable[[], Awaitable[Response]],
) -> Response:
    """Answer a question that the same caller or another one like it may be asking just now."""
    body = await request.body()
    if shared is None or len(body) > QUESTION_BYTES_MAX:
        return await make()
    scope = request.scope
    as_of = request.headers.get("asOf")
    question = (scope["path"], scope["query_string"], body, request.state.user, as_of)
    return await shared.give(question, age_s_max, make)
