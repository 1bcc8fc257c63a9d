"""The queue of orders without a robot."""

from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import OrderId
from ledger.state import Order, OrderKind, OrderStatus
from scheduler.waiting import HEAD, SLICE, Waiting
from tests.scheduler.small_site import SCENE


def waiting_order(number: int, priority: int = 0, created_ms: int = 0, **fields: object) -> Order:
    return Order(
        id=OrderId(f"O{number:05}"),
        scene=SCENE,
        priority=priority,
        created_ms=created_ms,
        created_by="",
        modified_ms=0,
        modified_by="",
        **fields,  # type: ignore[arg-type]
    )


changes = st.lists(
    st.tuples(
        st.integers(0, 8),
        st.none()
        | st.tuples(
            st.integers(0, 3),
            st.integers(0, 3),
            st.sampled_from([OrderStatus.TO_BE_ALLOCATED, OrderStatus.EXECUTING]),
            st.sampled_from([OrderKind.BUSINESS, OrderKind.PARKING]),
            st.sampled_from([None, "broken"]),
        ),
    )
)


@given(changes)
def test_it_holds_what_waits_most_urgent_first(
    history: list[tuple[int, tuple[int, int, OrderStatus, OrderKind, str | None] | None]],
) -> None:
    queue = Waiting()
    orders: dict[OrderId, Order] = {}
    for number, change in history:
        id_ = OrderId(f"O{number:05}")
        orders.pop(id_, None)
        if change is not None:
            priority, at_ms, status, kind, fault = change
            orders[id_] = waiting_order(
                number, priority, at_ms, status=status, kind=kind, fault_reason=fault
            )
        queue.note(id_, orders.get(id_))
    waiting = [
        o
        for o in orders.values()
        if o.status is OrderStatus.TO_BE_ALLOCATED
        and o.kind is OrderKind.BUSINESS
        and o.fault_reason is None
    ]
    waiting.sort(key=lambda o: (-o.priority, o.created_ms, o.id))
    assert queue.slice() == [o.id for o in waiting]
    assert len(queue) == len(waiting)


def test_every_order_has_its_turn_and_the_most_urgent_always() -> None:
    queue = Waiting()
    count = HEAD + 2 * SLICE + 7
    for number in range(count):
        order = waiting_order(number)
        queue.note(order.id, order)
    seen: set[OrderId] = set()
    for _ in range(3):
        ids = queue.slice()
        assert ids[:HEAD] == [f"O{n:05}" for n in range(HEAD)]
        assert len(ids) <= HEAD + SLICE and len(set(ids)) == len(ids)
        seen.update(ids)
    assert len(seen) == count
