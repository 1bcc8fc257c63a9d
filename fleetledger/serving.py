"""Runs the processes that the command line names, until they are told to stop."""

import asyncio
import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import typer
import uvloop
from rich.console import Console

from fleetledger.app import run
from fleetledger.clock import Clock
from fleetledger.config import Auth, Settings
from fleetledger.demo import OrderStream
from fleetledger.logs import configure
from fleetledger.roles import run_scheduler as scheduler_role
from fleetledger.roles import run_sim as sim_role
from fleetledger.roles import stop_when_orphaned
from ledger.zenoh_bus import ZenohBus
from sim.warehouses import for_robots

people = Console(stderr=True)


def serve(settings: Settings, started: Callable[[str, int], None] | None = None) -> None:
    """Serve until SIGTERM or SIGINT; prints the one line that others wait for."""
    configure(process="core", as_json=settings.log_json)

    def ready(host: str, port: int) -> None:
        sys.stdout.write(f"ready http://{host}:{port}\n")
        sys.stdout.flush()
        if started is not None:
            started(host, port)

    async def until_signalled() -> int:
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, stop.set)
        return await run(settings, stop, ready)

    code = uvloop.run(until_signalled())
    if code:
        raise typer.Exit(code)


def demo(
    *, robots: int, orders_per_minute: float, speed: float, port: int, data: Path, seed: int
) -> None:
    """Serve a generated warehouse with simulated robots, and send it orders."""
    data.mkdir(parents=True, exist_ok=True)
    scene = data / f"warehouse-{robots}-{seed}.json"
    scene.write_bytes(msgspec.json.format(msgspec.json.encode(for_robots(robots, seed))))
    settings = Settings.load(
        data, port=port, auth=Auth.NONE, scene=(scene,), simulate=True, speed=speed, seed=seed
    )
    streams: list[OrderStream] = []

    def started(host: str, port: int) -> None:
        people.print(f"\n[bold]Fleetledger[/] with {robots} simulated robots\n")
        people.print(f"  console    http://{host}:{port}/")
        people.print(f"  API pages  http://{host}:{port}/docs")
        people.print(f"  history    {data}   (kept; the next demo goes on from here)\n")
        people.print("  Ctrl-C stops everything.\n")
        rate = orders_per_minute * speed
        streams.append(OrderStream(port, per_minute=rate, robots=robots, seed=seed))
        streams[0].start()

    try:
        serve(settings, started)
    finally:
        for stream in streams:
            stream.stop()


def run_scheduler(listen: str, connect: list[str], clock: str, data: Path) -> None:
    """Be the scheduler's process."""
    with _role("scheduler", listen, connect) as (bus, stop):
        scheduler_role(bus, Clock.parse(clock), data / "compiled", stop)


def run_sim(connect: list[str], clock: str, data: Path, seed: int) -> None:
    """Be the simulator's process."""
    with _role("sim", None, connect) as (bus, stop):
        sim_role(bus, Clock.parse(clock), data / "sim.json", seed, stop)


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
