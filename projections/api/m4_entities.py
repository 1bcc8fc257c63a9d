"""M4's generic questions about orders: find/many, page, one, count and batch (spec/m4.md §2)."""

from collections.abc import AsyncIterator
from typing import Annotated, Any, TypeVar

import msgspec
from fastapi import APIRouter, Query
from pydantic import Field as Documented
from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from ledger.errors import Refused
from projections.api.answers import (
    JSON,
    ORDERS_AGE_S_MAX,
    answered,
    moment,
    parsed,
    sharing,
)
from projections.api.m4_answers import (
    FindCountResult,
    FindOneResult,
    FindPageResult,
    TransportOrder,
)
from projections.api.m4_models import (
    BATCH_MAX,
    Asking,
    AsOf,
    CountAsked,
    Entry,
    ManyAsked,
    OneAsked,
    PageAsked,
    RowsAsked,
)
from projections.api.m4_scene_query import SceneQueries
from projections.fields import SHOWN, Field, Row
from projections.find import ROWS_MAX, SKIP_MAX, Asked, Find
from projections.query import Asker, Condition, How, Test, field_named, parse
from projections.reading import CHUNK_ROWS
from projections.shared import Shared
from projections.sorting import parse_sort

ENTITIES = ("TransportOrder",)
BATCH_ROWS_MAX = 10_000  # of all answers of one batch together

Body = TypeVar("Body", bound=Asking)


def entity_routes(made: APIRouter, queries: SceneQueries) -> None:
    """Add the calls."""
    _many(made, queries.find, queries.shared)
    _single(made, queries.find, queries.shared)
    _batch(made, queries.find)


def _many(made: APIRouter, find: Find, shared: Shared | None) -> None:
    @made.post("/api/entity/find/many", response_model=list[TransportOrder])
    async def many(request: Request, query: Annotated[AsOf, Query()], body: ManyAsked) -> Response:
        """Give all orders that meet the query, as a bare array; without steps."""
        asked, at_ms = _asked(request, body, find), moment(request, query, body)
        skip, limit = _skip(body.skip), _limit(body.limit)
        if limit is None or limit > CHUNK_ROWS:
            probe = await find.some(asked, skip, CHUNK_ROWS + 1, at_ms)
            if probe.total > CHUNK_ROWS:
                position, chunks = await find.every(asked, skip, limit, at_ms)
                headers = {"X-Ledger-Position": str(position)}
                return StreamingResponse(_array(chunks), media_type=JSON, headers=headers)
            return answered(probe.rows, probe.position)

        async def fresh() -> Response:
            found = await find.some(asked, skip, limit, at_ms)
            return answered(found.rows, found.position)

        return await sharing(shared, request, ORDERS_AGE_S_MAX, fresh)

    @made.post("/api/entity/find/page", response_model=FindPageResult)
    async def page(request: Request, query: Annotated[AsOf, Query()], body: PageAsked) -> Response:
        """Give one page of the orders that meet the query, and how many there are."""

        async def fresh() -> Response:
            return answered(*await _page(request, find, body, moment(request, query, body)))

        return await sharing(shared, request, ORDERS_AGE_S_MAX, fresh)


def _single(made: APIRouter, find: Find, shared: Shared | None) -> None:
    @made.post("/api/entity/find/one", response_model=FindOneResult)
    async def one(request: Request, query: Annotated[AsOf, Query()], body: OneAsked) -> Response:
        """Give the order with this id, or the first that meets the query; null if none does."""

        async def fresh() -> Response:
            return answered(*await _one(request, find, body, moment(request, query, body)))

        return await sharing(shared, request, ORDERS_AGE_S_MAX, fresh)

    @made.post("/api/entity/find/count", response_model=FindCountResult)
    async def count(
        request: Request, query: Annotated[AsOf, Query()], body: CountAsked
    ) -> Response:
        """Count the orders that meet the query."""
        asked = Asked(condition=_condition(request, body, find), fuzzy=body.fuzzy)
        at_ms = moment(request, query, body)

        async def fresh() -> Response:
            number, position = await find.count(asked, at_ms)
            return answered({"count": number}, position)

        return await sharing(shared, request, ORDERS_AGE_S_MAX, fresh)


def _batch(made: APIRouter, find: Find) -> None:
    @made.post(
        "/api/entity/find/batch",
        response_model=list[FindOneResult | FindPageResult | list[TransportOrder]],
    )
    async def batch(
        request: Request,
        query: Annotated[AsOf, Query()],
        body: Annotated[list[Entry], Documented(max_length=BATCH_MAX)],
    ) -> Response:
        """Answer several find/one, find/many and find/page in their order, or refuse them all."""
        common = moment(request, query)
        replies: list[Any] = []
        left, oldest = BATCH_ROWS_MAX, None
        for number, entry in enumerate(body):
            try:
                reply, rows, position = await _entry(request, find, entry, common, left)
            except Refused as trouble:
                raise _of_entry(number, trouble) from None
            except ValidationError as trouble:
                raise _moved(number, trouble) from None
            replies.append(reply)
            left -= rows
            oldest = position if oldest is None else min(oldest, position)
        return answered(replies, find.live.position if oldest is None else oldest)


async def _entry(
    request: Request, find: Find, entry: Entry, common: int | None, left: int
) -> tuple[Any, int, int]:
    """Answer one entry of a batch; gives reply, number of rows, position."""
    if entry.type == "One":
        one = _body(OneAsked, entry)
        reply, position = await _one(request, find, one, _own_moment(one, common))
        return reply, 1, position
    if entry.type == "Page":
        page = _body(PageAsked, entry)
        if page.page_size > left:
            raise _too_many_rows()
        reply, position = await _page(request, find, page, _own_moment(page, common))
        return reply, len(reply["page"]), position
    many = _body(ManyAsked, entry)
    asked, limit = _asked(request, many, find), _limit(many.limit)
    wanted = left + 1 if limit is None else min(limit, left + 1)
    found = await find.some(asked, _skip(many.skip), wanted, _own_moment(many, common))
    if found.total > left:
        raise _too_many_rows()
    return found.rows, found.total, found.position


def _body(model: type[Body], entry: Entry) -> Body:
    return model.model_validate(entry.req)


def _own_moment(body: CountAsked, common: int | None) -> int | None:
    return common if body.as_of is None else parsed(body.as_of)


def _too_many_rows() -> Refused:
    words = f"All answers of a batch may have {BATCH_ROWS_MAX} rows together: set 'limit'."
    return Refused("errTooManyRows", words, BATCH_ROWS_MAX)


def _of_entry(number: int, trouble: Refused) -> Refused:
    """Name the entry in a refusal; it keeps its code and its status."""
    named = Refused(trouble.code, f"[{number}].req: {trouble.message}", *trouble.arguments)
    named.status = trouble.status
    return named


def _moved(number: int, trouble: ValidationError) -> Refused:
    fault = trouble.errors()[0]
    where = ".".join([f"[{number}]", "req", *(str(part) for part in fault["loc"])])
    if fault["type"] == "missing":
        return Refused("errFieldMissing", f"Field '{where}' is required and missing.", where)
    words = fault["msg"].removeprefix("Value error, ")
    return Refused("errFieldInvalid", f"Field '{where}' is wrong: {words}.", where)


async def _one(request: Request, find: Find, body: OneAsked, at_ms: int | None) -> tuple[Row, int]:
    asked = _asked(request, body, find)
    if body.id is not None:
        by_id = Test(field=field_named("id", "id"), how=How.EQUAL, value=body.id)
        asked = msgspec.structs.replace(asked, condition=by_id)
    found = await find.some(asked, _skip(body.skip), 1, at_ms)
    value = found.rows[0] if found.rows else None
    return {"entityValue": value}, found.position


async def _page(
    request: Request, find: Find, body: PageAsked, at_ms: int | None
) -> tuple[Row, int]:
    asked = _asked(request, body, find)
    skip = _skip((body.page_no - 1) * body.page_size)
    found = await find.page(asked, skip, body.page_size, at_ms)
    answer: Row = {
        "pageNo": body.page_no,
        "pageSize": body.page_size,
        "total": found.total,
        "page": found.rows,
    }
    return answer, found.position


def _asked(request: Request, body: RowsAsked, find: Find) -> Asked:
    return Asked(
        condition=_condition(request, body, find),
        fuzzy=body.fuzzy,
        fields=_projection(body.projection),
        sort=parse_sort(body.sort),
    )


def _condition(request: Request, body: CountAsked, find: Find) -> Condition:
    if body.entity_name not in ENTITIES:
        raise Refused(
            "errEntityUnknown",
            f"Field 'entityName': there is no entity '{body.entity_name[:100]}'; "
            f"there is {', '.join(ENTITIES)}.",
            body.entity_name[:100],
        )
    return parse(body.query, Asker(user=request.state.user, now_ms=find.now_ms()))


def _projection(names: list[str] | None) -> tuple[Field, ...]:
    if not names:
        return SHOWN
    fields = [field_named(name, f"projection[{n}]") for n, name in enumerate(names)]
    return tuple(dict.fromkeys(fields))


def _skip(skip: int | None) -> int:
    if skip is not None and skip > SKIP_MAX:
        raise Refused("errSkipTooLarge", f"At most {SKIP_MAX} rows can be skipped.", SKIP_MAX)
    return max(0, skip or 0)


def _limit(limit: int | None) -> int | None:
    if limit is not None and limit > ROWS_MAX:
        raise Refused("errLimitTooLarge", f"'limit' may be {ROWS_MAX}, or null.", ROWS_MAX)
    return None if limit is None or limit < 0 else limit


async def _array(chunks: AsyncIterator[list[Row]]) -> AsyncIterator[bytes]:
    """Encode rows as one JSON array, chunk by chunk."""
    before: Any = b"["
    async for chunk in chunks:
        yield before + msgspec.json.encode(chunk)[1:-1]
        before = b","
    yield b"[]" if before == b"[" else b"]"
