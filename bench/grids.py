"""Grids of the planning literature under our own planner: sorting, fulfilment, warehouse, random.

Run as `python -m bench.grids`, `--quick` for a tenth of it. Planner, prices and guidance are those
of the product; only the map is a grid, and its robots are points in the middle of cells. Figures to
hold against are those of RHCR (Li et al., AAAI-21; its own code run for design notes, traffic,
section 3b) and of the best entries to the League of Robot Runners 2023.
"""

import argparse
import gc
import random
import statistics
import time

from bench.grid_floor import STEP_S, Grid
from bench.grid_late import Late
from bench.grid_maps import MOVING_AI, Floor, fulfilment, octile, scattered, sorting, warehouse
from bench.grid_runs import Fleet, Run, in_lockstep
from bench.grid_turns import HEADINGS, Turning
from bench.tables import show
from ledger.scene import Kinematics
from scheduler.traffic.costs import Costs
from scheduler.traffic.guidance import Load, learned

WARM_UP = 200
WORK_MAX = 6_000_000  # of learning the guidance, some 4 s
SAMPLES = 600  # ways by which the share of free flow is found

Row = dict[str, float | str]

# Published for random-32-32-20 with 200, 400 and 800 robots: tasks per step of the best entry.
LEADERS = {200: 6.08, 400: 7.43, 800: 3.03}
LEVEL = 0.8


def guided(grid: Grid, plain: Costs, robots: int) -> Costs:
    """Prices with the guidance for so many robots."""
    places = sorted({grid.cell[xy] for kind in grid.floor.goals for xy in kind})
    load = Load(sources=places, goals=places, share=robots / len(grid.floor.cells))
    return Costs(grid, Kinematics(), learned(plain, load, WORK_MAX))


def free_flow(grid: Grid, plain: Costs, robots: int) -> float:
    """Tasks per step if nobody were in anybody's way; goals of all kinds alike."""
    chance = random.Random(0)
    places = sorted({grid.cell[xy] for kind in grid.floor.goals for xy in kind})
    ways = []
    for goal in chance.choices(places, k=SAMPLES // 10):
        for start in chance.choices(places, k=10):
            heading = chance.choice(HEADINGS) if grid.turn_steps else 0.0
            ways.append(plain.cost_s(start, heading, goal) / STEP_S)
    return robots / statistics.fmean(ways)


def measured(
    instance: str,
    floor: Floor,
    robots: int,
    steps: int,
    at_least: float | str,
    *,
    guide: bool = True,
    turns: bool = False,
    late: float | None = None,
    unit: str = "tasks/step",
) -> Row:
    """One instance; `late` = share of moves that are late, each robot in its own time."""
    grid = Grid(floor, 1.0 if turns else 0.0)
    plain = Costs(grid, Kinematics())
    began = time.process_time()
    costs = guided(grid, plain, robots) if guide else plain
    learning_s = time.process_time() - began
    fleet = Fleet(grid, costs, robots, seed=1)
    gc.collect()
    gc.freeze()  # as the server does with what it has loaded
    run: Run
    if turns:
        run = Turning(fleet).run(steps, WARM_UP)
    elif late is not None:
        run = Late(fleet, late, mean=3.0, seed=1).run(steps, WARM_UP)
    else:
        run = in_lockstep(fleet, steps, WARM_UP)
    gc.unfreeze()
    row: Row = {
        "instance": instance,
        "robots": robots,
        "ours": round(run.per_step, 3),
        "at_least": at_least,
        "unit": unit,
        "guidance": "learned" if guide else "none",
        "cpu_ms_per_step": round(run.cpu_s * 1000 / run.steps, 2),
        "longest_task_steps": run.waited,
        "steps": steps,
        "learning_s": round(learning_s, 1),
    }
    if not floor.nearest:
        row["share_of_free_flow"] = round(run.per_step / free_flow(grid, plain, robots), 2)
    return row


def rows(quick: bool = False) -> list[Row]:
    """Each instance with its guidance, and without where that is to be compared."""
    long, short = (600, 400) if quick else (2000, 1000)
    found = []
    for robots, least in ((100, 3.2), (400, 12.1), (800, 22.0)):
        name = "sorting centre 37 x 77, one-way"
        found.append(measured(name, sorting(), robots, short, least, guide=False))
    for guide in (True, False):
        for robots, least in ((60, 2.30), (100, 3.56), (140, 4.55)):
            name = "fulfilment 33 x 46"
            found.append(measured(name, fulfilment(), robots, long, least, guide=guide))
        name, unit = "fulfilment, 10 % of moves late by 3", "tasks/unit"
        found.append(
            measured(name, fulfilment(), 100, short, 1.79, guide=guide, late=0.1, unit=unit)
        )
        name = "warehouse-10-20-10-2-1 shape"
        found.append(measured(name, warehouse(), 1000, short, 5.3, guide=guide))
    found.append(measured("fulfilment, none late", fulfilment(), 100, short, 3.1, late=0.0))
    for robots in (200, 400, 800):
        name, steps = "warehouse, a turn costs a step", 400 if quick else 600
        found.append(measured(name, warehouse(), robots, steps, "report", turns=True))
    for robots, best in LEADERS.items():
        name, least = "random 32 x 32, a turn costs a step", round(best * LEVEL, 2)
        found.append(measured(name, scattered(32, 0.2, 1), robots, 400, least, turns=True))
    real = MOVING_AI / "random-64-64-10.map"
    if real.exists():
        found.append(measured(real.name, octile(real), 400, short, "report"))
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    show("traffic: grids", rows(parser.parse_args().quick))


if __name__ == "__main__":
    main()
