"""What a step asks of the robot that is at it."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.events import ExecutionRejected, OrderAssigned, StepStarted
from ledger.ids import BinName, PointName, RobotName
from ledger.proposals import FinishStep, RejectExecution
from ledger.scene import Bin, BinTask, Point
from ledger.state import Step, StepTask
from scheduler.dispatch.continue_ import continue_
from scheduler.dispatch.execution import action, due_action, takes_load
from scheduler.dispatch.reasons import Why
from scheduler.places import Place
from tests.scheduler.dispatch.views import NOW_MS, Situation
from tests.scheduler.small_site import SCENE, order

LOAD = BinTask(name="Load", operation="JackLoad", arguments='{"height":1,"slow":true}')
PLACE = Place(
    area=1,
    point=Point(name=PointName("W1"), x_m=0.0, y_m=0.0),
    bin=Bin(name=BinName("B1"), point=PointName("W1"), tasks=(LOAD,)),
)


def step(arguments: str | None) -> Step:
    task = StepTask(location="B1", arguments=arguments)
    return Step(id="S", task=task, created_ms=0, modified_ms=0)  # type: ignore[arg-type]


@pytest.mark.parametrize("arguments", [None, "{}", ""])
def test_without_arguments_it_is_enough_to_be_there(arguments: str | None) -> None:
    found = action(step(arguments), PLACE)
    assert found is None or (arguments == "" and found.wrong)


def test_a_bin_task_stands_for_the_robots_own_operation_and_the_clients_words_win() -> None:
    found = action(step('{"binTask":"Load","height":2}'), PLACE)
    assert found is not None and found.name == "Load"
    assert json.loads(found.arguments) == {"operation": "JackLoad", "height": 2, "slow": True}


def test_an_operation_is_handed_on_as_it_is() -> None:
    found = action(step('{"operation":"Unload"}'), PLACE)
    assert found is not None
    assert (found.name, found.arguments) == ("Unload", '{"operation":"Unload"}')


def test_a_bin_task_that_the_map_has_no_more_is_named() -> None:
    found = action(step('{"binTask":"Wash"}'), PLACE)
    assert found is not None and found.wrong == "B1 has no bin task Wash"


@given(st.text(max_size=20))
def test_no_text_breaks_it(text: str) -> None:
    action(step(text), PLACE)


def test_a_robot_acts_only_after_its_last_creep_though_its_speed_may_be_noise_for_ever() -> None:
    """Measured: the last 5 cm of a stop take up to 0.6 s, and a robot that moves refuses to act."""
    situation = Situation()
    spot = situation.core.fleet.scenes[SCENE].areas[0].points[0]
    situation.robot("A", spot.x_m)
    touch = StepTask(location=spot.name, arguments='{"operation":"Touch"}')
    situation.happen(order(1, touch))
    id_ = next(iter(situation.core.fleet.orders))
    robot = RobotName("A")
    situation.happen(
        OrderAssigned(scene=SCENE, order=id_, robot=robot, bin=0, cost_s=0.0),
        StepStarted(scene=SCENE, order=id_, step=0, robot=robot),
    )

    def acts(still_ms: int, speed_mps: float) -> bool:
        situation.report("A", spot.x_m, speed_mps=speed_mps)
        situation.still_since_ms["A"] = NOW_MS - still_ms
        view = situation.view()
        return due_action(view, view.robots[robot], NOW_MS) is not None

    assert acts(0, 0.0)
    assert not acts(800, 0.002)
    assert acts(2_000, 0.002)


def test_a_load_is_not_taken_before_there_is_room_for_it_and_that_is_said() -> None:
    situation = Situation()
    spot = situation.core.fleet.scenes[SCENE].areas[0].points[0]
    situation.robot("A", spot.x_m)
    situation.robot("B", 9.0)
    lift = StepTask(location=spot.name, arguments='{"operation":"Lift"}', loads=True)
    situation.happen(order(1, lift))
    id_ = next(iter(situation.core.fleet.orders))
    robot = RobotName("A")
    situation.happen(
        OrderAssigned(scene=SCENE, order=id_, robot=robot, bin=0, cost_s=0.0),
        StepStarted(scene=SCENE, order=id_, step=0, robot=robot),
    )
    situation.report("A", spot.x_m)
    situation.crowded["A"] = (RobotName("B"),)
    view = situation.view()
    assert takes_load(view, view.robots[robot])
    assert due_action(view, view.robots[robot], NOW_MS) is None
    said = [p for p in continue_(view, (), NOW_MS) if isinstance(p, RejectExecution)]
    assert said[-1].code == Why.NO_ROOM_TO_LOAD
    assert said[-1].robots == {"B": Why.ROBOT_IN_THE_WAY}
    situation.crowded.clear()
    view = situation.view()
    assert due_action(view, view.robots[robot], NOW_MS) is not None
    assert not [p for p in continue_(view, (), NOW_MS) if isinstance(p, RejectExecution)]


def test_no_reason_is_taken_back_from_an_order_that_ends_by_its_last_step() -> None:
    situation = Situation()
    spot = situation.core.fleet.scenes[SCENE].areas[0].points[0]
    situation.robot("A", spot.x_m)
    situation.happen(order(1, StepTask(location=spot.name)))
    id_ = next(iter(situation.core.fleet.orders))
    robot = RobotName("A")
    situation.happen(
        OrderAssigned(scene=SCENE, order=id_, robot=robot, bin=0, cost_s=0.0),
        StepStarted(scene=SCENE, order=id_, step=0, robot=robot),
        ExecutionRejected(scene=SCENE, order=id_, code=Why.NO_ROUTE.value),
    )
    (finished,) = continue_(situation.view(), (), NOW_MS)
    assert finished == FinishStep(scene=SCENE, order=id_, step=0, robot=robot)
