import pytest
from hypothesis import given
from hypothesis import strategies as st

from commands.ids import live_order, next_order_id, was_made
from commands.rejected import Reason, Rejected
from ledger.ids import OrderId
from ledger.state import Fleet, OrderKind
from tests.scenario import STORY_MS

SOME = Fleet(order_counts={"20250806": 41})


def test_all_orders_of_the_utc_day_share_one_count_and_tell_their_kind() -> None:
    assert next_order_id(SOME, STORY_MS, OrderKind.BUSINESS) == "TO20250806-000042"
    assert next_order_id(SOME, STORY_MS, OrderKind.PARKING) == "TO20250806-000042P"
    assert next_order_id(SOME, STORY_MS, OrderKind.IDLE_AVOID) == "TO20250806-000042A"
    assert next_order_id(SOME, STORY_MS, OrderKind.CHARGING) == "TO20250806-000042C"
    assert next_order_id(SOME, STORY_MS + 86_400_000, OrderKind.BUSINESS) == "TO20250807-000001"


@given(st.integers(0, 4_000_000_000_000), st.integers(0, 2_000_000), st.sampled_from(OrderKind))
def test_an_id_is_known_once_it_is_given_out(at_ms: int, count: int, kind: OrderKind) -> None:
    order = next_order_id(Fleet(), at_ms, kind)
    day = order[2:10]
    given_out = next_order_id(Fleet(order_counts={day: count}), at_ms, kind)
    assert not was_made(Fleet(order_counts={day: count}), given_out)
    assert was_made(Fleet(order_counts={day: count + 1}), given_out)


NEVER = (
    *("", "x", "TO20250806-000042", "TO20250806-000000", "TO20250806-1", "TO20250806-000041X"),
    *("TO20250806-000041\n", "TO\u0662\u0660250806-000041", "TO20250806-" + "9" * 5000),
)


@pytest.mark.parametrize("id_", NEVER)
def test_an_id_that_was_never_given_out_is_unknown(id_: str) -> None:
    assert not was_made(SOME, OrderId(id_))
    with pytest.raises(Rejected) as refusal:
        live_order(SOME, OrderId(id_))
    assert refusal.value.reason is Reason.ORDER_UNKNOWN


def test_an_order_that_has_left_the_state_is_finished() -> None:
    with pytest.raises(Rejected) as refusal:
        live_order(SOME, OrderId("TO20250806-000041"))
    assert refusal.value.reason is Reason.ORDER_TERMINAL
