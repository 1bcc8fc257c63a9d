"""POST /api/sql: one SELECT over the views of docs/sql.md, for whoever may look."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Protocol

from fastapi import APIRouter
from fastapi.routing import APIRoute
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import Request
from starlette.responses import Response

from projections.api.answers import JSON
from projections.sql_policy import STATEMENT_CHARACTERS_MAX

ROWS_MAX = 100_000  # of one answer
RETRY_S = "2"


class SqlAsked(BaseModel):
    """A question in SQL."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    sql: str = Field(
        max_length=STATEMENT_CHARACTERS_MAX,
        description="One SELECT over the views of docs/sql.md, in DuckDB's dialect.",
        examples=["SELECT kind, count(*) AS n FROM orders GROUP BY kind"],
    )
    rows_max: int = Field(
        1000, ge=1, le=ROWS_MAX, alias="maxRows", description="Rows to answer at most."
    )


class SqlColumnShown(BaseModel):
    """A column of the answer."""

    name: str = Field(description="As the statement names it.")
    type: str = Field(description="DuckDB's type.")


class SqlReply(BaseModel):
    """Rows, in the order of the columns."""

    columns: list[SqlColumnShown] = Field(description="Names and types.")
    rows: list[list[Any]] = Field(description="Values; times are ISO 8601 in UTC.")
    cut: bool = Field(description="There were more rows.")
    position: int = Field(description="Newest event that the answer knows.")


class Answered(Protocol):
    """What whoever runs the statement gives."""

    @property
    def status(self) -> int:
        """HTTP status."""

    @property
    def position(self) -> int:
        """Position as of which it is."""

    @property
    def body(self) -> bytes:
        """A SqlReply, or an ErrorBody, as JSON."""


Ask = Callable[[str, int], Awaitable[Answered]]  # statement, most rows


def router(ask: Ask, route_class: type[APIRoute]) -> APIRouter:
    """Give the route; `ask` runs statements where they can do no harm."""
    made = APIRouter(route_class=route_class, tags=["ledger"])

    @made.post("/api/sql", response_model=SqlReply)
    async def sql(request: Request, body: SqlAsked) -> Response:
        """Answer one SELECT over orders, steps, events, robots and what is derived of them.

        It knows every event that was on disk when it came. It ends when its time is up, and when
        its client hangs up.
        """
        asking = asyncio.ensure_future(ask(body.sql, body.rows_max))
        leaving = asyncio.ensure_future(_left(request))
        try:
            await asyncio.wait((asking, leaving), return_when=asyncio.FIRST_COMPLETED)
            if not asking.done():
                asking.cancel()
                await asyncio.wait((asking,))
                return Response(status_code=499)  # nobody reads it
            answered = asking.result()
        finally:
            leaving.cancel()
            asking.cancel()
        headers = {"X-Ledger-Position": str(answered.position), "Cache-Control": "no-store"}
        if answered.status == 503:
            headers["Retry-After"] = RETRY_S
        return Response(answered.body, answered.status, headers, media_type=JSON)

    return made


async def _left(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
