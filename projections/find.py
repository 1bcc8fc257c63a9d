"""Find: live orders from memory and ended ones from DuckDB as one answer, now or at any moment.

Correct by a simple rule: a `Moment` has every order that is live at its position and every one that
ended behind `history_position`; DuckDB has every one that ended until then, and is asked for no
more. So none is missing and none comes twice, however far DuckDB has got meanwhile.
"""

from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from functools import partial
from typing import Any, TypeAlias, TypeVar

import duckdb

from ledger.errors import Refused
from ledger.ids import OrderId
from ledger.scene import Value
from ledger.state import Fleet, Order
from projections.condition_python import predicate
from projections.ended import can_match
from projections.ended_rows import Ended, ended_order
from projections.fields import CREATED, ID, SHOWN, Field, Row, row
from projections.live import Live, Moment
from projections.order_keys import was_made
from projections.query import ALL, Condition, folded
from projections.reading import CHUNK_ROWS, Reader, Select
from projections.sorting import Key, Rank, rank

ROWS_MAX = 1_000_000  # of one answer without a limit
SKIP_MAX = 10_000_000

T = TypeVar("T")
NEWEST_FIRST = (Key(field=CREATED, descending=True), Key(field=ID))

At: TypeAlias = int  # epoch milliseconds


class Asked(Value, frozen=True, kw_only=True):
    """A query, read and checked."""

    condition: Condition = ALL
    fuzzy: str | None = None  # part of the order id, in any case of letters
    fields: tuple[Field, ...] = SHOWN
    sort: tuple[Key, ...] = (Key(field=ID),)


class Page(Value, frozen=True, kw_only=True):
    """Some of the rows, and how many there are."""

    rows: tuple[Row, ...]
    total: int
    position: int


class _Ranked(Value, frozen=True, kw_only=True):
    rank: Rank
    row: Callable[[], Row]  # made for those that are shown


class Find:
    """many, page, one and count over all orders there ever were."""

    def __init__(
        self,
        live: Live,
        reader: Reader,
        moment: Callable[[At], Fleet],
        now_ms: Callable[[], int],
    ) -> None:
        """Take the present, DuckDB, the past (slow: called in a thread), and the clock."""
        self.live = live
        self.now_ms = now_ms
        self._reader = reader
        self._moment = moment

    async def fleet(self, at_ms: At | None) -> Fleet:
        """Give the state that queries see, or that of a past moment; do not change it."""
        if at_ms is None:
            return self.live.fleet
        self._check(at_ms)
        fleet = await self._reader.beside(lambda: self._moment(at_ms))
        await self.live.wait(fleet.position)  # the disk may be ahead of what queries see
        return fleet

    async def moment(self, at_ms: At | None) -> Moment:
        """View all orders as they are, or as they were."""
        return self.live.now() if at_ms is None else self.live.past(await self.fleet(at_ms))

    async def beside(self, work: Callable[[], T]) -> T:
        """Do slow reading of other files in a thread."""
        return await self._reader.beside(work)

    def _check(self, at_ms: At) -> None:
        if at_ms > self.now_ms():
            raise Refused("errAsOfInFuture", "'asOf' lies in the future.", at_ms)

    async def page(self, asked: Asked, skip: int, limit: int, at_ms: At | None = None) -> Page:
        """Give rows `skip` to `skip + limit`, and the number of all."""
        moment = await self.moment(at_ms)

        def both(cursor: duckdb.DuckDBPyConnection) -> Page:
            ended = _ended(cursor, moment, asked)
            rows = _window(ended, moment, asked, skip, limit)
            total = ended.count() + _count_memory(moment, asked)
            return Page(rows=tuple(rows), total=total, position=moment.position)

        if can_match(asked.condition):
            return await self._reader.run(both, moment.history_position)
        rows = await self.beside(lambda: _of_memory(moment, asked, None))
        some = tuple(ranked.row() for ranked in rows[skip : skip + limit])
        return Page(rows=some, total=len(rows), position=moment.position)

    async def some(self, asked: Asked, skip: int, limit: int, at_ms: At | None = None) -> Page:
        """Give rows `skip` to `skip + limit`; `total` is only their number."""
        if not can_match(asked.condition):
            page = await self.page(asked, skip, limit, at_ms)
            return Page(rows=page.rows, total=len(page.rows), position=page.position)
        moment = await self.moment(at_ms)
        rows = await self._reader.run(
            lambda c: _window(_ended(c, moment, asked), moment, asked, skip, limit),
            moment.history_position,
        )
        return Page(rows=tuple(rows), total=len(rows), position=moment.position)

    async def count(self, asked: Asked, at_ms: At | None = None) -> tuple[int, int]:
        """Give the number of rows, and the position at which it is so."""
        moment = await self.moment(at_ms)
        if not can_match(asked.condition):
            return await self.beside(lambda: _count_memory(moment, asked)), moment.position
        number = await self._reader.run(lambda c: _count(c, moment, asked), moment.history_position)
        return number, moment.position

    async def every(
        self, asked: Asked, skip: int, limit: int | None = None, at_ms: At | None = None
    ) -> tuple[int, AsyncIterator[list[Row]]]:
        """Give the position, and the rows behind `skip` in chunks, so that many need no memory."""
        moment = await self.moment(at_ms)
        if not can_match(asked.condition):
            some = await self.beside(lambda: _of_memory(moment, asked, None))
            return moment.position, _chunks(_each(some), skip, limit)
        total = await self._reader.run(lambda c: _count(c, moment, asked), moment.history_position)
        if limit is None and total - skip > ROWS_MAX:
            raise Refused(
                "errTooManyRows",
                f"{total} rows match, and one answer has {ROWS_MAX} at most: "
                "set 'limit', or ask with find/page.",
                total,
                ROWS_MAX,
            )
        rows = self._merged(moment, asked, None if limit is None else skip + limit)
        return moment.position, _chunks(rows, skip, limit)

    async def _merged(self, moment: Moment, asked: Asked, need: int | None) -> AsyncIterator[Row]:
        """Give the rows of memory and of DuckDB in one order, at least the first `need`."""
        memory = deque(_of_memory(moment, asked, need))

        def select(cursor: duckdb.DuckDBPyConnection) -> Select:
            return _ended(cursor, moment, asked).select(asked.fields, asked.sort, need)

        async for found in self._reader.stream(select, moment.history_position):
            for values in found:
                ended = _ranked(asked, values)
                while memory and memory[0].rank < ended.rank:
                    yield memory.popleft().row()
                yield ended.row()
        for ranked in memory:
            yield ranked.row()

    async def order(self, id_: OrderId, at_ms: At | None = None) -> tuple[Order | None, int]:
        """Give an order with its steps, or None; and the position at which it is so."""
        if at_ms is None:
            position, known = self.live.position, self.live.order(id_)
        else:
            fleet = await self.fleet(at_ms)
            position = fleet.position
            known = fleet.orders.get(id_) or self.live.ended_order(id_, position)
        if known is not None:
            return known, position
        if not was_made(self.live.fleet.order_counts, id_):
            return None, position
        need = min(self.live.history_position, position)
        found = await self._reader.run(lambda c: ended_order(c, id_, position, need))
        return found, position


async def _each(ranked: Sequence[_Ranked]) -> AsyncIterator[Row]:
    for one in ranked:
        yield one.row()


async def _chunks(
    rows: AsyncIterator[Row], skip: int, limit: int | None
) -> AsyncIterator[list[Row]]:
    chunk: list[Row] = []
    number = 0
    async for found in rows:
        number += 1
        if number <= skip:
            continue
        if limit is not None and number > skip + limit:
            break
        chunk.append(found)
        if len(chunk) == CHUNK_ROWS:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


def _of_memory(moment: Moment, asked: Asked, need: int | None) -> list[_Ranked]:
    """Give the matching orders of memory, sorted; the first `need` of them at least."""
    orders = moment.orders
    if need is not None and _is_default(asked) and moment.in_order:
        orders = _newest(orders, need)
    holds = predicate(asked.condition)
    part = None if asked.fuzzy is None else folded(asked.fuzzy)
    found = []
    for order in (*orders, *moment.ended):
        scene = moment.scene_name(order)
        if (part is None or part in folded(order.id)) and holds(order, scene):
            found.append(_entry(moment, asked, order))
    found.sort(key=lambda ranked: ranked.rank)
    return found


def _is_default(asked: Asked) -> bool:
    """Whether this is the page that everybody looks at: all orders, the newest first."""
    return asked.condition == ALL and asked.fuzzy is None and asked.sort == NEWEST_FIRST


def _entry(moment: Moment, asked: Asked, order: Order) -> _Ranked:
    scene = moment.scene_name(order)
    values = [key.field.read(order, scene) for key in asked.sort]
    return _Ranked(rank=rank(asked.sort, values), row=partial(row, order, scene, asked.fields))


def _newest(orders: tuple[Order, ...], need: int) -> tuple[Order, ...]:
    """Give the newest orders, so many or more: all that were created when the last one was."""
    if need >= len(orders):
        return orders
    start = len(orders) - max(need, 1)
    oldest_ms = orders[start].created_ms
    while start > 0 and orders[start - 1].created_ms == oldest_ms:
        start -= 1
    return orders[start:]


def _ended(cursor: duckdb.DuckDBPyConnection, moment: Moment, asked: Asked) -> Ended:
    return Ended(cursor, moment.history_position, asked.condition, asked.fuzzy)


def _window(ended: Ended, moment: Moment, asked: Asked, skip: int, limit: int) -> list[Row]:
    """Give rows skip … skip + limit of the two sorted lists merged.

    A row of DuckDB with `n` before it in DuckDB has between `n` and `n + len(memory)` before it in
    the merged list, so of DuckDB only a window as much longer is needed.
    """
    memory = _of_memory(moment, asked, skip + limit)
    if _is_default(asked) and (moment.newest_are_all or skip + limit <= len(moment.newest)):
        newest = (_entry(moment, asked, order) for order in moment.newest[: skip + limit])
        memory.extend(newest)
        memory.sort(key=lambda ranked: ranked.rank)
        return [ranked.row() for ranked in memory[skip : skip + limit]]
    start = max(0, skip - len(memory))
    found = ended.places(asked.sort, start, skip + limit - start)
    there: list[tuple[Rank, Callable[[], Row] | int]] = [(one.rank, one.row) for one in memory]
    there += [(rank(asked.sort, values), place) for place, *values in found]
    there.sort(key=lambda one: one[0])
    wanted = [what for _, what in there[skip - start : skip - start + limit]]
    rows = ended.rows([what for what in wanted if isinstance(what, int)], asked.fields)
    return [rows[what] if isinstance(what, int) else what() for what in wanted]


def _count(cursor: duckdb.DuckDBPyConnection, moment: Moment, asked: Asked) -> int:
    """Count in a query of its own: as part of the page it is ten times slower (measured)."""
    return _ended(cursor, moment, asked).count() + _count_memory(moment, asked)


def _count_memory(moment: Moment, asked: Asked) -> int:
    orders = (*moment.orders, *moment.ended)
    part = None if asked.fuzzy is None else folded(asked.fuzzy)
    if part is None and asked.condition == ALL:
        return len(orders)
    holds = predicate(asked.condition)
    return sum(
        (part is None or part in folded(order.id)) and holds(order, moment.scene_name(order))
        for order in orders
    )


def _ranked(asked: Asked, values: Sequence[Any]) -> _Ranked:
    width = len(asked.fields)
    row = {field.name: value for field, value in zip(asked.fields, values, strict=False)}
    return _Ranked(rank=rank(asked.sort, values[width:]), row=lambda: row)
