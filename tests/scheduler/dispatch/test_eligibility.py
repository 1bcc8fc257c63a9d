"""Why a robot takes no order: one code for each reason."""

from collections.abc import Callable

import pytest

from ledger.events import RobotDisabled, RobotWentOffDuty
from ledger.ids import RobotName
from ledger.link import Alarm, AlarmLevel
from ledger.proposals import AssignOrder, CreateSystemOrder, StartStep
from ledger.scene_config import SceneConfig
from ledger.state import OrderKind, StepTask
from scheduler.dispatch.eligibility import (
    charge_arguments,
    free_bins,
    must_charge,
    standing_reason,
    wants,
)
from scheduler.dispatch.reasons import Why
from scheduler.view import RobotView
from tests.scheduler.dispatch.views import NOW_MS, Situation
from tests.scheduler.small_site import SCENE, carry, order

A = RobotName("A")


def only_robot(situation: Situation) -> RobotView:
    return situation.view().robots[A]


def why(situation: Situation) -> Why | None:
    view = situation.view()
    return standing_reason(view, view.robots[A], NOW_MS)


def give(situation: Situation, number: int, bin: int = 0) -> None:
    id_ = next(i for i in situation.core.fleet.orders if i.endswith(f"{number:06}"))
    situation.core.propose([AssignOrder(scene=SCENE, order=id_, robot=A, bin=bin, cost_s=0.0)])


def charging(situation: Situation, *, forced: bool) -> None:
    arguments = charge_arguments(forced=forced)
    situation.core.propose(
        [
            CreateSystemOrder(
                scene=SCENE,
                kind=OrderKind.CHARGING,
                robot=A,
                location="C0",
                cost_s=0.0,
                arguments=arguments,
            )
        ]
    )


def disable(s: Situation) -> None:
    s.happen(RobotDisabled(scene=SCENE, robot=A))


def off_duty(s: Situation) -> None:
    s.happen(RobotWentOffDuty(scene=SCENE, robot=A))


def unready(s: Situation) -> None:
    s.unready.add("A")


def alarmed(s: Situation) -> None:
    s.report("A", 0.0, alarms=(Alarm(level=AlarmLevel.FATAL, code="1", message="m"),))


def stopped(s: Situation) -> None:
    s.report("A", 0.0, emergency_stop=True)


def empty(s: Situation) -> None:
    s.report("A", 0.0, battery_ratio=0.14)


def full_up(s: Situation) -> None:
    s.happen(carry(1, "B1", "B2"))
    give(s, 1)


@pytest.mark.parametrize(
    ("happens", "code"),
    [
        (disable, "RobotDisabled"),
        (off_duty, "RobotOffDuty"),
        (unready, "RobotNotReady"),
        (alarmed, "RobotFault"),
        (stopped, "RobotEmergencyStop"),
        (empty, "RobotBatteryLow"),
        (full_up, "RobotNoMoreBin"),
    ],
)
def test_a_robot_has_one_code_for_its_trouble(
    happens: Callable[[Situation], None], code: str
) -> None:
    situation = Situation()
    situation.robot("A", 0.0)
    assert why(situation) is None
    happens(situation)
    assert why(situation) == code


def test_a_robot_that_does_not_answer_is_offline() -> None:
    situation = Situation()
    situation.robot("A", 0.0, online=False)
    assert why(situation) == Why.ROBOT_OFFLINE


def test_alarms_matter_only_where_the_scene_says_so() -> None:
    situation = Situation(SceneConfig(pause_on_robot_error=False))
    situation.robot("A", 0.0)
    alarmed(situation)
    assert why(situation) is None


def test_a_bound_robot_takes_no_other_order_though_it_has_a_bin() -> None:
    situation = Situation()
    situation.robot("A", 0.0, bin_count=2)
    situation.happen(order(1, StepTask(location="W3", keeps_robot=True), sealed=False))
    give(situation, 1)
    assert why(situation) is None
    id_ = only_robot(situation).orders[0].id
    situation.core.propose([StartStep(scene=SCENE, order=id_, step=0, robot=A)])
    assert why(situation) == Why.ROBOT_BUSY_KEEPS_ORDER


@pytest.mark.parametrize(
    ("battery_ratio", "forced", "must"),
    [(0.1, False, True), (0.2, False, False), (0.2, True, True), (0.79, True, True),
     (0.8, True, False)],
)  # fmt: skip
def test_forced_charging_lasts_from_charge_only_to_charge_ok(
    battery_ratio: float, forced: bool, must: bool
) -> None:
    situation = Situation()
    situation.robot("A", 0.0)
    charging(situation, forced=forced)
    situation.report("A", 0.0, battery_ratio=battery_ratio)
    assert must_charge(situation.view(), only_robot(situation)) is must


def test_charging_is_not_broken_off_before_its_time() -> None:
    situation = Situation()
    situation.robot("A", 25.0)
    charging(situation, forced=False)
    situation.charging_since_ms["A"] = NOW_MS - 59_000
    assert why(situation) == Why.ROBOT_CHARGING
    situation.charging_since_ms["A"] = NOW_MS - 60_000
    assert why(situation) is None


def test_the_bin_of_a_system_order_is_used_first() -> None:
    situation = Situation()
    situation.robot("A", 0.0, bin_count=3)
    situation.happen(carry(1, "B1", "B2"))
    give(situation, 1, bin=1)
    assert free_bins(only_robot(situation)) == [0, 2]
    situation = Situation()
    situation.robot("A", 0.0, bin_count=3)
    charging(situation, forced=False)
    assert free_bins(only_robot(situation)) == [0, 1, 2]


def test_names_and_groups_of_wanted_robots_add_up() -> None:
    situation = Situation()
    situation.robot("A", 0.0, group=1)
    view = situation.view()
    robot = view.robots[A]
    wanted = [
        carry(1, "B1", "B2"),
        carry(2, "B1", "B2", wanted_robots=("A",)),
        carry(3, "B1", "B2", wanted_groups=("forks",)),
        carry(4, "B1", "B2", wanted_robots=("B",), wanted_groups=("forks",)),
        carry(5, "B1", "B2", wanted_robots=("B",), wanted_groups=("AMR",)),
    ]
    situation.happen(*wanted)
    orders = situation.core.fleet.orders.values()
    assert [wants(view, o, robot) for o in orders] == [True, True, True, True, False]
