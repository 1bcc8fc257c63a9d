"""The two planners beside each other: `Distributed` (PIBT) and `Venus` (conflict-based search).

Run as `python -m bench.methods`, or with `--quick`; `--only` takes instances with this in their
names. Maps, delays and free flow are those of `bench.floors` and `bench.maps`. Venus searches where
it stands here, so that it costs no simulated time; how long its searches take says whether it could
keep up.
"""

import time
from collections.abc import Callable
from typing import TypeVar

from bench import floors, maps
from bench.floors import Instance, Row, begun, floor, free_orders_per_h, judged, report
from ledger.scene_config import SceneConfig, TrafficMethod
from scheduler.traffic.venus import Answer, Venus, at_once

# Part of the name, robots.
CHOSEN = (
    ("fine lattice", (30, 60)),
    ("paired", (20, 30)),
    ("ws_ps_bins", (6,)),
    ("seer_sample_3", (8,)),
)
SECONDS = 900
SEEDS = (1, 2, 3)
QUICK_SEEDS = (1, 2)

_T = TypeVar("_T")


class Timed:
    """Searches at once, and keeps how long each of them took."""

    def __init__(self) -> None:
        """Begin with none."""
        self.spent_s: list[float] = []

    def think(self, work: Callable[[], _T]) -> Answer[_T]:
        """As `venus.Think`."""
        began_s = time.process_time()
        found = at_once(work)
        self.spent_s.append(time.process_time() - began_s)
        return found


def measure(instance: Instance, method: TrafficMethod, seed: int, seconds: float) -> Row:
    """One run under the judge."""
    made, timed = floor(instance, seed), Timed()
    made.traffic._think = timed.think
    made.traffic.tune(SceneConfig(traffic_method=method))
    begun(made)
    began_s = time.process_time()
    judged(made, seconds)
    spent_s = sorted(timed.spent_s) or [0.0]
    planner = made.traffic._planner
    counted = planner.counted if isinstance(planner, Venus) else None
    return {
        "orders_per_h": made.orders_per_h(),
        "unserved_s": made.unserved_ms / 1000,
        "cpu_share": (time.process_time() - began_s) / seconds,
        "search_ms_mean": 1000 * sum(spent_s) / len(spent_s),
        "search_ms_max": 1000 * spent_s[-1],
        "by_pibt": counted.by_pibt / max(counted.proposals, 1) if counted else 1.0,
        "incomplete": counted.incomplete / max(counted.plans, 1) if counted else 0.0,
    }


def row(instance: Instance, method: TrafficMethod, free: float, quick: bool) -> Row:
    """All seeds of one instance under one planner: means, and the longest."""
    seconds = instance.quick_s // 2 if quick else SECONDS
    seeds = QUICK_SEEDS if quick else SEEDS
    runs = [measure(instance, method, seed, seconds) for seed in seeds]
    found: Row = {"instance": f"{instance.name}, {method.value}", "robots": instance.robots}
    orders = [float(run["orders_per_h"]) for run in runs]
    found |= {
        "ours": sum(orders) / len(orders) / free,
        "at_least": instance.share,
        "aim": instance.aim,
        "unit": "share of free flow",
        "spread": (max(orders) - min(orders)) / free,
    }
    for key in runs[0]:
        values = [float(run[key]) for run in runs]
        longest = key in ("unserved_s", "search_ms_max")
        found[key] = max(values) if longest else sum(values) / len(values)
    return found


def rows(quick: bool = False, only: str = "") -> list[Row]:
    """Both planners on each instance."""
    found = []
    for part, robots in CHOSEN:
        for instance in (*floors.instances(), *maps.instances()):
            name = f"{instance.name} {instance.robots}"
            if part not in name or instance.robots not in robots or only not in name:
                continue
            seeds = QUICK_SEEDS if quick else SEEDS
            seconds = instance.quick_s // 2 if quick else SECONDS
            controls = [free_orders_per_h(instance, seed, seconds) for seed in seeds]
            free = sum(controls) / len(controls)
            found += [row(instance, method, free, quick) for method in TrafficMethod]
    return found


if __name__ == "__main__":
    report("traffic: the two planners", rows, __doc__)
