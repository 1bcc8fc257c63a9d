"""All phases together, on situations of any kind, time after time."""

from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from ledger.link import ActionPhase, ActionReport
from ledger.state import StepStatus
from scheduler.dispatch.execution import due_action, goals
from scheduler.dispatch.phases import dispatch
from tests.scheduler.dispatch.views import NOW_MS, Situation, situations


@settings(max_examples=25)
@given(situations(), st.integers(0, 2**32))
def test_the_core_accepts_whatever_is_proposed_wherever_robots_happen_to_be(
    situation: Situation, seed: int
) -> None:
    chance = Random(seed)
    for n in range(8):
        now_ms = situation.core.now_ms = NOW_MS + n * 2_000
        situation.core.propose(dispatch(situation.view(reallocate=n % 2 == 0), now_ms))
        _let_robots_obey(situation, chance)
        for robot in situation.core.fleet.robots.values():
            assert len(robot.orders) <= len(robot.bins)
            orders = [situation.core.fleet.orders[o] for o in robot.orders]
            begun = [s for o in orders for s in o.steps if s.status is StepStatus.EXECUTING]
            assert len(begun) <= 1


def _let_robots_obey(situation: Situation, chance: Random) -> None:
    view = situation.view()
    for name, goal in goals(view).items():
        if chance.random() < 0.7:
            x_m = view.places[goal.point].point.x_m
            old = situation.reports[name]
            situation.reports[name] = replace(old, x_m=x_m, point=goal.point)
    view = situation.view()
    for name, robot in view.robots.items():
        act = due_action(view, robot, situation.core.now_ms)
        if act is not None:
            phase = chance.choice(list(ActionPhase))
            old = situation.reports[name]
            situation.reports[name] = replace(old, action=ActionReport(id=act.id, phase=phase))


@given(situations())
def test_the_same_view_gives_the_same_proposals(situation: Situation) -> None:
    assert dispatch(situation.view(), NOW_MS) == dispatch(situation.view(), NOW_MS)
