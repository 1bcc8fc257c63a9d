"""Who gets which order, and what the others are told."""

from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from ledger.events import SceneConfigured
from ledger.ids import OrderId, PointName, RobotName
from ledger.proposals import AssignOrder, CreateSystemOrder, RejectAssignment, WithdrawOrder
from ledger.scene_config import DispatchMethod, SceneConfig
from ledger.state import Order, OrderKind
from scheduler.corridors import Corridor
from scheduler.dispatch.assign import CANDIDATES_MAX, assign
from scheduler.dispatch.reasons import Why
from scheduler.dispatch.refusals import REFUSALS_MAX
from tests.scheduler.dispatch.views import NOW_MS, Situation, situations
from tests.scheduler.small_site import SCENE, carry

CODES = {why.value for why in Why}


def assigned(situation: Situation, **how: bool) -> dict[OrderId, AssignOrder]:
    found = assign(situation.view(**how), (), NOW_MS)
    return {p.order: p for p in found if isinstance(p, AssignOrder)}


@given(situations())
def test_the_core_accepts_every_assignment_and_no_robot_gets_more_orders_than_bins(
    situation: Situation,
) -> None:
    for _ in range(3):
        situation.core.propose(assign(situation.view(), (), NOW_MS))
        for robot in situation.core.fleet.robots.values():
            assert len(robot.orders) <= len(robot.bins)


@given(situations())
def test_every_order_left_has_a_code_for_every_robot_of_the_scene(situation: Situation) -> None:
    situation.core.propose(assign(situation.view(), (), NOW_MS))
    view = situation.view()
    for order in view.waiting:
        reject = order.allocation_reject
        assert reject is not None
        assert reject.code == ("AllRobotUnDispatchable" if view.robots else "NoRobot")
        assert reject.robots.keys() == view.robots.keys()
        assert set(reject.robots.values()) <= CODES


@given(situations())
def test_every_robot_that_was_not_taken_is_a_candidate_with_cost_or_reason(
    situation: Situation,
) -> None:
    robots = situation.view().robots.keys()
    for proposal in assigned(situation).values():
        named = {c.robot for c in proposal.candidates}
        assert named == robots - {proposal.robot}
        assert all((c.cost_s is None) != (c.reason is None) for c in proposal.candidates)


@given(situations())
def test_the_same_view_gives_the_same_proposals(situation: Situation) -> None:
    assert assign(situation.view(), (), NOW_MS) == assign(situation.view(), (), NOW_MS)


@given(situations())
def test_nobody_waits_for_a_robot_that_a_lower_priority_got(situation: Situation) -> None:
    view = situation.view()
    got = assigned(situation)
    robots = {p.robot: view_order(view.waiting, o) for o, p in got.items()}
    left = [o for o in view.waiting if o.id not in got]
    found = assign(view, (), NOW_MS)
    reasons = {p.order: p.robots for p in found if isinstance(p, RejectAssignment)}
    for order in left:
        for name, why in reasons[order.id].items():
            if why == Why.ROBOT_TAKEN_BY_OTHER:
                assert robots[name].priority >= order.priority


def view_order(waiting: Sequence[Order], id_: OrderId) -> Order:
    return next(o for o in waiting if o.id == id_)


@given(situations(method=DispatchMethod.KM, priorities=1))
def test_the_optimum_serves_no_fewer_orders_and_costs_no_more_than_greed(
    situation: Situation,
) -> None:
    best = priced(situation, DispatchMethod.KM)
    greedy = priced(situation, DispatchMethod.GREEDY)
    assert best[0] >= greedy[0]
    if best[0] == greedy[0]:
        assert best[1] <= greedy[1] + 1e-6


def priced(situation: Situation, method: DispatchMethod) -> tuple[int, float]:
    """Count and price the assignments of one-bin robots in the class of those that waited long."""
    view = situation.view()
    config = SceneConfig(dispatch_method=method, dispatch_wait_s_max=10**9)
    robots = {name: robot for name, robot in view.robots.items() if len(robot.robot.bins) == 1}
    scene = replace(view.scene, config=config)
    found = assign(replace(view, scene=scene, robots=robots), (), NOW_MS)
    costs = [p.cost_s for p in found if isinstance(p, AssignOrder)]
    return len(costs), sum(costs)


def test_an_overdue_order_goes_before_a_near_one() -> None:
    situation = Situation()
    situation.robot("A", 5.0)
    situation.core.now_ms = 100_000
    situation.happen(carry(1, "B19", "B0"))
    situation.core.now_ms = NOW_MS - 1
    situation.happen(carry(2, "B5", "B0"))
    assert list(assigned(situation)) == ["TO20260101-000001"]


def test_among_equals_the_cheapest_pairs_are_made() -> None:
    situation = Situation()
    situation.robot("A", 0.0)
    situation.robot("B", 6.0)
    situation.core.now_ms = NOW_MS
    situation.happen(carry(1, "B5", "B0"), carry(2, "B19", "B0"))
    got = {o[-1]: p.robot for o, p in assigned(situation).items()}
    assert got == {"1": "A", "2": "B"}  # 5 + 13 s; the greedy way is 1 + 19 s


def running_on_a() -> Situation:
    """Robot A is on its way to an order ten seconds off."""
    situation = Situation(SceneConfig(withdrawn_cost_min=5.0))
    situation.core.now_ms = NOW_MS
    situation.robot("A", 0.0)
    situation.happen(carry(1, "B10", "B0"))
    situation.core.propose(assign(situation.view(), (), NOW_MS))
    return situation


def test_a_running_order_stays_where_it_is_unless_the_gain_is_above_the_threshold() -> None:
    situation = running_on_a()
    situation.robot("B", 15.0)  # 5 s nearer, and the threshold is 5 s
    assert not assigned(situation, reallocate=True)


def test_a_better_robot_takes_a_running_order_over() -> None:
    situation = running_on_a()
    situation.robot("B", 13.0)
    assert not assigned(situation)
    found = assign(situation.view(reallocate=True), (), NOW_MS)
    assert [type(p) for p in found] == [WithdrawOrder, AssignOrder]
    situation.core.propose(found)
    assert [o.robot for o in situation.core.fleet.orders.values()] == ["B"]


def test_a_scene_may_forbid_reallocation() -> None:
    situation = running_on_a()
    situation.robot("B", 10.0)
    config = SceneConfig(reallocation_off=True)
    situation.happen(SceneConfigured(scene=SCENE, config=config))
    assert not assigned(situation, reallocate=True)


@given(situations(), st.data())
def test_reallocation_never_leaves_a_running_order_without_a_robot(
    situation: Situation, data: st.DataObject
) -> None:
    situation.core.propose(assign(situation.view(), (), NOW_MS))
    running = {i for i, o in situation.core.fleet.orders.items() if o.robot is not None}
    for name, report in list(situation.reports.items()):
        x_m = float(data.draw(st.integers(0, 19)))
        situation.reports[name] = replace(report, x_m=x_m)
    for n in range(100, 103):
        situation.happen(carry(n, f"B{n % 20}", "B0", priority=data.draw(st.integers(0, 2))))
    found = assign(situation.view(reallocate=True), (), NOW_MS)
    situation.core.propose(found)
    assert all(situation.core.fleet.orders[i].robot is not None for i in running)


def test_a_parked_robot_is_called_away_and_its_parking_order_ends() -> None:
    situation = Situation()
    situation.robot("A", 0.0)
    situation.happen(*situation.core.decide(parking("A")))
    situation.happen(carry(1, "B5", "B0"))
    situation.core.propose(assign(situation.view(), (), NOW_MS))
    assert [o.robot for o in situation.core.fleet.orders.values()] == ["A"]
    assert len(situation.core.fleet.orders) == 1


def parking(name: str) -> CreateSystemOrder:
    return CreateSystemOrder(
        scene=SCENE, kind=OrderKind.PARKING, robot=RobotName(name), location="P0", cost_s=1.0
    )


def test_refusals_are_few_at_a_time_and_all_come_in_the_end() -> None:
    situation = Situation()
    for n in range(2 * REFUSALS_MAX + 1):
        situation.happen(carry(n, "B1", "B2"))
    counts = []
    for _ in range(4):
        found = assign(situation.view(), (), NOW_MS)
        situation.core.propose(found)
        counts.append(len(found))
    assert counts == [REFUSALS_MAX, REFUSALS_MAX, 1, 0]


def test_the_reason_is_told_in_the_words_of_the_specification() -> None:
    situation = Situation()
    situation.robot("SW500", 0.0)
    situation.happen(carry(1, "B1", "B2"))
    situation.core.propose(assign(situation.view(), (), NOW_MS))
    situation.happen(carry(2, "B1", "B2"))
    (refusal,) = assign(situation.view(), (), NOW_MS)
    assert isinstance(refusal, RejectAssignment)
    assert (refusal.code, refusal.robots) == (
        "AllRobotUnDispatchable",
        {"SW500": "RobotNoMoreBin"},
    )


def test_an_assignment_names_the_cheapest_candidates() -> None:
    situation = Situation()
    for n in range(CANDIDATES_MAX + 10):
        situation.robot(f"R{n:02}", float(n % 20))
    situation.happen(carry(1, "B0", "B2"))
    (proposal,) = assigned(situation).values()
    costs = [c.cost_s for c in proposal.candidates]
    assert len(costs) == CANDIDATES_MAX and costs == sorted(costs, key=float)


def test_a_third_order_for_one_aisle_waits_and_says_so() -> None:
    situation = Situation()
    for n in range(3):
        situation.robot(f"R{n}", 0.0)
    for n in range(3):
        situation.happen(carry(n, f"B{10 + n}", "B0"))
    aisle = Corridor(name=PointName("W10"), orders_max=2)
    points = {PointName(f"W{10 + n}"): aisle for n in range(3)}
    found = assign(replace(situation.view(), corridors=points), (), NOW_MS)
    assert [type(p) for p in found] == [AssignOrder, AssignOrder, RejectAssignment]
    assert isinstance(found[2], RejectAssignment)
    assert set(found[2].robots.values()) == {"CorridorFull"}
