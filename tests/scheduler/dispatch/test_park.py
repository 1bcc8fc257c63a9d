"""Idle robots charge, park and make way."""

from ledger.events import OrderFinished, RobotWentOffDuty
from ledger.ids import RobotName
from ledger.proposals import AssignOrder, CreateSystemOrder, StartStep
from ledger.scene_config import SceneConfig
from ledger.state import OrderKind, StepTask
from scheduler.dispatch.charge import charge
from scheduler.dispatch.park import avoid, park
from tests.scheduler.dispatch.views import NOW_MS, Situation
from tests.scheduler.small_site import LENGTH, SCENE, order

P0, C0 = float(LENGTH), float(LENGTH + 4)  # where the first parking and charging points are


def made(found: list[object]) -> list[tuple[str, str, str]]:
    assert all(isinstance(p, CreateSystemOrder) for p in found)
    return [(p.kind, p.robot, p.location) for p in found]  # type: ignore[attr-defined]


def test_idle_robots_park_on_the_nearest_points_that_are_free() -> None:
    situation = Situation()
    situation.robot("A", 3.0)
    situation.robot("B", 4.0)
    situation.robot("C", P0)  # stands on P0
    assert made(park(situation.view(), (), NOW_MS)) == [
        ("Parking", "A", "P1"),
        ("Parking", "B", "P2"),
    ]


def test_there_are_no_more_parking_orders_than_points() -> None:
    situation = Situation(parking=1)
    for n in range(4):
        situation.robot(f"R{n}", float(n))
    found = park(situation.view(), (), NOW_MS)
    assert len(found) == 1
    situation.core.propose(found)
    assert park(situation.view(), (), NOW_MS) == []


def test_a_robot_that_has_just_come_to_rest_does_not_park_yet() -> None:
    situation = Situation()
    situation.robot("A", 3.0)
    situation.still_since_ms["A"] = NOW_MS - 9_000
    assert park(situation.view(), (), NOW_MS) == []


def test_parking_and_charging_can_be_paused() -> None:
    situation = Situation(SceneConfig(parking_paused=True, charging_paused=True))
    situation.robot("A", 3.0)
    situation.report("A", 3.0, battery_ratio=0.05)
    assert park(situation.view(), (), NOW_MS) == charge(situation.view(), (), NOW_MS) == []


def test_a_full_robot_leaves_the_charger_and_an_emptying_one_stays() -> None:
    situation = Situation()
    situation.robot("A", C0)
    situation.robot("B", C0 + 1)
    situation.report("B", C0 + 1, battery_ratio=0.2)
    assert made(park(situation.view(), (), NOW_MS)) == [("Parking", "A", "P3")]


def test_the_emptiest_robot_gets_the_last_charger() -> None:
    situation = Situation(charging=1)
    for name, battery_ratio in (("A", 0.2), ("B", 0.1), ("C", 0.9)):
        situation.robot(name, 3.0)
        situation.report(name, 3.0, battery_ratio=battery_ratio)
    (found,) = charge(situation.view(), (), NOW_MS)
    assert isinstance(found, CreateSystemOrder)
    assert (found.robot, found.location, found.kind) == ("B", "C0", OrderKind.CHARGING)
    assert found.arguments == '{"operation":"Charge","forced":true}'


def test_a_robot_that_may_charge_waits_until_it_has_been_idle() -> None:
    situation = Situation()
    situation.core.now_ms = NOW_MS - 5_000
    situation.robot("A", 3.0)
    situation.report("A", 3.0, battery_ratio=0.2)
    assert charge(situation.view(), (), NOW_MS) == []
    assert len(charge(situation.view(), (), NOW_MS + 5_000)) == 1


def test_off_duty_robots_still_park() -> None:
    situation = Situation()
    situation.robot("A", 3.0)
    situation.happen(RobotWentOffDuty(scene=SCENE, robot=RobotName("A")))
    assert len(park(situation.view(), (), NOW_MS)) == 1


def test_an_idle_robot_leaves_the_point_that_another_wants() -> None:
    situation = Situation()
    situation.robot("A", 3.0)
    situation.robot("B", 9.0)
    situation.happen(order(1, StepTask(location="W9")))
    (id_,) = situation.core.fleet.orders
    a = RobotName("A")
    situation.core.propose(
        [
            AssignOrder(scene=SCENE, order=id_, robot=a, bin=0, cost_s=6.0),
            StartStep(scene=SCENE, order=id_, step=0, robot=a),
        ]
    )
    assert made(avoid(situation.view(), (), NOW_MS)) == [("IdleAvoid", "B", "P0")]
    situation.still_since_ms["B"] = NOW_MS - 4_000
    assert avoid(situation.view(), (), NOW_MS) == []
    situation.still_since_ms["B"] = 0
    situation.happen(OrderFinished(scene=SCENE, order=id_))
    assert avoid(situation.view(), (), NOW_MS) == []
