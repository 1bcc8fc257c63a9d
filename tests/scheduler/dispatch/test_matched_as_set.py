"""Robots and orders are matched as settings, steps and key locations say."""

import pytest

from ledger.ids import RobotName
from ledger.proposals import AssignOrder, StartStep, WithdrawOrder
from ledger.scene_config import DispatchMethod, SceneConfig
from ledger.state import StepTask
from scheduler.dispatch.assign import assign
from tests.scheduler.dispatch.views import NOW_MS, Situation
from tests.scheduler.small_site import SCENE, carry, order

A = RobotName("A")


@pytest.mark.parametrize("allowed", [True, False])
def test_an_order_that_is_driven_to_goes_over_only_where_its_step_allows_it(allowed: bool) -> None:
    situation = Situation(SceneConfig(withdrawn_cost_min=5.0))
    situation.core.now_ms = NOW_MS
    situation.robot("A", 0.0)
    step = StepTask(location="W10", withdrawable=allowed)
    situation.happen(order(1, step))
    situation.core.propose(assign(situation.view(), (), NOW_MS))
    (id_,) = situation.core.fleet.orders
    situation.core.propose([StartStep(scene=SCENE, order=id_, step=0, robot=A)])
    situation.robot("B", 10.0)
    found = assign(situation.view(reallocate=True), (), NOW_MS)
    assert [type(p) for p in found] == ([WithdrawOrder, AssignOrder] if allowed else [])


@pytest.mark.parametrize(
    ("method", "pairs"),
    [
        (DispatchMethod.KM, {"1": "A", "2": "B"}),  # 5 + 13 s
        (DispatchMethod.GREEDY, {"1": "B", "2": "A"}),  # 1 + 19 s: the first has its best
    ],
)
def test_orders_are_matched_by_the_method_that_is_set(
    method: DispatchMethod, pairs: dict[str, str]
) -> None:
    situation = Situation(SceneConfig(dispatch_method=method))
    situation.core.now_ms = NOW_MS
    situation.robot("A", 0.0)
    situation.robot("B", 6.0)
    situation.happen(carry(1, "B5", "B0"), carry(2, "B19", "B0"))
    found = assign(situation.view(), (), NOW_MS)
    assert {p.order[-1]: p.robot for p in found if isinstance(p, AssignOrder)} == pairs


def test_an_order_without_steps_goes_to_who_is_nearest_to_its_first_key_location() -> None:
    for locations, robot in ((("B19", "B0"), "B"), (("B0", "B19"), "A")):
        situation = Situation()
        situation.core.now_ms = NOW_MS
        situation.robot("A", 0.0)
        situation.robot("B", 15.0)
        situation.happen(order(1, key_locations=locations, sealed=False))
        (found,) = assign(situation.view(), (), NOW_MS)
        assert isinstance(found, AssignOrder)
        assert found.robot == robot
