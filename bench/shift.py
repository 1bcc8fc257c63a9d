"""A simulated hour with 50 robots on virtual time: core, scheduler and robots in one process."""

import logging
import random
import time

import structlog

from fleetledger.shift import Shift
from ledger.state import OrderKind, StepTask
from sim.warehouses import for_robots

ROBOTS = 50
MINUTES = 60
STEP_MS = 400  # ten minutes did 220 orders so, and 225 at 200 ms


def busy(shift: Shift, bins: list[str], chance: random.Random, open_max: int) -> None:
    """Keep so many business orders open."""
    live = sum(order.kind is OrderKind.BUSINESS for order in shift.fleet.orders.values())
    for _ in range(open_max - live):
        source, target = chance.sample(bins, 2)
        shift.order(
            StepTask(location=source, arguments='{"binTask":"Load"}', loads=True),
            StepTask(location=target, arguments='{"binTask":"Unload"}', unloads=True),
        )


def main(robots: int = ROBOTS, minutes: int = MINUTES) -> list[dict[str, float | str]]:
    """Run the shift and give its figures."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.WARNING))
    file = for_robots(robots, 1)
    shift = Shift(file, step_ms=STEP_MS)
    chance = random.Random(1)
    bins = [str(b.name) for area in file.areas for b in area.bins]
    began = time.perf_counter()
    shift.run(minutes * 60, lambda: busy(shift, bins, chance, 2 * robots))
    took_s = time.perf_counter() - began
    made = sum(shift.fleet.order_counts.values())
    row: dict[str, float | str] = {
        "what": f"{minutes} simulated minutes, {robots} robots",
        "took_s": took_s,
        "orders_done": float(made - len(shift.fleet.orders)),
        "events": float(shift.fleet.position),
    }
    print(", ".join(f"{k} {v:,.2f}" if isinstance(v, float) else v for k, v in row.items()))
    return [row]


if __name__ == "__main__":
    main()
