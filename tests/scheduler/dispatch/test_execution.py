"""What a step asks of the robot that is at it."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import BinName, PointName
from ledger.scene import Bin, BinTask, Point
from ledger.state import Step, StepTask
from scheduler.dispatch.execution import action
from scheduler.places import Place

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
