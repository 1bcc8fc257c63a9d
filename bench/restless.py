"""Half an hour of traffic with three times the faults and a new scheduler a minute.

Run as `python -m bench.restless`, or with `--quick` for minutes. Much of what a new scheduler takes
over wrongly is wrong only for a moment: each of these runs has thirty. As in `bench.fleets` a run
ends at the first overlap, or where ground is granted twice, and grants are looked at each second.
Robots that people drive run into others here: a whole site has the guard, which stops who comes.
"""

import argparse
from collections.abc import Callable

from bench import floors
from bench.fleets import Row, measured, warehouse
from bench.tables import show
from ledger.ids import RobotName
from ledger.scene import Area
from tests.laws.yard import STEP_MS, Yard
from tests.scheduler.traffic.maps import lattice
from tests.soak_traffic import RESTLESS
from tests.stands import STALL_MS

MINUTES, QUICK_MINUTES = 30.0, 3.0
SEEDS = 6
GRANTS_EVERY = 1_000 // STEP_MS


class Unguarded(Yard):
    """Without the guard of a whole site."""

    def excused(self, pair: tuple[RobotName, RobotName]) -> bool:
        """People have one of the two in hand."""
        return any(self.in_hand(name) for name in pair)


def on(area: Area, robots: int, seed: int, service_s: float = 0.0) -> Yard:
    """Orders at random to the bins, or where there are none to any point."""
    goals = [bin_.point for bin_ in area.bins] or [point.name for point in area.points]
    return Unguarded(area, robots, goals, seed=seed, mix=RESTLESS, service_s=service_s)


# With as many robots as are many there.
INSTANCES: dict[str, Callable[[int], Yard]] = {
    "lattice 10 x 10": lambda seed: on(lattice(10, 10), 40, seed),
    "lattice 4 x 3": lambda seed: on(lattice(4, 3), 5, seed),
    "fine lattice 6 x 6": lambda seed: on(floors.lattice(6, 2.0, 0.5), 16, seed),
    "aisles": lambda seed: on(floors.aisles("paired"), 20, seed, service_s=5.0),
    "warehouse": lambda seed: warehouse(30, RESTLESS, seed, Unguarded),
}


def row(instance: str, seed: int, minutes: float) -> Row:
    """One run."""
    made = measured(INSTANCES[instance](seed), minutes / 60, grants_every=GRANTS_EVERY)
    ours, most = made["longest_without_cause_s"], STALL_MS / 1000
    return {
        "instance": instance,
        "seed": float(seed),
        "ours": ours,
        "at_least": most,
        "unit": "s at most",
        **made,
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", default="", choices=("", *INSTANCES), help="one of the maps")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="from 1 on")
    given = parser.parse_args()
    minutes = QUICK_MINUTES if given.quick else MINUTES
    names = [name for name in INSTANCES if given.only in ("", name)]
    seeds = range(1, given.seeds + 1)
    show("restless", [row(name, seed, minutes) for name in names for seed in seeds])


if __name__ == "__main__":
    main()
