"""Whole fleets with kinematics: on the lattice with the mix of faults, and in generated warehouses.

Run as `python -m bench.fleets`, or with `--quick` for minutes instead of hours of simulation;
`--only` takes the rows of one function. Robots are those of `sim`; the judge goes by their true
polygons at every step, and a run ends at the first overlap. Warehouse rows are traffic alone, those
with `site` have core and dispatch as well; features are switched off one at a time to see what each
is worth.
"""

import argparse
import time
from math import inf

from bench.features import BASE, VARIANTS, switched
from bench.tables import show
from sim.faults import LATE, STANDARD, FaultMix
from sim.warehouses import for_robots
from tests.laws.yard import Yard
from tests.scheduler.traffic.maps import lattice
from tests.soak_traffic import STEP_MS, Piece
from tests.stands import STALL_MS

LATTICE = (4, 10, 20, 40)
LATTICE_H = 8.0
BAYS = 4  # of one aisle between two cross lanes, as `for_robots` draws them
GRANTS_EVERY = 150  # steps: 30 s
ENDED_MAX = 200  # characters
FLEETS = {100: 30.0, 300: 15.0, 1000: 5.0}  # robots: minutes of the full run
WARM_UP_S = 120.0  # all robots begin side by side, parked
SWITCHED = 100  # robots for which features are switched off …
SWITCHED_MINUTES = 10.0
SEEDS = (1, 2)  # … each time
QUICK_MINUTES = 3.0
CORE_SHARE_MAX = 0.6  # of one core, at 300 robots
Row = dict[str, float | str]


def warehouse(robots: int, mix: FaultMix, seed: int = 1, made: type[Yard] = Yard) -> Yard:
    """The generated warehouse with orders to random bins, at most two at a time in one aisle."""
    file = for_robots(robots, seed)
    (area,) = file.areas
    lanes = {}
    for bin_ in area.bins:
        kind, aisle, *bay = bin_.name.split("-")
        if kind == "B":
            lanes[bin_.point] = f"{aisle} {(int(bay[0]) - 1) // BAYS}"
    return made(
        area,
        robots,
        sorted(lanes),
        seed=seed,
        mix=mix,
        service_s=10.0,
        groups=file.groups,
        lane_of=lanes,
    )


def measured(
    yard: Yard, hours: float, warm_up_s: float = 0.0, grants_every: int = GRANTS_EVERY
) -> Row:
    """Run for so long, and give what came of it until the judge stopped it, which the row says."""
    ended = ""
    before, begun_ms, begun_s = 0, yard.now_ms, yard.planning_s
    try:
        yard.run(warm_up_s, grants_every=grants_every)
        before, begun_ms, begun_s = sum(yard.done.values()), yard.now_ms, yard.planning_s
        yard.run(hours * 3600, grants_every=grants_every)
    except AssertionError as wrong:
        ended = f"stopped: {wrong}"[:ENDED_MAX]
    passed_s = (yard.now_ms - begun_ms) / 1000
    return {
        "robots": float(len(yard.robots)),
        "simulated_h": passed_s / 3600,
        "overlaps": float(bool(ended)),
        "tasks_per_h": (sum(yard.done.values()) - before) / passed_s * 3600,
        "longest_order_s": yard.longest_ms / 1000,
        "longest_stand_s": yard.still_ms / 1000,
        "longest_without_cause_s": yard.stands.unnamed_ms / 1000,
        "traffic_core_share": (yard.planning_s - begun_s) / passed_s,
        "ended": ended,
    }


def lattices(*, quick: bool) -> list[Row]:
    """Two-way 10 x 10 lattice, 2 m pitch, endless random orders, the standard mix of faults."""
    rows = []
    hours = QUICK_MINUTES / 60 if quick else LATTICE_H
    area = lattice(10, 10)
    for robots in LATTICE:
        goals = [point.name for point in area.points]
        row = measured(Yard(area, robots, goals, seed=1, mix=STANDARD, service_s=0.0), hours)
        ours = row["longest_without_cause_s"]
        rows.append(_row("lattice with faults", row, ours, STALL_MS / 1000, "s at most"))
    return rows


def _row(instance: str, row: Row, ours: float | str, at_least: float, unit: str) -> Row:
    return {"instance": instance, "ours": ours, "at_least": at_least, "unit": unit, **row}


def fleets(*, quick: bool) -> list[Row]:
    """Generated warehouses under traffic alone."""
    found = []
    for robots, minutes in FLEETS.items():
        hours = (QUICK_MINUTES if quick else minutes) / 60
        row = measured(warehouse(robots, LATE), hours, WARM_UP_S)
        found.append(_row("warehouse", row, row["tasks_per_h"], 0.0, "tasks/h"))
    return found


def features(*, quick: bool) -> list[Row]:
    """The same with each feature switched off, and with the other planner; means of the seeds, and
    the worst of what is the longest.
    """
    hours = (QUICK_MINUTES if quick else SWITCHED_MINUTES) / 60
    return [_switched(name, hours) for name in VARIANTS]


def _switched(name: str, hours: float) -> Row:
    runs = []
    for seed in SEEDS:
        with switched(name) as config:
            yard = warehouse(SWITCHED, LATE, seed)
            yard.tune(config)
            runs.append(measured(yard, hours, WARM_UP_S))
    rates = [float(run["tasks_per_h"]) for run in runs]
    row: Row = {**runs[0], "tasks_per_h": sum(rates) / len(rates)}
    for key in ("longest_order_s", "longest_stand_s", "longest_without_cause_s", "overlaps"):
        row[key] = max(float(run[key]) for run in runs)
    row["traffic_core_share"] = sum(float(r["traffic_core_share"]) for r in runs) / len(runs)
    row["ended"] = "; ".join(str(run["ended"]) for run in runs if run["ended"])
    row["spread"] = max(rates) - min(rates)
    title = "warehouse" if name == BASE else f"warehouse, {name}"
    return _row(title, row, row["tasks_per_h"], 0.0, "tasks/h")


def site(robots: int, minutes: float) -> Row:
    """The whole scheduler at work on a site: its processor time beside the simulated time."""
    made = Piece(robots, 1, LATE)
    role, spent_s = made.shift.role, 0.0
    tick = role.tick

    def timed(now_ms: int) -> None:
        nonlocal spent_s
        began_s = time.process_time()
        tick(now_ms)
        spent_s += time.process_time() - began_s

    role.tick = timed  # type: ignore[method-assign]
    made.run(minutes * 60)
    share = spent_s / minutes / 60
    return {
        "instance": f"site, a pass each {STEP_MS} ms",
        "robots": float(robots),
        "ours": share,
        "at_least": CORE_SHARE_MAX if robots <= 300 else inf,
        "unit": "of a core at most",
        "simulated_h": minutes / 60,
        "overlaps": 0.0,
        "tasks_per_h": made.done / minutes * 60,
        "longest_without_cause_s": made.stands.unnamed_ms / 1000,
    }


def sites(*, quick: bool) -> list[Row]:
    """Whole sites."""
    return [site(n, QUICK_MINUTES if quick else FLEETS[n]) for n in (100, 300)]


PARTS = {"lattices": lattices, "fleets": fleets, "features": features, "sites": sites}


def rows(*, quick: bool = False, only: str = "") -> list[Row]:
    """All rows of this module, or of one part of it."""
    return [row for name, part in PARTS.items() if only in name for row in part(quick=quick)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", default="", choices=("", *PARTS), help="one part of the table")
    given = parser.parse_args()
    show("fleets", rows(quick=given.quick, only=given.only))


if __name__ == "__main__":
    main()
