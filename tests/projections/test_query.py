"""What a ComplexQuery may say, and what is refused by name."""

from typing import Any

import duckdb
import pytest

from ledger.errors import Refused
from ledger.state import Order
from projections.condition_python import predicate
from projections.condition_sql import where
from projections.fields import FIELDS
from projections.query import CHOICES_MAX, DEPTH_MAX, ITEMS_MAX, Asker, folded, parse
from projections.sorting import parse_sort
from tests.projections.past import SCENE_NAME, archive_of
from tests.strategies import DAY_MS, SCENE

ASKER = Asker(user="alice", now_ms=DAY_MS)
ORDER = Order(id="TO1", scene=SCENE, created_ms=0, created_by="", modified_ms=0, modified_by="")  # type: ignore[arg-type]


def general(field: str, operator: str, value: Any = None) -> dict[str, Any]:
    return {"type": "General", "field1": field, "operator": operator, "value": value}


def holds(query: Any, **changes: Any) -> bool:
    order = Order(**{f: getattr(ORDER, f) for f in ORDER.__struct_fields__} | changes)
    return predicate(parse(query, ASKER))(order, SCENE_NAME)


def test_no_query_means_all() -> None:
    assert holds(None)
    assert holds({"type": "All"})
    assert not holds({"type": "All", "not": True})


def test_an_empty_compound_is_all_for_and_and_nothing_for_or() -> None:
    assert holds({"type": "Compound"})
    assert not holds({"type": "Compound", "items": [], "or": True})


def test_ne_finds_what_eq_does_not_nulls_included() -> None:
    assert holds(general("externalId", "Ne", "a"))
    assert not holds(general("externalId", "Eq", "a"))


@pytest.mark.parametrize("value", [True, "true", "TRUE"])
def test_a_boolean_may_be_text(value: Any) -> None:
    assert holds(general("stepFixed", "Eq", value), sealed=True)


@pytest.mark.parametrize(
    ("text", "at_ms"),
    [
        (1_754_471_343_887, 1_754_471_343_887),
        ("1754471343887", 1_754_471_343_887),
        ("2025-08-06T09:09:03.887Z", 1_754_471_343_887),
        ("2025-08-06T17:09:03.887+08:00", 1_754_471_343_887),
        ("2025-08-06T17:09:03.887+0800", 1_754_471_343_887),
        ("2025-08-06T17:09:03+08", 1_754_471_343_000),
        ("2025-08-06 09:09:03.887", 1_754_471_343_887),
        ("2025-08-06 09:09:03", 1_754_471_343_000),
        ("2025-08-06 09:09", 1_754_471_340_000),
        ("2025-08-06", 1_754_438_400_000),
        ("2025/08/06", 1_754_438_400_000),
        ("01:00:00", DAY_MS - DAY_MS % 86_400_000 + 3_600_000),
    ],
)
def test_a_date_is_read_in_every_documented_form(text: Any, at_ms: int) -> None:
    assert holds(general("createdOn", "Eq", text), created_ms=at_ms)
    assert not holds(general("createdOn", "Eq", text), created_ms=at_ms + 1)


def test_a_bare_date_as_upper_end_counts_to_the_end_of_that_day() -> None:
    query = general("createdOn", "Between", ["2025-08-05", "2025-08-06"])
    assert holds(query, created_ms=1_754_438_400_000 + 86_400_000 - 1)
    assert not holds(query, created_ms=1_754_438_400_000 + 86_400_000)


def test_a_week_begins_on_monday() -> None:
    sunday_ms = 1_754_179_200_000  # 2025-08-03
    asker = Asker(user="", now_ms=sunday_ms + 3 * 86_400_000)
    test = predicate(parse(general("createdOn", "ThisWeek"), asker))
    order = {f: getattr(ORDER, f) for f in ORDER.__struct_fields__}
    days = [test(Order(**order | {"created_ms": sunday_ms + n * 86_400_000}), "") for n in range(9)]
    assert days == [False, True, True, True, True, True, True, True, False]


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ({}, "'query.type' must be All, Compound or General"),
        ([], "'query' must be an object"),
        ({"type": "Any"}, "not 'Any'"),
        ({"type": "Compound", "items": {}}, "'query.items' must be a list"),
        ({"type": "Compound", "items": [{"type": "x"}]}, r"query.items\[0\].type"),
        ({"type": "Compound", "or": "yes"}, "'query.or' must be true or false"),
        (general("nope", "Eq", 1), "no field 'nope'; it has id, "),
        (general("id", "Like", "a"), "takes no 'Like'; it takes Eq"),
        (general("stepFixed", "Gt", True), "stepFixed is of type boolean"),
        (general("priority", "Contain", "a"), "priority is of type integer"),
        (general("id", "Eq"), "'query.value' must be a text, not None"),
        (general("id", "Eq", ["a"]), "must be a text"),
        (general("id", "In", "a"), "must be a list"),
        (general("id", "In", [None]), r"query.value\[0\]"),
        (general("priority", "Eq", "high"), "whole number"),
        (general("priority", "Eq", 1.5), "whole number"),
        (general("priority", "Eq", 2**63), "64 bits"),
        (general("priority", "Eq", True), "whole number"),
        (general("dispatchCost", "Eq", "NaN"), "must be a number"),
        (general("dispatchCost", "Eq", 10**400), "must be a number"),
        (general("stepFixed", "Eq", "yes"), "true or false"),
        (general("createdOn", "Eq", "2025-02-30"), "must be epoch milliseconds or a date"),
        (general("createdOn", "Eq", "25:00:00"), "must be epoch milliseconds or a date"),
        (general("createdOn", "Between", ["2025-02-01"]), "list of two"),
        (general("id", "ThisDay"), "takes no 'ThisDay'"),
        (general("id", "Eq") | {"field2": "nope"}, "no field 'nope'"),
        (general("id", "Eq") | {"field2": "priority"}, "is of type integer, but id of type text"),
        (general("id", "Start") | {"field2": "kind"}, "goes only with Eq"),
        (general("id", "Eq", "x" * 10_001), "at most 10000 characters"),
    ],
)
def test_what_is_wrong_is_named(query: Any, words: str) -> None:
    with pytest.raises(Refused, match=words):
        parse(query, ASKER)


def test_limits_are_named() -> None:
    deep: dict[str, Any] = {"type": "All"}
    for _ in range(DEPTH_MAX - 1):
        deep = {"type": "Compound", "items": [deep]}
    parse(deep, ASKER)
    with pytest.raises(Refused, match=f"deeper than {DEPTH_MAX}"):
        parse({"type": "Compound", "items": [deep]}, ASKER)
    items = [{"type": "All"}] * (ITEMS_MAX - 1)
    parse({"type": "Compound", "items": items}, ASKER)
    with pytest.raises(Refused, match=f"more than {ITEMS_MAX}"):
        parse({"type": "Compound", "items": [*items, {"type": "All"}]}, ASKER)
    parse(general("id", "In", ["a"] * CHOICES_MAX), ASKER)
    with pytest.raises(Refused, match=f"more than {CHOICES_MAX}"):
        parse(general("id", "In", ["a"] * (CHOICES_MAX + 1)), ASKER)


def test_an_unknown_field_of_the_sorting_is_named() -> None:
    with pytest.raises(Refused, match=r"'sort\[1\]'.*'nope'"):
        parse_sort(["-createdOn", "+nope"])


HOSTILE = [
    "'; DROP TABLE orders_done; --",
    '" OR 1=1 --',
    "$1",
    "?",
    "\\'",
    "a\0b",
    "%_",
    "{}",
    "?)",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_of_a_client_becomes_sql(text: str) -> None:
    archive = archive_of([ORDER])
    operators = ["Eq", "Ne", "In", "Contain", "ContainIgnoreCase", "Start", "End", "Gt"]
    for operator in operators:
        many = 60 if operator == "In" else 0
        sql, parameters = where(parse(general("id", operator, [text] * many or text), ASKER))
        tame, _ = where(parse(general("id", operator, ["x"] * many or "x"), ASKER))
        assert sql == tame
        archive.cursor().execute(f"SELECT count(*) FROM orders_done WHERE {sql}", parameters)
    for place in ("field1", "field2", "operator", "type"):
        with pytest.raises(Refused):
            parse(general("id", "Eq", "a") | {place: text}, ASKER)
    for sort in (text, f"-{text}"):
        with pytest.raises(Refused):
            parse_sort([sort])
    assert archive.cursor().execute("SELECT count(*) FROM orders_done").fetchone() == (1,)
    archive.close()


def test_folding_is_that_of_duckdb_for_all_of_unicode() -> None:
    points = [n for n in range(1, 0x110000) if not 0xD800 <= n < 0xE000]
    with duckdb.connect() as connection:
        rows = connection.execute("SELECT lower(chr(n::INT)) FROM (SELECT unnest(?) n)", [points])
        assert [lower for (lower,) in rows.fetchall()] == [folded(chr(n)) for n in points]


def test_every_field_has_a_column_of_its_own() -> None:
    assert len({field.column for field in FIELDS}) == len(FIELDS)
    assert all(field.column.replace("_", "").isalpha() for field in FIELDS)
