"""Which order comes first."""

from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import OrderId
from ledger.scene_config import DISPATCH_SORT_FIELDS
from ledger.state import Order
from scheduler.urgency import rank, urgency
from scheduler.waiting import Waiting
from tests.scheduler.small_site import SCENE

orders = st.builds(
    Order,
    id=st.text("ab1", min_size=1, max_size=3).map(OrderId),
    scene=st.just(SCENE),
    priority=st.integers(-2, 2),
    created_ms=st.integers(0, 3),
    created_by=st.just(""),
    modified_ms=st.just(0),
    modified_by=st.just(""),
    external_id=st.none() | st.text("ab", max_size=3),
    suspended=st.booleans(),
)
sorts = st.lists(
    st.builds(str.__add__, st.sampled_from(["", "+", "-"]), st.sampled_from(DISPATCH_SORT_FIELDS)),
    max_size=3,
)
FIELDS = {
    "priority": lambda order: order.priority,
    "createdOn": lambda order: order.created_ms,
    "externalId": lambda order: order.external_id,
    "id": lambda order: order.id,
}


@given(sorts, orders, orders)
def test_the_first_field_that_differs_decides(sort: list[str], one: Order, other: Order) -> None:
    for name in sort or ["-priority"]:
        field = FIELDS[name.lstrip("+-")]
        a, b = field(one), field(other)
        if a != b:
            known = a is not None and b is not None
            first = (a > b) if known and name[0] == "-" else (a < b) if known else b is None
            assert (rank(sort)(one) < rank(sort)(other)) is first
            return
    assert rank(sort)(one) == rank(sort)(other)


@given(sorts)
def test_no_two_orders_are_equally_urgent(sort: list[str]) -> None:
    header = {"scene": SCENE, "created_by": "", "created_ms": 0, "modified_ms": 0}
    one, other = (Order(id=OrderId(n), modified_by="", **header) for n in "ab")  # type: ignore[arg-type]
    assert urgency(sort)(one) != urgency(sort)(other)


def test_names_of_no_field_sort_nothing() -> None:
    one = Order(
        id=OrderId("a"), scene=SCENE, created_by="", created_ms=0, modified_ms=0, modified_by=""
    )
    assert rank(["", "-", "colour"])(one) == ()


@given(sorts, sorts, st.lists(orders, unique_by=lambda order: order.id))
def test_a_changed_setting_sorts_those_that_wait_already(
    before: list[str], after: list[str], known: list[Order]
) -> None:
    waiting, anew = Waiting(before), Waiting(after)
    for order in known:
        waiting.note(order.id, order)
        anew.note(order.id, order)
    waiting.sort_by(after, {order.id: order for order in known})
    found = waiting.slice()
    assert found == anew.slice()
    suspended = [order.id for order in known if order.suspended]
    assert set(found[len(known) - len(suspended) :]) == set(suspended), "they come last"
