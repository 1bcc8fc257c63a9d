"""Rows of ended orders out of DuckDB: pages, counts, and one by its id."""

from collections.abc import Sequence
from typing import Any

import duckdb
import msgspec

from ledger.ids import OrderId
from ledger.state import Order
from projections.condition_sql import column, order_by, where
from projections.fields import ID, Field, Row, row
from projections.order_keys import contains, id_of
from projections.query import Condition, How, Test, folded
from projections.reading import Rebuilding, Select
from projections.sorting import Key

WHOLE_MAX = 1_000  # rows are made from orders as a whole; more are read by columns

_decode = msgspec.json.Decoder(Order).decode
_AT = (
    "SELECT o.rowid, {} FROM orders_done o "
    "JOIN (SELECT unnest(?::BIGINT[]) AS wanted) ON o.rowid = wanted"
)


class Ended:
    """The ended orders that match, of those that had ended by a position."""

    def __init__(
        self,
        cursor: duckdb.DuckDBPyConnection,
        until: int,
        condition: Condition,
        fuzzy: str | None,
    ) -> None:
        """Take what is asked; the cursor must have all rows up to the position, and no transaction.

        All that is read is of one snapshot. Where nothing has ended later, the position is not
        compared: DuckDB then finds a page far down thirty times as fast (measured).
        """
        self._cursor = cursor
        cursor.execute("BEGIN TRANSACTION READ ONLY")  # it ends with the cursor
        at = cursor.execute("SELECT position, odd_ids FROM checkpoint").fetchone()
        assert at is not None
        self._keyed = at[1] == 0
        self._where, self._parameters = where(condition)
        if at[0] > until:
            self._where += " AND done_position <= ?"
            self._parameters.append(until)
        if fuzzy is not None:
            self._contain(folded(fuzzy))

    def _contain(self, part: str) -> None:
        sql, parameters = contains(self._cursor, part)
        if not self._keyed:
            odd, more = where(Test(field=ID, how=How.CONTAIN_FOLDED, value=part))
            sql, parameters = f"({sql} OR (id_key IS NULL AND {odd}))", [*parameters, *more]
        self._where += f" AND {sql}"
        self._parameters += parameters

    def count(self) -> int:
        """Count them."""
        sql = f"SELECT count(*) FROM orders_done WHERE {self._where}"
        (number,) = self._cursor.execute(sql, self._parameters).fetchone() or (0,)
        return int(number)

    def select(self, fields: Sequence[Field], sort: Sequence[Key], need: int | None) -> Select:
        """Give the statement for the first rows, or all: fields, then what they are sorted by."""
        columns = ", ".join(column(f) for f in (*fields, *(key.field for key in sort)))
        sql = f"SELECT {columns} FROM orders_done {self._sorted(sort)}"
        if need is None:
            return sql, self._parameters
        return f"{sql} LIMIT ?", [*self._parameters, need]

    def places(self, sort: Sequence[Key], skip: int, limit: int) -> list[tuple[Any, ...]]:
        """Tell where rows skip … skip + limit are, each with what it is sorted by.

        Only the few columns are read that decide it: forty columns at fifty places take ten times
        as long to read as the text that they were made of.
        """
        keyed = [self._keyed and key.field is ID for key in sort]
        columns = ", ".join(
            "id_key" if as_key else column(key.field)
            for key, as_key in zip(sort, keyed, strict=True)
        )
        sql = f"SELECT rowid, {columns} FROM orders_done {self._sorted(sort)} LIMIT ? OFFSET ?"
        found = self._cursor.execute(sql, [*self._parameters, limit, skip]).fetchall()
        as_text = [False, *keyed]
        if not any(as_text):
            return found
        return [
            tuple(id_of(v) if text else v for v, text in zip(one, as_text, strict=True))
            for one in found
        ]

    def rows(self, places: Sequence[int], fields: Sequence[Field]) -> dict[int, Row]:
        """Give the rows at these places, which stay where they are: nothing is ever deleted."""
        if not places:
            return {}
        if len(places) <= WHOLE_MAX:
            found = self._cursor.execute(_AT.format("scene_name, body"), [places]).fetchall()
            return {place: row(_decode(body), scene, fields) for place, scene, body in found}
        columns = ", ".join(map(column, fields))
        found = self._cursor.execute(_AT.format(columns), [places]).fetchall()
        names = [field.name for field in fields]
        return {place: dict(zip(names, values, strict=True)) for place, *values in found}

    def _sorted(self, sort: Sequence[Key]) -> str:
        return f"WHERE {self._where} ORDER BY {order_by(sort, by_id_key=self._keyed)}"


def ended_order(
    cursor: duckdb.DuckDBPyConnection, id_: OrderId, until: int, need: int
) -> Order | None:
    """Give an order if it had ended by a position; raises Rebuilding where that is not known.

    DuckDB need not have all rows up to `need` if it has this one.
    """
    (have,) = cursor.execute("SELECT position FROM checkpoint").fetchone() or (0,)
    sql, parameters = where(Test(field=ID, how=How.EQUAL, value=id_))
    found = cursor.execute(
        f"SELECT done_position, body FROM orders_done WHERE {sql}", parameters
    ).fetchone()
    if found is not None:
        return _decode(found[1]) if found[0] <= until else None
    if have < need:
        raise Rebuilding(have, need)
    return None
