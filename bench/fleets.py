"""Whole fleets with kinematics: on the lattice with the mix of faults, and in generated warehouses.

Run as `python -m bench.fleets`, or with `--quick` for minutes instead of hours of simulation.
Robots are those of `sim`; the judge goes by their true polygons at every step and ends the run at
the first overlap. Warehouse rows are traffic alone, those with `site` have core and dispatch as
well; features are switched one at a time to see what each is worth.
"""

import argparse
import time
from math import inf

from bench.tables import show
from ledger.scene_config import SceneConfig, TrafficMethod
from sim.faults import LATE, STANDARD, FaultMix
from sim.warehouses import for_robots
from tests.laws.yard import STALL_MS, Yard
from tests.scheduler.traffic.maps import lattice
from tests.soak_traffic import STEP_MS, Piece

LATTICE = (4, 10, 20, 40)
LATTICE_H = 8.0
BAYS = 4  # of one aisle between two cross lanes, as `for_robots` draws them
GRANTS_EVERY = 150  # steps: 30 s
FLEETS = {100: 60.0, 300: 20.0, 1000: 5.0}  # robots: minutes of the full run
QUICK_MINUTES = 3.0
CORE_SHARE_MAX = 0.6  # of one core, at 300 robots
ABLATIONS = {
    "no deadlock prevention": SceneConfig(deadlock_prevention=False),
    "reversing": SceneConfig(reverse_out_of_deadlock=True),
    "Venus": SceneConfig(traffic_method=TrafficMethod.VENUS),
}

Row = dict[str, float | str]


def warehouse(robots: int, mix: FaultMix, seed: int = 1) -> Yard:
    """The generated warehouse with orders to random bins, at most two at a time in one aisle."""
    file = for_robots(robots, seed)
    (area,) = file.areas
    lanes = {}
    for bin_ in area.bins:
        kind, aisle, *bay = bin_.name.split("-")
        if kind == "B":
            lanes[bin_.point] = f"{aisle} {(int(bay[0]) - 1) // BAYS}"
    return Yard(
        area,
        robots,
        sorted(lanes),
        seed=seed,
        mix=mix,
        service_s=10.0,
        groups=file.groups,
        lane_of=lanes,
    )


def measured(yard: Yard, hours: float) -> Row:
    """Run for so long, and give what came of it; ends at an overlap, and tells of a stall."""
    yard.run(hours * 3600, grants_every=GRANTS_EVERY)
    return {
        "robots": float(len(yard.robots)),
        "simulated_h": hours,
        "overlaps": 0.0,
        "tasks_per_h": sum(yard.done.values()) / hours,
        "longest_order_s": yard.longest_ms / 1000,
        "longest_without_cause_s": yard.unnamed_ms / 1000,
        "traffic_core_share": yard.planning_s / hours / 3600,
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
    """Generated warehouses under traffic alone, and what it is with other settings."""
    rows = []
    for robots, minutes in FLEETS.items():
        hours = (QUICK_MINUTES if quick else minutes) / 60
        row = measured(warehouse(robots, LATE), hours)
        rows.append(_row("warehouse", row, row["tasks_per_h"], 0.0, "tasks/h"))
        for name, config in ABLATIONS.items() if robots == min(FLEETS) else ():
            yard = warehouse(robots, LATE)
            yard.tune(config)
            row = measured(yard, hours)
            rows.append(_row(f"warehouse, {name}", row, row["tasks_per_h"], 0.0, "tasks/h"))
    return rows


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
        "longest_without_cause_s": made.stalled_ms / 1000,
    }


def rows(*, quick: bool = False) -> list[Row]:
    """All rows of this module."""
    sites = [site(n, QUICK_MINUTES if quick else FLEETS[n]) for n in (100, 300)]
    return [*lattices(quick=quick), *fleets(quick=quick), *sites]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    show("fleets", rows(quick=parser.parse_args().quick))


if __name__ == "__main__":
    main()
