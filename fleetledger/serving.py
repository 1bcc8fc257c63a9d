"""Runs the server, alone or with a demo around it, until it is told to stop."""

import asyncio
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import uvloop
from rich.console import Console

from fleetledger.app import run
from fleetledger.config import Auth, Settings
from fleetledger.demo import OrderStream
from fleetledger.logs import configure
from sim.warehouses import for_robots

people = Console(stderr=True)


def serve(settings: Settings, started: Callable[[str, int], None] | None = None) -> int:
    """Serve until SIGTERM or SIGINT, and give the exit code; prints the line others wait for."""
    configure(process="core", as_json=settings.log_json)

    def ready(host: str, port: int) -> None:
        sys.stdout.write(f"ready {settings.scheme}://{host}:{port}\n")
        sys.stdout.flush()
        if started is not None:
            started(host, port)

    async def until_signalled() -> int:
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, stop.set)
        return await run(settings, stop, ready)

    return uvloop.run(until_signalled())


def demo(
    *, robots: int, orders_per_minute: float, speed: float, port: int, data: Path, seed: int
) -> int:
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
        return serve(settings, started)
    finally:
        for stream in streams:
            stream.stop()
