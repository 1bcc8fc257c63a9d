"""Each charging level decides as it is set: for all robots, or for those of one group."""

from typing import Any

import pytest

from ledger.ids import RobotName
from ledger.proposals import CreateSystemOrder, FinishStep, StartStep
from ledger.scene_config import ChargingConfig, ChargingLevels, SceneConfig
from ledger.state import OrderKind
from scheduler.dispatch.charge import charge
from scheduler.dispatch.continue_ import continue_
from scheduler.dispatch.eligibility import charge_arguments, standing_reason
from scheduler.dispatch.park import park
from scheduler.dispatch.reasons import Why
from tests.scheduler.dispatch.views import NOW_MS, Situation
from tests.scheduler.small_site import LENGTH, SCENE

A = RobotName("A")
C0 = float(LENGTH + 4)  # where the first charging point is
FOR_ALL, FOR_ITS_GROUP, FOR_OTHERS = "all", "its group", "other groups"


def set_to(whose: str, **levels: Any) -> Situation:
    """A robot of group 1 that has rested for long, 40 % full, where levels are as said."""
    changed = ChargingLevels(**levels)
    charging = {
        FOR_ALL: ChargingConfig(default=changed),
        FOR_ITS_GROUP: ChargingConfig(by_group={1: changed}),
        FOR_OTHERS: ChargingConfig(by_group={0: changed}),
    }[whose]
    situation = Situation(SceneConfig(charging=charging))
    situation.robot("A", 3.0, group=1)
    situation.report("A", 3.0, battery_ratio=0.4)
    return situation


def at_the_charger(situation: Situation, *, forced: bool) -> None:
    order = CreateSystemOrder(
        scene=SCENE,
        kind=OrderKind.CHARGING,
        robot=A,
        location="C0",
        cost_s=0.0,
        arguments=charge_arguments(forced=forced),
    )
    situation.core.propose([order])
    (id_,) = situation.core.fleet.orders
    situation.core.propose([StartStep(scene=SCENE, order=id_, step=0, robot=A)])
    situation.report("A", C0, battery_ratio=0.4, charging=True)


def why(situation: Situation) -> Why | None:
    view = situation.view()
    return standing_reason(view, view.robots[A], NOW_MS)


def charges(situation: Situation, now_ms: int = NOW_MS) -> bool:
    return bool(charge(situation.view(), (), now_ms))


@pytest.mark.parametrize("whose", [FOR_ALL, FOR_ITS_GROUP, FOR_OTHERS])
@pytest.mark.parametrize("ratio", [0.39, 0.41])
def test_below_charge_only_a_robot_takes_no_order(whose: str, ratio: float) -> None:
    low = whose != FOR_OTHERS and ratio > 0.4
    levels = {"charge_only": ratio, "charge_need": 0.5}
    assert (why(set_to(whose, **levels)) == Why.ROBOT_BATTERY_LOW) is low


@pytest.mark.parametrize("whose", [FOR_ALL, FOR_ITS_GROUP, FOR_OTHERS])
@pytest.mark.parametrize("ratio", [0.39, 0.41])
def test_below_charge_need_an_idle_robot_charges(whose: str, ratio: float) -> None:
    assert charges(set_to(whose, charge_need=ratio)) is (whose != FOR_OTHERS and ratio > 0.4)


@pytest.mark.parametrize("whose", [FOR_ALL, FOR_ITS_GROUP, FOR_OTHERS])
@pytest.mark.parametrize("ratio", [0.39, 0.41])
def test_a_forced_charge_lasts_to_charge_ok(whose: str, ratio: float) -> None:
    situation = set_to(whose, charge_ok=ratio)
    at_the_charger(situation, forced=True)
    lasts = whose == FOR_OTHERS or ratio > 0.4  # there it is 80 %
    assert (why(situation) == Why.ROBOT_BATTERY_LOW) is lasts


@pytest.mark.parametrize("whose", [FOR_ALL, FOR_ITS_GROUP, FOR_OTHERS])
@pytest.mark.parametrize("ratio", [0.39, 0.41])
def test_charging_ends_at_charge_full(whose: str, ratio: float) -> None:
    situation = set_to(whose, charge_full=ratio)
    at_the_charger(situation, forced=False)
    full = whose != FOR_OTHERS and ratio < 0.4
    found = continue_(situation.view(), (), NOW_MS)
    assert any(isinstance(p, FinishStep) for p in found) is full


@pytest.mark.parametrize("ratio", [0.39, 0.41])
def test_above_charge_full_a_robot_leaves_the_charger_at_once(ratio: float) -> None:
    situation = set_to(FOR_ALL, charge_full=ratio)
    situation.report("A", C0, battery_ratio=0.4)
    situation.still_since_ms["A"] = NOW_MS - 1
    assert bool(park(situation.view(), (), NOW_MS)) is (ratio < 0.4)


@pytest.mark.parametrize("whose", [FOR_ALL, FOR_ITS_GROUP, FOR_OTHERS])
@pytest.mark.parametrize("seconds", [19, 21])
def test_a_charge_lasts_at_least_its_shortest_time(whose: str, seconds: int) -> None:
    situation = set_to(whose, charging_min_s=seconds)
    at_the_charger(situation, forced=False)
    situation.charging_since_ms["A"] = NOW_MS - 20_000
    lasts = whose == FOR_OTHERS or seconds > 20  # there it is a minute
    assert (why(situation) == Why.ROBOT_CHARGING) is lasts


@pytest.mark.parametrize("whose", [FOR_ALL, FOR_ITS_GROUP, FOR_OTHERS])
@pytest.mark.parametrize("seconds", [0, 5, 21])
def test_a_robot_charges_when_it_has_been_idle_for_so_long(whose: str, seconds: int) -> None:
    situation = set_to(whose, idle_s=seconds)
    situation.report("A", 3.0, battery_ratio=0.2)  # below charge_need
    idle_since_ms = situation.core.fleet.robots[f"{SCENE}/A"].idle_since_ms  # type: ignore[index]
    wanted = 10 if whose == FOR_OTHERS else seconds
    assert charges(situation, idle_since_ms + wanted * 1_000)
    assert not charges(situation, idle_since_ms + wanted * 1_000 - 1)
