"""Python's cyclic collector, kept off the requests: it costs 100 ms of p99 if left alone.

Live orders, events and messages hold no cycles (`gc=False`), so what is left to collect is little:
start-up objects are frozen, thresholds raised, and a full collection runs when nobody waits.
"""

import asyncio
import gc
import time
from collections.abc import Callable

from prometheus_client import Histogram

PAUSES = Histogram(
    "fleetledger_gc_pause_seconds",
    "Pauses of the cyclic collector",
    ["generation"],
    buckets=(0.001, 0.005, 0.01, 0.025, 0.05, 0.1, 0.5),
)
IDLE_CHECK_S = 30.0


def tame() -> None:
    """Freeze what start-up made, collect seldom, and measure each pause."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 50, 1000)
    began = 0.0

    def measure(phase: str, info: dict[str, int]) -> None:
        nonlocal began
        if phase == "start":
            began = time.perf_counter()
        else:
            PAUSES.labels(str(info["generation"])).observe(time.perf_counter() - began)

    gc.callbacks.append(measure)


async def collect_when_idle(idle: Callable[[], bool]) -> None:
    """Collect fully now and then, when nothing is in flight; ends when cancelled."""
    while True:
        await asyncio.sleep(IDLE_CHECK_S)
        if idle():
            gc.collect()
