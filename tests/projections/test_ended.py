"""Whether ended orders can match is never wrongly denied."""

from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.state import Order, OrderStatus
from projections.condition_python import predicate
from projections.ended import can_match
from projections.query import parse
from tests.laws.test_query_laws import ASKER, order_lists, queries
from tests.projections.past import SCENE_NAME


@settings(max_examples=40, deadline=None)
@given(order_lists(), st.lists(queries(), min_size=1, max_size=10), st.sampled_from(OrderStatus))
def test_no_ended_order_matches_what_none_can_match(
    orders: list[Order], asked: list[dict[str, Any]], status: OrderStatus
) -> None:
    ended = [
        msgspec.structs.replace(order, status=end, done_ms=1)
        for order in orders
        for end in (OrderStatus.DONE, OrderStatus.CANCELLED)
    ]
    still = {"type": "General", "field1": "status", "operator": "Eq", "value": status.value}
    for query in asked:
        both = {"type": "Compound", "items": [query, still]}
        for one in (query, both, {**both, "not": True}, {**both, "or": True}):
            condition = parse(one, ASKER)
            if not can_match(condition):
                assert not any(predicate(condition)(order, SCENE_NAME) for order in ended)


def test_what_only_live_orders_match_is_known() -> None:
    live: list[dict[str, Any]] = [
        {"type": "General", "field1": "doneOn", "operator": "Null"},
        {
            "type": "General",
            "field1": "status",
            "operator": "In",
            "value": ["Executing", "Pending"],
        },
        {"type": "General", "field1": "status", "operator": "Eq", "value": "Done", "not": True},
    ]
    assert [can_match(parse(query, ASKER)) for query in live] == [False, False, True]
    terminal = {"type": "General", "field1": "status", "operator": "In", "not": True}
    assert not can_match(parse({**terminal, "value": ["Done", "Cancelled"]}, ASKER))
