import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from commands.decide import decide
from commands.order_suspension import SuspendOrders
from commands.orders import BATCH_ORDERS_MAX, CancelOrder
from commands.rejected import Reason
from ledger.events import (
    OrderCancelled,
    OrderFinished,
    OrderSuspended,
    OrderUnsuspended,
    StepFinished,
)
from ledger.ids import OrderId
from ledger.proposals import AssignOrder, FinishStep, StartStep
from tests.commands.site import (
    ORDER,
    R1,
    SCENE,
    SECOND,
    assigned,
    created,
    finished,
    opened,
    started,
    task,
)
from tests.scenario import ask, given, happened

UNKNOWN = OrderId("TO20250806-000009")
HELD = OrderSuspended(scene=SCENE, order=ORDER)
PAST = (*opened(R1), created(ORDER, task(), task()))


def suspend(*orders: OrderId, suspended: bool = True) -> object:
    return ask(SuspendOrders, orders=orders, suspended=suspended)


def test_an_order_is_held_up_once_and_let_go_once() -> None:
    fleet = given(*PAST).when(suspend(ORDER)).then(HELD)
    assert fleet.orders[ORDER].suspended
    given(*PAST, HELD).when(suspend(ORDER)).nothing()
    let_go = OrderUnsuspended(scene=SCENE, order=ORDER)
    fleet = given(*PAST, HELD).when(suspend(ORDER, suspended=False)).then(let_go)
    assert not fleet.orders[ORDER].suspended
    given(*PAST).when(suspend(ORDER, suspended=False)).nothing()


def test_each_order_is_held_up_on_its_own() -> None:
    past = (*PAST, created(SECOND, task()), OrderCancelled(scene=SCENE, order=SECOND))
    outcome = given(*past).when(suspend(UNKNOWN, SECOND, ORDER, ORDER))
    refused = {UNKNOWN: Reason.ORDER_UNKNOWN, SECOND: Reason.ORDER_TERMINAL}
    outcome.refused(**{k.replace("-", "__"): v for k, v in refused.items()}).then(HELD)


def test_a_list_has_its_limit() -> None:
    many = suspend(*(OrderId(str(n)) for n in range(BATCH_ORDERS_MAX + 1)))
    given(*PAST).when(many).rejected(Reason.TOO_MANY, "orderIds")


@pytest.mark.parametrize("past", [(), (assigned(),)])
def test_it_gets_no_robot_and_begins_no_step(past: tuple[object, ...]) -> None:
    story = given(*PAST, *past, HELD)
    kind = Reason.ORDER_SUSPENDED
    if past:
        story.when(StartStep(scene=SCENE, order=ORDER, step=0, robot=R1)).rejected(kind, ORDER)
    else:
        asked = AssignOrder(scene=SCENE, order=ORDER, robot=R1, bin=0, cost_s=1.0)
        story.when(asked).rejected(kind, ORDER)


def test_what_was_done_meanwhile_is_done() -> None:
    story = given(*PAST, assigned(), started(), HELD)
    done = FinishStep(scene=SCENE, order=ORDER, step=0, robot=R1)
    story.when(done).then(StepFinished(scene=SCENE, order=ORDER, step=0, robot=R1))
    last = given(*PAST, assigned(), started(), finished(), started(1), HELD)
    done = FinishStep(scene=SCENE, order=ORDER, step=1, robot=R1)
    last.when(done).then(
        StepFinished(scene=SCENE, order=ORDER, step=1, robot=R1),
        OrderFinished(scene=SCENE, order=ORDER),
    )


def test_it_can_be_cancelled() -> None:
    asked = ask(CancelOrder, scene=SCENE, order=ORDER)
    given(*PAST, HELD).when(asked).then(OrderCancelled(scene=SCENE, order=ORDER))


ids = st.lists(st.sampled_from((ORDER, SECOND, UNKNOWN)), max_size=4)


@settings(max_examples=80, deadline=None)
@drawn(st.lists(st.tuples(ids, st.booleans()), max_size=6))
def test_an_order_is_as_it_was_asked_for_last(asked: list[tuple[list[OrderId], bool]]) -> None:
    fleet = happened((*PAST, created(SECOND, task()), assigned()))
    model = {ORDER: False, SECOND: False}
    for orders, suspended in asked:
        decision = decide(fleet, suspend(*orders, suspended=suspended))
        assert decision.refused.keys() == set(orders) & {UNKNOWN}
        changed = {o for o in orders if o in model and model[o] is not suspended}
        assert {event.order for event in decision.events} == changed
        happened(decision.events, fleet)
        model |= dict.fromkeys(changed, suspended)
        assert {id_: order.suspended for id_, order in fleet.orders.items()} == model
        assert fleet.orders[ORDER].robot == R1
