"""What robots do where they stand."""

from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import RobotName
from ledger.link import Act, ActionPhase
from sim.actions import DURATION_S_MIN, DURATION_S_RANGE, Actions, duration_s


def act(id: str, name: str = "Load") -> Act:
    return Act(robot=RobotName("AMB-01"), id=id, name=name)


def phase(actions: Actions) -> ActionPhase | None:
    return actions.report.phase if actions.report is not None else None


def finished(id: str, name: str = "Load") -> Actions:
    actions = Actions()
    actions.begin(act(id, name), problem=None)
    actions.work(10.0)
    return actions


@given(name=st.text())
def test_an_action_takes_its_time(name: str) -> None:
    assert DURATION_S_MIN <= duration_s(name) <= DURATION_S_MIN + DURATION_S_RANGE
    actions = Actions()
    actions.begin(act("a", name), problem=None)
    if name == "Charge":
        return
    actions.work(duration_s(name) - 0.1)
    assert phase(actions) is ActionPhase.RUNNING
    actions.work(0.2)
    assert phase(actions) is ActionPhase.DONE


def test_a_repeated_action_is_not_done_twice() -> None:
    actions = finished("a")
    actions.begin(act("a"), problem=None)
    assert phase(actions) is ActionPhase.DONE
    actions.begin(act("b"), problem=None)
    actions.work(10.0)
    actions.begin(act("a"), problem=None)
    assert actions.report is not None
    assert (actions.report.id, actions.report.phase) == ("a", ActionPhase.DONE)


def test_another_action_is_not_heard_while_one_runs() -> None:
    actions = Actions()
    actions.begin(act("a"), problem=None)
    actions.begin(act("b"), problem=None)
    assert actions.newest == "a"


def test_a_cancelled_action_has_failed() -> None:
    actions = Actions()
    actions.begin(act("a"), problem=None)
    actions.cancel("b")
    assert phase(actions) is ActionPhase.RUNNING
    actions.cancel("a")
    assert phase(actions) is ActionPhase.FAILED


def test_cancelled_charging_has_ended_well() -> None:
    actions = Actions()
    actions.begin(act("a", "Charge"), problem=None)
    actions.work(10_000.0)
    assert actions.charging
    actions.cancel("a")
    assert phase(actions) is ActionPhase.DONE
    assert not actions.charging


def test_a_failure_that_was_asked_for_happens_once() -> None:
    actions = Actions()
    actions.failing.add("Load")
    actions.begin(act("a"), problem=None)
    assert phase(actions) is ActionPhase.FAILED
    actions.begin(act("b"), problem=None)
    assert phase(actions) is ActionPhase.RUNNING
