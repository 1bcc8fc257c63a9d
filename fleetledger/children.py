"""The processes that a server starts; they import nothing of the server's own."""

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

from fleetledger import roles
from fleetledger.clock import Clock
from fleetledger.logs import configure
from fleetledger.orphaned import stop_when_orphaned
from ledger.zenoh_bus import ZenohBus
from sim.faults import MIXES


def run_scheduler(listen: str, connect: list[str], clock: str, data: Path) -> None:
    """Be the scheduler's process."""
    with _role("scheduler", listen, connect) as (bus, stop):
        roles.run_scheduler(bus, Clock.parse(clock), data / "compiled", stop)


def run_sim(connect: list[str], clock: str, data: Path, seed: int, faults: str) -> None:
    """Be the simulator's process."""
    with _role("sim", None, connect) as (bus, stop):
        roles.run_sim(bus, Clock.parse(clock), data / "sim.json", seed, MIXES[faults], stop)


@contextlib.contextmanager
def _role(
    name: str, listen: str | None, connect: list[str]
) -> Iterator[tuple[ZenohBus, threading.Event]]:
    configure(process=name, as_json=not sys.stderr.isatty())
    stop = stop_when_orphaned()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    bus = ZenohBus(listen, connect)
    try:
        yield bus, stop
    finally:
        bus.close()  # open sessions keep a process alive for ever
