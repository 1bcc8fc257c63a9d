"""What operators tell robots, and what holds robots and orders up."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.events import (
    OrderAssigned,
    OrderFaulted,
    OrderSuspended,
    OrderUnsuspended,
    RobotAlarmsCleared,
    RobotGivenUp,
    RobotReconnectAsked,
    RobotSoftStopLifted,
    RobotSoftStopped,
    SceneConfigured,
    StepStarted,
)
from ledger.ids import RobotName
from ledger.link import ONCE, Instruct, Instruction, InstructionKind, Reconnect, Report
from ledger.scene import RobotConfig
from ledger.scene_config import SceneConfig
from ledger.state import Robot
from scheduler.instructions import ONCE_MS_MAX, due
from tests.scheduler.small_shift import Shift
from tests.scheduler.small_site import SCENE, added, carry, imported

A = RobotName("A")


def report(obeyed: int) -> Report:
    return Report(
        scene=SCENE, robot=A, number=1, at_ms=0, area=1, x_m=0, y_m=0, heading_rad=0, obeyed=obeyed
    )


@given(
    kinds=st.lists(st.sampled_from(InstructionKind), unique=True),
    obeyed=st.integers(0, 5),
    now_ms=st.integers(0, 2 * ONCE_MS_MAX),
    online=st.booleans(),
)
def test_what_is_not_confirmed_is_due_unless_it_was_for_the_moment(
    kinds: list[InstructionKind], obeyed: int, now_ms: int, online: bool
) -> None:
    told = tuple(Instruction(kind=kind, number=n, at_ms=0) for n, kind in enumerate(kinds, 1))
    config = RobotConfig(name=A)
    robot = Robot(
        scene=SCENE, config=config, online=online, bins=(), idle_since_ms=0, instructions=told
    )
    left = [
        i
        for i in told
        if i.number > obeyed and (i.kind not in ONCE or now_ms <= ONCE_MS_MAX) and online
    ]
    found = due(robot, report(obeyed), now_ms)
    assert (list(found.instructions) if found else []) == left
    assert due(robot, None, now_ms) is None


def shift(*robots: tuple[str, float]) -> Shift:
    work = Shift(imported(), *(added(name) for name, _ in robots))
    for name, x_m in robots:
        work.robots.place(name, x_m)
    work.run(1)
    return work


def told(work: Shift, kind: type) -> list[object]:
    return [message for message in work.robots.told if isinstance(message, kind)]


def test_an_instruction_is_told_every_second_until_the_robot_confirms_it() -> None:
    work = shift(("A", 0.0))
    work.happen(RobotSoftStopped(scene=SCENE, robot=A))
    work.run(3)
    assert len(told(work, Instruct)) == 3
    work.happen(RobotSoftStopLifted(scene=SCENE, robot=A))
    work.run(0.1)
    newest = told(work, Instruct)[-1]
    assert [(i.kind, i.on) for i in newest.instructions] == [("SoftStop", False)]
    work.robots.set("A", obeyed=newest.instructions[-1].number)
    work.run(0.2)
    count = len(told(work, Instruct))
    work.run(5)
    work.restart()
    work.run(5)
    assert len(told(work, Instruct)) == count


def test_an_instruction_for_the_moment_is_not_carried_out_much_later() -> None:
    work = shift(("A", 0.0))
    work.mute = {"A"}
    work.run(12)
    work.happen(RobotAlarmsCleared(scene=SCENE, robot=A))
    work.run(ONCE_MS_MAX / 1000)
    assert not told(work, Instruct), "nobody is told who does not answer"
    work.mute = set()
    work.run(5)
    assert not told(work, Instruct)


@pytest.mark.parametrize(
    ("state", "why"),
    [
        ({"soft_stop": True}, "RobotSoftStopped"),
        ({"emergency_stop": True}, "RobotEmergencyStop"),
        ({"paused": True}, "RobotPaused"),
        ({"controller": ""}, "RobotNotControlled"),
        ({"controller": "Roboshop"}, "RobotNotControlled"),
    ],
)
def test_a_robot_that_would_not_move_gets_no_order_no_goal_and_no_push(
    state: dict[str, object], why: str
) -> None:
    work = shift(("A", 0.0))
    work.happen(carry(1, "B5", "B6"))
    assert work.run(5, lambda: bool(work.happened(StepStarted)))
    work.happen(carry(2, "B5", "B6"))
    work.robots.set("A", **state)
    work.run(2)
    assert not work.traffic[1].goals
    assert "A" in work.traffic[1].busy
    assert work.order(1).execution_reject.code == why
    assert work.order(1).execution_reject.robots == {"A": why}
    work.run(10)
    assert work.order(2).allocation_reject.robots == {"A": why}
    back = {"soft_stop": False, "emergency_stop": False, "paused": False}
    work.robots.set("A", **back, controller="fleetledger")
    assert work.run(90, lambda: not work.order(1) and not work.order(2))


def test_a_suspended_order_gets_no_robot_until_it_may_go_on() -> None:
    work = shift(("A", 0.0))
    work.happen(carry(1, "B5", "B6"))
    id_ = work.order(1).id
    work.happen(OrderSuspended(scene=SCENE, order=id_), carry(2, "B7", "B8"))
    assert work.run(90, lambda: work.order(2) is None)
    assert work.order(1).allocation_reject.code == "OrderSuspended"
    work.happen(OrderUnsuspended(scene=SCENE, order=id_))
    assert work.run(90, lambda: work.order(1) is None)


@pytest.mark.parametrize("at_s", [1.0, 4.0, 7.0, 9.0])
def test_a_robot_neither_drives_nor_acts_for_a_suspended_order(at_s: float) -> None:
    work = shift(("A", 0.0))
    work.happen(carry(1, "B5", "B9"))
    work.run(at_s)
    order = work.order(1)
    work.happen(OrderSuspended(scene=SCENE, order=order.id))
    work.run(4)  # an action under way comes to its end
    at_m, acts = work.robots.reports[A].x_m, len(work.robots.told)
    work.run(40)
    assert (work.robots.reports[A].x_m, len(work.robots.told)) == (at_m, acts)
    assert work.order(1).execution_reject.code == "OrderSuspended"
    work.happen(OrderUnsuspended(scene=SCENE, order=order.id))
    work.run(1)
    assert work.order(1).execution_reject is None
    assert work.run(60, lambda: work.order(1) is None)


def test_a_faulted_order_leads_nowhere() -> None:
    work = shift(("A", 0.0))
    work.happen(carry(1, "B15", "B16"))
    work.run(3)
    fault = OrderFaulted(scene=SCENE, order=work.order(1).id, reason="NavigationCancelled")
    work.happen(fault)
    work.run(1)
    assert not work.traffic[1].goals
    assert "A" not in work.traffic[1].busy, "it may make way"


def test_a_lost_robot_is_reached_for_so_often_and_then_given_up() -> None:
    work = shift(("A", 0.0))
    config = SceneConfig(state_failures_to_reconnect=3, reconnects_max=2, parking_paused=True)
    work.happen(SceneConfigured(scene=SCENE, config=config))
    work.robots.told.clear()
    work.mute = {"A"}
    work.run(30)
    assert len(told(work, Reconnect)) == 2
    assert len(work.happened(RobotGivenUp)) == 1
    work.run(30)
    assert len(told(work, Reconnect)) == 2
    work.happen(RobotReconnectAsked(scene=SCENE, robot=A))
    work.run(0.2)
    assert len(told(work, Reconnect)) == 3
    work.mute = set()
    work.run(1)
    assert work.robot("A").online
    assert not work.robot("A").given_up
    work.run(10)
    assert len(told(work, Reconnect)) == 3


def test_who_asks_is_served_once_where_nobody_is_reached_for_by_itself() -> None:
    work = shift(("A", 0.0))
    work.happen(
        SceneConfigured(scene=SCENE, config=SceneConfig(reconnects_max=0, parking_paused=True))
    )
    work.robots.told.clear()
    work.mute = {"A"}
    work.run(15)
    assert not told(work, Reconnect)
    assert work.robot("A").given_up
    work.happen(RobotReconnectAsked(scene=SCENE, robot=A))
    work.run(1)
    assert len(told(work, Reconnect)) == 1


def test_a_stopped_robot_gives_up_what_it_has_not_loaded_to_another_in_time() -> None:
    work = shift(("A", 0.0), ("B", 19.0))
    work.happen(carry(1, "B5", "B6"))
    assert work.run(5, lambda: work.order(1).robot == "A")
    work.robots.set("A", soft_stop=True)
    assert work.run(90, lambda: work.order(1) is None)
    assert [e.robot for e in work.happened(OrderAssigned) if e.order.endswith("1")] == ["A", "B"]
