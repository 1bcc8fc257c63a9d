"""The scheduler as a whole, on a small site without collisions."""

import pytest

from ledger.events import (
    AssignmentRejected,
    ExecutionRejected,
    OrderAssigned,
    OrderCancelled,
    OrderFaulted,
    OrderFinished,
    OrderRetried,
    OrderSealed,
    OrderWithdrawn,
    RobotConnected,
    RobotDisabled,
    RobotDisconnected,
    RobotEnabled,
    RobotRemoved,
    SceneConfigured,
    SceneMapReplaced,
    StepsAdded,
    StepStarted,
)
from ledger.ids import OrderId, RobotName
from ledger.link import Act, Cancel
from ledger.scene_config import SceneConfig
from ledger.state import OrderKind, OrderStatus, StepTask
from tests.scheduler.small_core import Refused
from tests.scheduler.small_shift import Shift
from tests.scheduler.small_site import SCENE, added, area, carry, imported, order


def shift(
    *robots: tuple[str, float], config: SceneConfig | None = None, lenient: bool = False
) -> Shift:
    found = Shift(imported(config), *(added(name) for name, _ in robots), lenient=lenient)
    for name, x_m in robots:
        found.robots.place(name, x_m)
    return found


def test_an_order_is_carried_from_bin_to_bin() -> None:
    work = shift(("A", 0.0))
    work.happen(carry(1, "B5", "B9"))
    assert work.run(60, lambda: work.order(1) is None)
    assert len(work.happened(OrderFinished)) == 1
    acts = [m for m in work.robots.told if isinstance(m, Act)]
    assert [(a.name, a.id) for a in acts] == [
        ("Load", "TO20260101-000001-Step0"),
        ("Unload", "TO20260101-000001-Step1"),
    ]
    assert acts[0].arguments == '{"height":1,"operation":"JackLoad"}'


def test_nobody_moves_before_all_that_may_be_there_have_spoken() -> None:
    work = shift(("A", 0.0), ("B", 3.0))
    work.mute = {"B"}
    work.happen(carry(1, "B5", "B9"))
    work.run(9)
    assert not work.happened(StepStarted)
    assert work.run(5, lambda: bool(work.happened(StepStarted)))  # B is not waited for any longer


def test_a_silent_robot_is_disconnected_and_its_order_goes_to_another() -> None:
    work = shift(("A", 4.0), ("B", 19.0))
    work.happen(carry(1, "B5", "B9"))
    work.run(0.6, lambda: work.order(1) is not None and work.order(1).robot == "A")
    work.traffic[1].stuck.add(RobotName("A"))
    work.mute = {"A"}
    assert work.run(60, lambda: work.order(1) is None)
    assert [e.robot for e in work.happened(RobotDisconnected)] == ["A"]
    assert [e.robot for e in work.happened(OrderWithdrawn)] == ["A"]
    assert "A" in work.traffic[1].known  # it still stands there


def test_a_token_that_vanishes_disconnects_at_once() -> None:
    work = shift(("A", 0.0))
    work.run(1)
    work.scheduler.on_alive(SCENE, RobotName("A"), False)
    work.run(0.2)
    assert not work.robot("A").online
    work.scheduler.on_alive(SCENE, RobotName("A"), True)
    work.run(0.2)
    assert work.robot("A").online


def test_an_unsealed_order_waits_for_more_and_can_be_sealed_later() -> None:
    work = shift(("A", 0.0))
    work.happen(order(1, StepTask(location="W3"), sealed=False))
    assert work.run(30, lambda: work.order(1).status is OrderStatus.PENDING)
    assert not work.traffic[1].goals
    id_ = work.order(1).id
    work.happen(StepsAdded(scene=SCENE, order=id_, tasks=(StepTask(location="W6"),)))
    work.happen(OrderSealed(scene=SCENE, order=id_))
    assert work.run(30, lambda: work.order(1) is None)


def test_a_failed_action_faults_the_order_until_it_is_retried() -> None:
    work = shift(("A", 0.0))
    work.robots.failing.add("Load")
    work.happen(carry(1, "B2", "B9"))
    assert work.run(30, lambda: bool(work.happened(OrderFaulted)))
    work.run(5)
    assert len(work.happened(OrderFaulted)) == 1
    assert "A" in work.traffic[1].busy  # it may hold half a load: nobody pushes it
    work.robots.failing.clear()
    work.happen(OrderRetried(scene=SCENE, order=work.order(1).id))
    assert work.run(60, lambda: work.order(1) is None)
    ids = [m.id for m in work.robots.told if isinstance(m, Act)]
    assert ids == [
        "TO20260101-000001-Step0",
        "TO20260101-000001-Step0#1",
        "TO20260101-000001-Step1#1",
    ]


def test_a_robot_is_told_to_act_only_when_its_last_creep_is_over() -> None:
    work = shift(("A", 5.0))
    work.robots.set("A", speed_mps=0.005)
    work.happen(carry(1, "B5", "B9"))
    work.run(0.5)
    assert not work.robots.told
    work.robots.set("A", speed_mps=0.0)
    work.run(0.2)
    assert work.robots.told


@pytest.mark.parametrize("keep", [False, True])
def test_a_cancelled_order_stops_its_action_unless_the_scene_says_otherwise(keep: bool) -> None:
    work = shift(("A", 0.0), config=SceneConfig(keep_robot_on_cancel=keep))
    work.happen(carry(1, "B0", "B9"))
    assert work.run(30, lambda: any(isinstance(m, Act) for m in work.robots.told))
    work.happen(OrderCancelled(scene=SCENE, order=work.order(1).id), carry(2, "B4", "B5"))
    work.tick()
    assert any(isinstance(m, Cancel) for m in work.robots.told) is not keep
    assert ("A" in work.traffic[1].busy) or not keep
    assert work.run(60, lambda: work.order(2) is None)


def test_an_idle_robot_parks_and_is_called_away_by_an_order() -> None:
    work = shift(("A", 10.0))
    work.run(25)
    system = [o for o in work.fleet.orders.values() if o.kind is OrderKind.PARKING]
    made = [e for e in work.happened(OrderAssigned) if e.order.endswith("P")]
    assert len(made) == 1 and (system or work.happened(OrderFinished))
    work.happen(carry(1, "B5", "B9"))
    assert work.run(60, lambda: work.order(1) is None)


def test_a_parked_robot_stays_parked() -> None:
    work = shift(("A", 10.0), ("B", 11.0))
    work.run(120)
    assert len(work.happened(OrderAssigned)) == 2
    assert {work.robots.reports[RobotName(n)].point for n in "AB"} == {"P0", "P1"}


def test_a_robot_that_must_charge_does_nothing_else_until_it_may() -> None:
    work = shift(("A", 10.0))
    work.robots.set("A", battery_ratio=0.1)
    work.happen(carry(1, "B5", "B9"))
    assert work.run(60, lambda: work.robots.reports[RobotName("A")].charging)
    assert work.order(1).allocation_reject.robots == {"A": "RobotBatteryLow"}
    assert work.run(120, lambda: work.order(1) is None)
    assert work.robots.reports[RobotName("A")].battery_ratio >= 0.8
    assert any(isinstance(m, Cancel) for m in work.robots.told)


def test_charging_ends_when_the_battery_is_full_and_the_charger_is_left() -> None:
    work = shift(("A", 10.0))
    work.robots.set("A", battery_ratio=0.25)
    assert work.run(60, lambda: work.robots.reports[RobotName("A")].charging)
    assert work.run(200, lambda: work.robots.reports[RobotName("A")].point == "P3")
    assert work.robots.reports[RobotName("A")].battery_ratio >= 0.98


def test_what_the_core_refuses_is_not_asked_every_tick() -> None:
    work = shift(("A", 0.0), lenient=True)
    work.run(1)
    work.core.decide = _refuse  # type: ignore[method-assign]
    work.happen(carry(1, "B5", "B9"))
    work.run(60)
    assert 3 <= len(work.core.refused) <= 25  # AssignOrder after 0, 1, 3, 7, 15, 31 s; parking too


def _refuse(proposal: object) -> tuple[()]:
    raise Refused(proposal)


@pytest.mark.parametrize("at_s", [1, 3, 5.5, 7, 9, 11, 13])
def test_a_restarted_scheduler_goes_on_where_it_was(at_s: float) -> None:
    work = shift(("A", 0.0), ("B", 19.0))
    work.happen(carry(1, "B5", "B9"), carry(2, "B15", "B11"))
    work.run(at_s)
    work.restart()
    assert work.run(80, lambda: not work.order(1) and not work.order(2))
    ids = [m.id for m in work.robots.told if isinstance(m, Act)]
    assert len(set(ids)) == 4
    assert not work.happened(RobotDisconnected)
    assert not work.happened(ExecutionRejected)


def test_a_disabled_robot_stays_an_obstacle_and_takes_nothing() -> None:
    work = shift(("A", 0.0))
    work.run(1)
    work.happen(RobotDisabled(scene=SCENE, robot=RobotName("A")), carry(1, "B5", "B9"))
    work.run(20)
    assert "A" in work.traffic[1].gone
    assert work.order(1).allocation_reject.robots == {"A": "RobotDisabled"}
    work.happen(RobotEnabled(scene=SCENE, robot=RobotName("A")))
    assert work.run(60, lambda: work.order(1) is None)


def test_a_removed_robot_is_forgotten() -> None:
    work = shift(("A", 0.0))
    work.run(1)
    work.happen(RobotRemoved(scene=SCENE, robot=RobotName("A")))
    work.run(1)
    assert not work.traffic[1].known
    work.happen(carry(1, "B5", "B9"))
    work.run(2)
    assert work.order(1).allocation_reject.code == "NoRobot"


def test_a_new_map_is_driven_on_at_once() -> None:
    work = shift(("A", 0.0))
    work.happen(carry(1, "B5", "B9"))
    work.run(3)
    before = work.traffic[1]
    scene = work.fleet.scenes[SCENE]
    work.happen(
        SceneMapReplaced(scene=SCENE, digest="e", areas=(area(parking=1),), groups=scene.groups)
    )
    assert work.run(60, lambda: work.order(1) is None)
    assert work.traffic[1] is not before


def test_paused_traffic_moves_nobody_and_says_so() -> None:
    work = shift(("A", 0.0))
    work.happen(SceneConfigured(scene=SCENE, config=SceneConfig(traffic_paused=True)))
    work.happen(carry(1, "B5", "B9"))
    work.run(5)
    assert work.robots.reports[RobotName("A")].x_m == 0.0
    assert work.order(1).execution_reject.code == "TrafficPaused"
    work.happen(SceneConfigured(scene=SCENE, config=SceneConfig()))
    work.run(1)
    assert work.order(1).execution_reject is None


def test_a_robot_that_does_not_get_on_says_why_and_takes_it_back() -> None:
    work = shift(("A", 0.0))
    work.happen(carry(1, "B5", "B9"))
    work.run(1)
    work.traffic[1].stuck.add(RobotName("A"))
    work.run(20)
    assert work.order(1).execution_reject.code == "RobotBlocked"
    assert len(work.happened(ExecutionRejected)) == 1
    work.traffic[1].stuck.clear()
    work.run(1)
    assert work.order(1).execution_reject is None


def test_who_stands_on_the_goal_of_a_blocked_robot_is_named() -> None:
    work = shift(("A", 0.0), ("B", 5.0))
    work.run(1)
    work.happen(RobotDisabled(scene=SCENE, robot=RobotName("B")), carry(1, "B5", "B9"))
    work.run(1)
    work.traffic[1].stuck.add(RobotName("A"))
    work.run(12)
    assert work.order(1).execution_reject.robots == {"B": "RobotDisabled"}


def test_waiting_orders_get_one_refusal_as_long_as_nothing_changes() -> None:
    work = shift(("A", 0.0))
    work.run(2)
    work.happen(carry(1, "B5", "B19"), carry(2, "B5", "B9"))
    work.run(20)
    assert work.order(2).allocation_reject.robots == {"A": "RobotTakenByOther"}
    assert len(work.happened(AssignmentRejected)) == 1


def test_reports_of_strangers_leave_nothing_behind() -> None:
    work = shift(("A", 0.0))
    work.robots.place("X", 3.0)
    work.run(2)
    assert work.traffic[1].known.keys() == {"A"}
    assert [e.robot for e in work.happened(RobotConnected)] == ["A"]


def test_the_same_shift_gives_the_same_events() -> None:
    def events() -> bytes:
        work = shift(("A", 0.0), ("B", 7.0), ("C", 19.0))
        work.happen(*(carry(n, f"B{n * 7 % 20}", f"B{n * 3 % 20}") for n in range(1, 8)))
        work.run(100)
        return work.fleet.canonical() + repr(work.core.events).encode()

    assert events() == events()


def test_an_order_of_a_scene_that_appears_later_is_done_too() -> None:
    work = Shift()
    work.run(1)
    work.happen(imported(), added("A"), carry(1, "B1", "B2"))
    work.robots.place("A", 0.0)
    assert work.run(60, lambda: OrderId("TO20260101-000001") not in work.fleet.orders)


def test_those_who_look_on_are_told_what_changes_and_now_and_then_everything() -> None:
    work = shift(("A", 0.0), ("B", 5.0))
    work.run(5)  # everybody has been placed, nobody has anything to do
    shown: list[list[str]] = []
    work.on_plans = lambda plans: shown.append(sorted(plan.robot for plan in plans))

    work.run(10)

    assert 4 <= len(shown) <= 6, "everything every two seconds, and nothing else happened"
    assert all(robots == ["A", "B"] for robots in shown)

    shown.clear()
    work.happen(carry(1, "B0", "B9"))
    work.run(3)

    assert ["A"] in shown, "B's plan has not changed"
