"""Every call of the M4 catalogue at 32 connections while 100 robots drive: `python -m bench.calls`.

Each request is one that the server takes, every field filled in, made before the clock starts; the
load is a process of its own on the same two cores. Needs the specification's catalogue beside the
repository, as the tests of conformance do.
"""

import asyncio
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import msgspec
from websockets.asyncio.client import connect
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as sync_connect

from bench.load import Run, Spread, http_load, spread, syncs_per_s
from ledger.scene import ContainerType, SceneFile
from sim.warehouses import for_robots
from tests.conformance.catalogue import Call, catalogue
from tests.conformance.plant import GOOD, Plant
from tests.fleetledger.server import Server, order_body, serving

CONNECTIONS = 32
SECONDS = 2.0
REQUESTS = 640  # made ready for a call that changes something; a question is one, repeated
ROBOTS = 100
ORDERS = 300  # on their way all along
FRAMES_A_SECOND = 40  # of one client: beyond 50 the server lets it wait
LAST = ("orders-cancel-all", "external-map-res-release-all")
ADDING = ("robots-create", "robots-update", "robots-remove")  # their robots stay: fewer of them
ADDED = 96


class Busy(Plant):
    """A plant whose robots drive: what the calls need waits behind their orders."""

    def __init__(self, server: Server, file: SceneFile, socket: ClientConnection) -> None:
        super().__init__(server, file, socket)
        self.made: list[str] = []
        self.robots_before = set(self.robots)

    def order(self, **fields: Any) -> str:
        """Make an order that no robot has time for."""
        self.made.append(super().order(priority=-5, **fields))
        return self.made[-1]

    def tidy(self) -> None:
        """Cancel the orders and remove the robots of one call: the next meets the same plant."""
        self.server.post("/api/fleet/orders/cancel-batch", {"orderIds": self.made})
        self.made.clear()
        there = self.server.get("/api/fleet/robots/all-all", sceneId=self.scene).keys()
        added = sorted(there - self.robots_before)
        path = f"/api/fleet/scenes/{self.scene}/robot/remove"
        self.server.post(path, {"robotNames": added})


def ready(plant: Plant, call: Call) -> list[dict[str, Any]]:
    """Make requests, as many as may be needed."""
    if call.method != "POST" or call.id.startswith("entity-find"):
        return [GOOD[call.id](plant)]
    count = ADDED if call.id.startswith(ADDING) else REQUESTS
    return [GOOD[call.id](plant) for _ in range(count)]


def encoded(call: Call, request: dict[str, Any]) -> bytes:
    """Give the bytes of an HTTP request."""
    path = call.path.format(**request.get("path", {}))
    if request.get("query"):
        path += f"?{urlencode(request['query'])}"
    body = json.dumps(request["body"]).encode() if "body" in request else b""
    head = f"{call.method} {path} HTTP/1.1\r\nhost: fleet\r\ncontent-type: application/json\r\n"
    return (head + f"content-length: {len(body)}\r\n\r\n").encode() + body


async def _websocket(url: str, run: Run, until: float) -> None:
    async with connect(url, max_size=None, compression=None) as socket:
        while time.perf_counter() < until and (request := run.take()) is not None:
            began = time.perf_counter()
            await socket.send(request.decode())
            reply = await socket.recv()
            took_s = time.perf_counter() - began
            run.note(began, good="::Error" not in str(reply)[:200])
            await asyncio.sleep(max(0.0, 1 / FRAMES_A_SECOND - took_s))


def socket_url(server: Server) -> str:
    """Say where the WebSocket is."""
    return f"{server.url.replace('http', 'ws')}/wsm"


def measure(server: Server, call: Call, requests: list[dict[str, Any]]) -> Spread:
    """Send them over all connections."""
    if call.method != "WS":
        run = Run([encoded(call, request) for request in requests])
        took_s = http_load(server.port, run, CONNECTIONS, SECONDS)
        return spread(run.latencies, took_s, run.failed)
    frames = [{"action": call.path, "content": json.dumps(r["content"])} for r in requests]
    run = Run([json.dumps(frame).encode() for frame in frames])

    async def everybody() -> float:
        began = time.perf_counter()
        until, url = began + SECONDS, socket_url(server)
        await asyncio.gather(*(_websocket(url, run, until) for _ in range(CONNECTIONS)))
        return time.perf_counter() - began

    return spread(run.latencies, asyncio.run(everybody()), run.failed)


def main() -> list[dict[str, float | str]]:
    """Measure all of them, the two that clear everything at the end."""
    wanted = sys.argv[1:] or [call.id for call in catalogue().calls]
    calls = [call for call in catalogue().calls if call.id in wanted]
    calls.sort(key=lambda call: (call.id in LAST, call.id))
    rows: list[dict[str, float | str]] = []
    folder = Path(tempfile.mkdtemp(prefix="fleetledger-bench-"))
    options = ("--auth", "none", "--simulate")
    with serving(folder / "data", *options) as server, sync_connect(socket_url(server)) as socket:
        pallet = (ContainerType(name="pallet"),)
        file = msgspec.structs.replace(for_robots(ROBOTS, 1), container_types=pallet)
        server.post("/api/fleet/scenes/import", msgspec.to_builtins(file))
        plant = Busy(server, file, socket)
        drive(plant)
        for call in calls:
            requests = ready(plant, call)
            figures = measure(server, call, requests)
            plant.tidy()
            rows.append(
                {
                    "call": call.id,
                    "per_s": figures.per_s,
                    "p50_ms": figures.p50_ms,
                    "p99_ms": figures.p99_ms,
                    "failed": float(figures.failed),
                }
            )
            words = (f"{k} {v:,.1f}" if isinstance(v, float) else v for k, v in rows[-1].items())
            print(", ".join(words), flush=True)
    print(f"control: {syncs_per_s(folder, 1.0):,.0f} fdatasync/s")
    return rows


def drive(plant: Plant) -> None:
    """Send orders for all robots, and wait until many are on their way."""
    bins = plant.bins
    for n in range(ORDERS):
        body = order_body(plant.scene, bins[n % len(bins)], bins[-1 - n % 7])
        plant.done = str(plant.server.post("/api/fleet/orders/create", body)["orderId"])
    begun: set[str] = set()

    def enough(event: dict[str, Any]) -> bool:
        if event["type"] == "StepStarted":
            begun.add(event["robot"])
        return len(begun) > ROBOTS * 0.8

    plant.server.until(enough)


if __name__ == "__main__":
    main()
