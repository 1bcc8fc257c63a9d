"""Which step a robot is at."""

from ledger.ids import OrderId, SceneId, StepId
from ledger.state import Order, Step, StepStatus, StepTask
from scheduler.current import current

DONE, NOW, NEXT = StepStatus.DONE, StepStatus.EXECUTING, StepStatus.EXECUTABLE


def order(name: str, *steps: tuple[StepStatus, StepTask], suspended: bool = False) -> Order:
    done = sum(status is DONE for status, _ in steps)
    return Order(
        id=OrderId(name),
        scene=SceneId("S"),
        created_ms=0,
        created_by="",
        modified_ms=0,
        modified_by="",
        suspended=suspended,
        done_step=done - 1,
        steps=tuple(
            Step(id=StepId(f"{name}-{n}"), task=task, status=status, created_ms=0, modified_ms=0)
            for n, (status, task) in enumerate(steps)
        ),
    )


def at(*orders: Order) -> str | None:
    found = current(orders)
    return None if found is None else str(found.step.id)


MOVE = StepTask(location="AP1")
BINDING = StepTask(location="AP1", keeps_robot=True)
LOAD = StepTask(location="B1", loads=True)


def test_the_step_that_has_begun_goes_before_all_others() -> None:
    assert at(order("A", (NEXT, LOAD)), order("B", (NOW, MOVE))) == "B-0"
    bound = order("A", (DONE, BINDING), (NEXT, MOVE))
    assert at(bound, order("B", (NOW, MOVE))) == "B-0"


def test_a_step_may_keep_the_robot_for_the_next_of_its_order() -> None:
    other = order("A", (NEXT, LOAD))
    assert at(other, order("B", (DONE, MOVE), (NEXT, MOVE))) == "A-0"
    assert at(other, order("B", (DONE, BINDING), (NEXT, MOVE))) == "B-1"
    assert at(other, order("B", (DONE, BINDING), (DONE, MOVE), (NEXT, MOVE))) == "A-0"


def test_a_robot_that_is_kept_waits_for_the_step_that_is_still_to_come() -> None:
    assert at(order("A", (NEXT, LOAD)), order("B", (DONE, BINDING))) is None


def test_loads_are_fetched_before_others_are_put_down() -> None:
    assert at(order("A", (NEXT, MOVE)), order("B", (NEXT, LOAD))) == "B-0"
    assert at(order("A", (NEXT, MOVE)), order("B", (NEXT, MOVE))) == "A-0"


def test_what_is_suspended_is_put_off_while_there_is_something_else() -> None:
    put_off = order("A", (NEXT, LOAD), suspended=True)
    assert at(put_off, order("B", (NEXT, MOVE))) == "B-0"
    assert at(put_off) == "A-0"


def test_who_has_nothing_to_do_is_at_nothing() -> None:
    assert at() is None
    assert at(order("A", (DONE, MOVE))) is None
