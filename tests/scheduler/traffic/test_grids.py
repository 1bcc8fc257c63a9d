"""The planner on grids, as `bench.grids` measures it: what is measured must be allowed, too."""

import pytest

from bench.grid_floor import Grid
from bench.grid_late import Late
from bench.grid_maps import fulfilment, scattered, sorting, warehouse
from bench.grid_runs import Fleet, in_lockstep
from bench.grid_turns import Turning
from ledger.scene import Kinematics
from scheduler.traffic.costs import Costs

SMALL = scattered(8, 0.0, seed=0)  # open: in dead ends nobody could pass
CROWD = len(SMALL.cells) // 3


def fleet(turn_steps=0.0, robots=CROWD, floor=SMALL):
    grid = Grid(floor, turn_steps)
    return Fleet(grid, Costs(grid, Kinematics()), robots, seed=1)


@pytest.mark.parametrize(
    ("floor", "cells", "ways"),
    [(sorting(), 2570, 3792), (fulfilment(), 1278, 4426), (warehouse(), 5699, 17556)],
)
def test_the_generated_floors_have_the_published_sizes(floor, cells, ways):
    assert (len(floor.cells), len(floor.ways)) == (cells, ways)
    assert all(set(kind) <= set(floor.cells) for kind in (*floor.goals, floor.homes))


def test_no_station_of_the_sorting_centre_is_cut_off():
    plain = fleet(robots=1, floor=sorting())
    stations, drops = plain.goals
    for station in stations:
        for drop in drops[::50]:
            assert plain.costs.cost_s(station, 0.0, drop) < float("inf")
            assert plain.costs.cost_s(drop, 0.0, station) < float("inf")


def test_in_lockstep_everybody_gets_its_task_done():
    run = in_lockstep(fleet(), 150, 50)
    assert run.tasks > 100
    assert run.waited < 100


def test_late_robots_never_hold_one_cell_together():
    late = Late(fleet(), late=0.2, mean=3.0, seed=1)
    run = late.run(60, 20)
    cells = [robot.here for robot in late.robots if robot.driven >= 2 or robot.onto is None]
    cells += [robot.onto for robot in late.robots if robot.onto is not None]
    assert run.tasks > 20
    assert sorted(late.held) == sorted(
        {robot.here for robot in late.robots if robot.onto is None or robot.driven < 2}
        | {robot.onto for robot in late.robots if robot.onto is not None}
    )
    assert len({id(late.robots[k]) for k in late.held.values()}) == CROWD


def test_a_turn_takes_a_step():
    alone = fleet(turn_steps=1.0, robots=1)
    grid, agent = alone.grid, alone.agents[0]
    turning = Turning(alone)
    for _ in range(30):
        before = turning.here[0], turning.facing[0]
        turning.run(1, 0)
        after = turning.here[0], turning.facing[0]
        assert before[0] == after[0] or before[1] == after[1], "never both in one step"
    assert agent.place in range(len(grid.floor.cells))


def test_turning_robots_keep_apart():
    turning = Turning(fleet(turn_steps=1.0))
    run = turning.run(80, 20)
    assert run.tasks > 20
    assert len(set(turning.here)) == CROWD
    assert turning.held == set(turning.here)
