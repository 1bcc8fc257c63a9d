"""Law: DuckDB, our Python filter and a plain reading of the query give the same orders."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.ids import OrderId
from ledger.state import Order
from projections.condition_python import predicate
from projections.condition_sql import column, order_by, where
from projections.fields import BY_NAME, FIELDS, ID, Field, FieldType
from projections.query import OPERATORS, Asker, parse
from projections.sorting import parse_sort, rank
from tests.projections.past import SCENE_NAME, archive_of
from tests.strategies import DAY_MS, SCENE, values

ASKER = Asker(user="alice", now_ms=DAY_MS)
TEXTS = st.sampled_from(
    ["", "a", "A", "ab", "AB1", "İ", "ß", "é", "考", "%", "_", "'", "a\0b", "Done"]
)


@st.composite
def order_lists(draw: st.DrawFn) -> list[Order]:
    orders = draw(st.lists(values(Order), max_size=6))
    alike = msgspec.structs.replace
    return [
        alike(
            order,
            id=OrderId(f"TO-{n}-{draw(TEXTS)}"),
            scene=SCENE,
            external_id=draw(st.none() | TEXTS),
            created_by=draw(TEXTS | st.just("alice")),
            wanted_groups=tuple(draw(st.lists(TEXTS, max_size=3))),
            priority=draw(st.integers(-2, 2)),
            created_ms=DAY_MS + draw(st.integers(-2, 2)) * 43_200_000,
            done_ms=draw(st.none() | st.integers(DAY_MS - 9, DAY_MS + 9)),
        )
        for n, order in enumerate(orders)
    ]


def _value(field: Field) -> st.SearchStrategy[Any]:
    match field.type:
        case FieldType.TEXT | FieldType.TEXTS:
            return TEXTS | st.text(max_size=3)
        case FieldType.INTEGER:
            number = st.integers(-3, 3)
            return number | number.map(str) | number.map(float)
        case FieldType.NUMBER:
            return st.integers(-3, 3) | st.floats(allow_nan=False, allow_infinity=False)
        case FieldType.BOOLEAN:
            return st.sampled_from([True, False, "true", "FALSE"])
        case FieldType.DATE:
            instant = st.integers(DAY_MS - 10, DAY_MS + 10)
            return instant | instant.map(
                lambda ms: datetime.fromtimestamp(ms / 1000, UTC).isoformat(timespec="milliseconds")
            )


@st.composite
def generals(draw: st.DrawFn) -> dict[str, Any]:
    field = draw(st.sampled_from(FIELDS))
    operator = draw(st.sampled_from(OPERATORS[field.type]))
    query: dict[str, Any] = {"type": "General", "field1": field.name, "operator": operator}
    comparable = operator in ("Eq", "Ne", "Gt", "Gte", "Lt", "Lte")
    if comparable and field.type is not FieldType.TEXTS and draw(st.integers(0, 3)) == 0:
        alike = [f.name for f in FIELDS if f.type is field.type]
        query["field2"] = draw(st.sampled_from(alike))
    elif operator == "Between":
        query["value"] = [draw(_value(field)), draw(_value(field))]
    elif operator == "In":
        size = draw(st.sampled_from([3, 60]))
        query["value"] = draw(st.lists(_value(field), max_size=size, min_size=size // 2))
    else:
        query["value"] = draw(_value(field))
    if draw(st.booleans()):
        query["not"] = draw(st.booleans())
    return query


def _compound(items: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries(
        {"type": st.just("Compound"), "items": st.lists(items, max_size=3)},
        optional={"or": st.booleans(), "not": st.booleans()},
    )


def queries() -> st.SearchStrategy[dict[str, Any]]:
    return st.recursive(generals() | st.just({"type": "All"}), _compound, max_leaves=6)


def plainly(query: dict[str, Any], row: dict[str, Any]) -> bool:
    """Read a query as its documentation reads, sharing nothing with the code under test."""
    match query["type"]:
        case "All":
            holds = True
        case "Compound":
            parts = [plainly(item, row) for item in query["items"]]
            holds = any(parts) if query.get("or") else all(parts)
        case _:
            holds = _general(query, row)
    return not holds if query.get("not") else holds


def _general(query: dict[str, Any], row: dict[str, Any]) -> bool:
    field = BY_NAME[query["field1"]]
    operator, have = query["operator"], row[field.name]
    if operator in ("Ne", "NotNull", "NotEmpty"):
        positive = {"Ne": "Eq", "NotNull": "Null", "NotEmpty": "Empty"}[operator]
        return not _general({**query, "operator": positive}, row)
    if operator == "Null":
        return have is None
    if operator == "Empty":
        return have is None or have == "" or have == []
    if "field2" in query:
        want = row[query["field2"]]
    elif operator.startswith("CurrentUser"):
        operator, want = "Eq", "alice"
    elif isinstance(query["value"], list):
        want = [_plain(field, v) for v in query["value"]]
    else:
        want = _plain(field, query["value"])
    if have is None or want is None:
        return False
    if isinstance(have, list):
        return any(_one(operator, element, want) for element in have)
    return _one(operator, have, want)


def _one(operator: str, have: Any, want: Any) -> bool:
    match operator:
        case "Eq":
            return bool(have == want)
        case "Gt":
            return bool(have > want)
        case "Gte":
            return bool(have >= want)
        case "Lt":
            return bool(have < want)
        case "Lte":
            return bool(have <= want)
        case "In":
            return have in want
        case "Between":
            return bool(want[0] <= have <= want[1])
        case "Contain":
            return want in have
        case "ContainIgnoreCase":
            # without the one capital whose lower case is two characters
            return want.replace("İ", "i").lower() in have.replace("İ", "i").lower()
        case "Start":
            return bool(have.startswith(want))
        case "End":
            return bool(have.endswith(want))
        case "ThisDay":
            return have // 86_400_000 == DAY_MS // 86_400_000
        case "ThisWeek":
            weeks = [
                datetime.fromtimestamp(t // 1000, UTC).isocalendar()[:2] for t in (have, DAY_MS)
            ]
            return weeks[0] == weeks[1]
    raise AssertionError(operator)


def _plain(field: Field, value: Any) -> Any:
    match field.type:
        case FieldType.BOOLEAN:
            return str(value).lower() == "true"
        case FieldType.INTEGER:
            return int(float(value))
        case FieldType.DATE if isinstance(value, str):
            return round(datetime.fromisoformat(value).timestamp() * 1000)
        case _:
            return value


@settings(max_examples=40, deadline=None)
@given(order_lists(), st.lists(queries(), min_size=1, max_size=25))
def test_duckdb_and_python_and_a_plain_reading_find_the_same(
    orders: list[Order], asked: Sequence[dict[str, Any]]
) -> None:
    archive = archive_of(orders)
    rows = [{f.name: f.read(order, SCENE_NAME) for f in FIELDS} for order in orders]
    try:
        for query in asked:
            condition = parse(query, ASKER)
            sql, parameters = where(condition)
            found = archive.cursor().execute(f"SELECT id FROM orders_done WHERE {sql}", parameters)
            by_duckdb = sorted(id_ for (id_,) in found.fetchall())
            holds = predicate(condition)
            by_python = sorted(order.id for order in orders if holds(order, SCENE_NAME))
            truth = sorted(row["id"] for row in rows if plainly(query, row))
            assert by_duckdb == truth, sql
            assert by_python == truth, condition
    finally:
        archive.close()


SORTS = st.lists(
    st.builds(str.__add__, st.sampled_from(["", "+", "-"]), st.sampled_from(sorted(BY_NAME))),
    max_size=3,
)


@settings(max_examples=40, deadline=None)
@given(order_lists(), SORTS)
def test_duckdb_and_python_sort_alike(orders: list[Order], sort: list[str]) -> None:
    keys = parse_sort(sort)
    archive = archive_of(orders)
    try:
        sql = f"SELECT {column(ID)} FROM orders_done ORDER BY {order_by(keys)}"
        by_duckdb = [id_ for (id_,) in archive.cursor().execute(sql).fetchall()]
    finally:
        archive.close()
    by_python = sorted(
        orders, key=lambda order: rank(keys, [k.field.read(order, SCENE_NAME) for k in keys])
    )
    assert by_duckdb == [order.id for order in by_python]


@settings(max_examples=25, deadline=None)
@given(order_lists())
def test_rows_out_of_duckdb_are_the_rows_of_the_orders(orders: list[Order]) -> None:
    archive = archive_of(orders)
    try:
        columns = ", ".join(map(column, FIELDS))
        found = archive.cursor().execute(f"SELECT {columns} FROM orders_done").fetchall()
        bodies = archive.cursor().execute("SELECT body FROM orders_done").fetchall()
    finally:
        archive.close()
    assert found == [tuple(f.read(order, SCENE_NAME) for f in FIELDS) for order in orders]
    assert [msgspec.json.decode(body, type=Order) for (body,) in bodies] == orders
