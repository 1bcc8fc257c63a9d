"""Named places where fleets lock up: each ends all its orders in time, without overlap, and says
why whoever waits does.

The bounds are of virtual time, about three times what it takes now.
"""

from itertools import pairwise

import pytest

from ledger.ids import PointName
from ledger.scene import Area, Path, Point, PointKind
from sim.faults import FaultMix
from tests.laws.yard import Yard
from tests.scheduler.traffic.maps import area_of, both, lattice, warehouse

LATE = FaultMix(late_ratio=0.1, late_mean_s=6.0)


def named(*names: str) -> list[PointName]:
    return [PointName(name) for name in names]


def yard(area: Area, starts: dict[str, str], orders: dict[str, list[str]], seed: int = 1) -> Yard:
    """Robots on these points, heading east, with these orders one after the other."""
    made = Yard(
        area,
        {name: (point, 0.0) for name, point in starts.items()},
        [],
        seed=seed,
        mix=LATE,
        service_s=1.0,
        endless=False,
    )
    for name, points in orders.items():
        made.orders[PointName(name)] = named(*points)
    return made


def line(
    prefix: str, count: int, x_m: float, y_m: float, pitch_m: float = 2.0
) -> tuple[list[Point], list[Path]]:
    points = [
        Point(name=PointName(f"{prefix}{k}"), x_m=x_m + k * pitch_m, y_m=y_m) for k in range(count)
    ]
    paths: list[Path] = []
    for a, b in pairwise(points):
        paths += both(a.name, b.name)
    return points, paths


def joined(*parts: tuple[list[Point], list[Path]], ties: tuple[tuple[str, str], ...] = ()) -> Area:
    points = [point for part, _ in parts for point in part]
    paths = [path for _, part in parts for path in part]
    for a, b in ties:
        paths += both(a, b)
    return area_of(points, paths)


def square(prefix: str, x_m: float) -> tuple[list[Point], list[Path]]:
    """Two by three points with a lane all round: room enough to let each other by."""
    points = [
        Point(name=PointName(f"{prefix}{i}{j}"), x_m=x_m + 2.0 * i, y_m=2.0 * j)
        for i in range(2)
        for j in range(3)
    ]
    paths: list[Path] = []
    for i in range(2):
        for j in range(3):
            paths += both(f"{prefix}{i}{j}", f"{prefix}{1 - i}{j}") if i == 0 else []
            paths += both(f"{prefix}{i}{j}", f"{prefix}{i}{j + 1}") if j < 2 else []
    return points, paths


def tunnel() -> Area:
    """Two yards, and between them one lane for all."""
    return joined(
        square("A", 0.0),
        line("T", 4, 4.0, 2.0),
        square("B", 12.0),
        ties=(("A11", "T0"), ("T3", "B01")),
    )


def test_six_robots_pass_a_single_lane_tunnel_both_ways() -> None:
    made = yard(
        tunnel(),
        {"R1": "A00", "R2": "A02", "R3": "A10", "R4": "B00", "R5": "B12", "R6": "B10"},
        {
            "R1": ["B00", "A00"],
            "R2": ["B12", "A02"],
            "R3": ["B10", "A10"],
            "R4": ["A00", "B00"],
            "R5": ["A02", "B12"],
            "R6": ["A10", "B10"],
        },
    )
    made.finish(900)


def test_three_robots_take_turns_in_a_dead_end_aisle() -> None:
    area = joined(square("A", 0.0), line("D", 5, 4.0, 2.0, 1.4), ties=(("A11", "D0"),))
    made = yard(
        area,
        {"R1": "A00", "R2": "A02", "R3": "A10"},
        {"R1": ["D4", "A00"], "R2": ["D2", "A02"], "R3": ["D4", "D1", "A10"]},
    )
    made.finish(600)


def test_parked_robots_make_way_for_those_whose_goals_they_stand_on() -> None:
    area = lattice(4, 3)
    made = yard(
        area,
        {"R1": "P0-0", "P1": "P2-1", "P2": "P3-1", "P3": "P3-2"},
        {"R1": ["P2-1", "P3-1", "P3-2", "P0-0"]},
    )
    made.finish(240)


def test_a_robot_parked_at_the_end_of_an_aisle_comes_out_for_one_that_wants_in() -> None:
    area = joined(square("A", 0.0), line("D", 4, 4.0, 2.0, 1.4), ties=(("A11", "D0"),))
    made = yard(area, {"R1": "A00", "P1": "D3"}, {"R1": ["D3", "A00"]})
    made.finish(240)


@pytest.mark.parametrize("gap", [1, 3])
def test_two_robots_exchange_their_stops(gap: int) -> None:
    made = yard(
        lattice(4, 2),
        {"R1": "P0-0", "R2": f"P{gap}-0"},
        {"R1": [f"P{gap}-0"], "R2": ["P0-0"]},
    )
    made.finish(120)


def test_two_robots_exchange_their_stops_at_the_ends_of_a_lane_with_one_siding() -> None:
    points, paths = line("L", 5, 0.0, 0.0)
    points.append(Point(name=PointName("S"), x_m=4.0, y_m=2.0))
    made = yard(
        area_of(points, [*paths, *both("L2", "S")]),
        {"R1": "L0", "R2": "L4"},
        {"R1": ["L4"], "R2": ["L0"]},
    )
    made.finish(240)


def test_a_goal_where_the_robot_stands_is_reached_at_once() -> None:
    made = yard(lattice(2, 2), {"R1": "P0-0", "R2": "P1-1"}, {"R1": ["P0-0", "P0-0", "P0-0"]})
    assert made.finish(20) < 10
    assert made.done[PointName("R1")] == 3


def test_more_robots_than_stops_want_into_one_region() -> None:
    """Five want to visit a dead-end room of three stops."""
    room = line("D", 3, 6.0, 2.0)
    area = joined(square("A", 0.0), square("C", -6.0), room, ties=(("A11", "D0"), ("C11", "A01")))
    starts = {"R1": "A00", "R2": "A02", "R3": "C00", "R4": "C02", "R5": "C10"}
    goals = ["D2", "D1", "D0", "D2", "D1"]
    orders = {name: [goal, starts[name]] for name, goal in zip(starts, goals, strict=True)}
    made = yard(area, starts, orders)
    made.finish(900)


def test_a_whole_fleet_passes_a_narrow_door_between_two_halls() -> None:
    """A hall of 3 x 3 on each side, one lane between them, five robots each way."""
    west = lattice(3, 3)
    paths = list(west.paths)
    points = list(west.points)
    for i in range(3):
        for j in range(3):
            points.append(Point(name=PointName(f"Q{i}-{j}"), x_m=8.0 + 2 * i, y_m=2.0 * j))
            paths += both(f"Q{i}-{j}", f"Q{i + 1}-{j}") if i < 2 else []
            paths += both(f"Q{i}-{j}", f"Q{i}-{j + 1}") if j < 2 else []
    points.append(Point(name=PointName("DOOR"), x_m=6.0, y_m=2.0, kind=PointKind.WAYPOINT))
    paths += [*both("P2-1", "DOOR"), *both("DOOR", "Q0-1")]
    starts = {"R1": "P0-0", "R2": "P0-2", "R3": "P1-1", "R4": "Q2-0", "R5": "Q2-2", "R6": "Q1-1"}
    other = {"R1": "Q2-0", "R2": "Q2-2", "R3": "Q1-1", "R4": "P0-0", "R5": "P0-2", "R6": "P1-1"}
    made = yard(area_of(points, paths), starts, {n: [other[n], starts[n]] for n in starts})
    made.finish(600)


def test_six_robots_serve_three_blind_aisles() -> None:
    area = warehouse(4, 5, 4, blind=(0, 1, 3))
    starts = {"R1": "K0", "R2": "K1", "R3": "K2", "R4": "K3"}
    orders = {
        "R1": ["B0-4", "B1-1", "K0"],
        "R2": ["B0-1", "B3-4", "K1"],
        "R3": ["B1-4", "B0-2", "K2"],
        "R4": ["B3-2", "B1-3", "K3"],
    }
    yard(area, starts, orders).finish(900)


def stage(seed: int) -> None:
    """For the soak: the worst of them with other chance."""
    rooms = {"R1": "A00", "R2": "A02", "R3": "A10", "R4": "B00", "R5": "B12", "R6": "B10"}
    there = {"R1": "B00", "R2": "B12", "R3": "B10", "R4": "A00", "R5": "A02", "R6": "A10"}
    orders = {name: [there[name], rooms[name]] * 5 for name in rooms}
    yard(tunnel(), rooms, orders, seed=seed).finish(4500)
