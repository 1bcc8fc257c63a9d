"""What events of orders leave in the robot that has them: bins, orders, and since when it rests."""

from typing import Any

from ledger.events import (
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderFinished,
    OrderWithdrawn,
    RobotAdded,
    RobotBinsCleared,
    StepFinished,
    StepStarted,
    stamped,
)
from ledger.evolve import evolve
from ledger.ids import CommandId, OrderId, RobotName, SceneId, robot_key
from ledger.scene import RobotConfig
from ledger.state import BinStatus, Fleet, Robot, RobotBin, StepTask

SCENE, R1 = SceneId("S"), RobotName("R1")
ONE, TWO = OrderId("TO1"), OrderId("TO2")
LOAD, UNLOAD = StepTask(location="B1", loads=True), StepTask(location="B2", unloads=True)


def lives(*happened: Any) -> list[Robot]:
    """Give the robot after each event; one happens each second."""
    fleet = Fleet()
    found = []
    given = (RobotAdded(scene=SCENE, config=RobotConfig(name=R1, bin_count=2)), *happened)
    for second, event in enumerate(given):
        evolve(fleet, stamped(event, second + 1, second * 1_000, "given", CommandId("")))
        found.append(fleet.robots[robot_key(SCENE, R1)])
    return found


def created(order: OrderId) -> OrderCreated:
    return OrderCreated(
        scene=SCENE, order=order, tasks=(LOAD, UNLOAD), container=f"C-{order}", sealed=True
    )


def assigned(order: OrderId, bin: int) -> OrderAssigned:
    return OrderAssigned(scene=SCENE, order=order, robot=R1, bin=bin, cost_s=0.0)


def stepped(step: int, order: OrderId = ONE) -> tuple[StepStarted, StepFinished]:
    return (
        StepStarted(scene=SCENE, order=order, step=step, robot=R1),
        StepFinished(scene=SCENE, order=order, step=step, robot=R1),
    )


def of(kind: type[Any], order: OrderId = ONE, **fields: Any) -> Any:
    return kind(scene=SCENE, order=order, **fields)


EMPTY = RobotBin()
RESERVED = RobotBin(status=BinStatus.RESERVED, order=ONE, container="C-TO1")
FILLED = RobotBin(status=BinStatus.FILLED, order=ONE, container="C-TO1")


def test_a_bin_is_reserved_filled_emptied_and_given_back() -> None:
    robots = lives(created(ONE), assigned(ONE, 1), *stepped(0), *stepped(1), of(OrderFinished))
    assert [r.bins[1] for r in robots] == [
        *[EMPTY] * 2,
        *[RESERVED] * 2,
        *[FILLED] * 2,
        RobotBin(status=BinStatus.RESERVED, order=ONE),
        EMPTY,
    ]
    assert {r.bins[0] for r in robots} == {EMPTY}


def test_what_a_cancelled_order_leaves_on_board_stays_until_it_is_cleared() -> None:
    cleared = RobotBinsCleared(scene=SCENE, robot=R1)
    for gone in (of(OrderCancelled), of(OrderWithdrawn, robot=R1, reason="r")):
        robots = lives(created(ONE), assigned(ONE, 0), *stepped(0), gone, cleared)
        left = RobotBin(status=BinStatus.CANCELLED, order=ONE, container="C-TO1")
        assert [r.bins[0] for r in robots[-3:]] == [FILLED, left, EMPTY]
        robots = lives(created(ONE), assigned(ONE, 0), gone)
        assert [r.bins[0] for r in robots[-2:]] == [RESERVED, EMPTY]


def test_a_robot_has_its_orders_in_the_order_of_assignment_and_rests_without() -> None:
    robots = lives(
        created(ONE),
        created(TWO),
        assigned(TWO, 0),
        assigned(ONE, 1),
        of(OrderCancelled, TWO),
        of(OrderCancelled),
    )
    assert [r.orders for r in robots[3:]] == [(TWO,), (TWO, ONE), (ONE,), ()]
    assert [r.idle_since_ms for r in robots[3:]] == [0, 0, 0, 6_000]
