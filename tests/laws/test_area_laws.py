"""A scene of two floors: each goes its own way, and nobody waits for ever for the other."""

import msgspec
import pytest

from commands.rejected import Rejected
from fleetledger.shift import Shift
from ledger.ids import BinName, PointName, RobotName
from ledger.scene import Area, Bin, BinTask, Path, RobotConfig, SceneFile
from ledger.state import OrderStatus, StepTask
from scheduler.traffic.judge import body, collisions
from sim.robot import place
from tests.scheduler.traffic.maps import lattice


def floor(id_: int) -> Area:
    """A lattice whose names tell the floor; the floors lie over each other."""
    plain = lattice(4, 2)
    renamed = {point.name: PointName(f"F{id_}-{point.name}") for point in plain.points}
    return msgspec.structs.replace(
        plain,
        id=id_,
        name=f"Floor {id_}",
        map_name=f"floor-{id_}",
        map_digest=f"{id_:032}",
        points=tuple(msgspec.structs.replace(p, name=renamed[p.name]) for p in plain.points),
        paths=tuple(Path(start=renamed[p.start], end=renamed[p.end]) for p in plain.paths),
        bins=(
            Bin(
                name=BinName(f"F{id_}-BIN"),
                point=renamed[PointName("P0-1")],
                tasks=(BinTask(name="Load", operation="JackLoad"),),
            ),
        ),
    )


def house(robots: int = 4) -> SceneFile:
    configs = (RobotConfig(name=RobotName(f"R{n}"), simulated=True) for n in range(robots))
    return SceneFile(name="house", areas=(floor(1), floor(2)), robots=tuple(configs))


def areas(shift: Shift) -> dict[RobotName, int]:
    return {robot.body.name: robot.body.area for robot in shift.world.robots()}


def check(shift: Shift) -> None:
    outline = ((0.5, 0.35), (-0.5, 0.35), (-0.5, -0.35), (0.5, -0.35))
    for area in (1, 2):
        here = {
            robot.body.name: body(outline, *place(robot)[:3])
            for robot in shift.world.robots()
            if robot.body.area == area
        }
        assert collisions(here) == []


def test_orders_of_each_floor_are_done_by_its_robots() -> None:
    shift = Shift(house(), seed=1)
    assert sorted(areas(shift).values()) == [1, 1, 2, 2]
    orders = {}
    for area in (1, 2):
        for end in ("P3-0", "P0-0"):
            task = StepTask(location=f"F{area}-{end}")
            orders[shift.order(task)] = area
    seen: dict[str, RobotName] = {}

    def look() -> None:
        check(shift)
        for id_ in orders:
            order = shift.fleet.orders.get(id_)
            if order is not None and order.robot is not None:
                seen[id_] = order.robot

    shift.run(120, look)
    assert not shift.fleet.orders.keys() & orders.keys()
    for id_, area in orders.items():
        assert areas(shift)[seen[id_]] == area


def test_an_order_from_floor_to_floor_says_that_there_is_no_way() -> None:
    shift = Shift(house(), seed=1)
    name = next(name for name, area in areas(shift).items() if area == 1)
    there = shift.order(StepTask(location="F1-P3-0"), StepTask(location="F2-P0-0"))
    shift.run(120, lambda: check(shift))
    order = shift.fleet.orders[there]
    assert order.status is OrderStatus.EXECUTING
    assert order.execution_reject is not None
    assert order.execution_reject.code == "NoRoute"
    assert areas(shift)[order.robot or name] == 1


def test_an_order_for_a_floor_without_robots_says_why_it_waits() -> None:
    shift = Shift(house(1), seed=1)
    (here,) = areas(shift).values()
    other = 3 - here
    id_ = shift.order(StepTask(location=f"F{other}-P0-0"))
    shift.run(30, lambda: check(shift))
    reject = shift.fleet.orders[id_].allocation_reject
    assert reject is not None
    assert set(reject.robots.values()) == {"NoRoute"}


def test_a_location_that_no_floor_has_is_refused() -> None:
    shift = Shift(house(1), seed=1)
    with pytest.raises(Rejected):
        shift.order(StepTask(location="F3-P0-0"))
