"""A scene pushed to 50 clients while 1000 robots drive: `python -m bench.stream`.

The server is the program as a user starts it, all of it in one process but the scheduler, which is
held still: instead, a feeder publishes over the bus what 1000 driving robots and a scheduler do,
ten reports a second of each robot and one plan, and ten orders a second are created over HTTP.
CPU is what the process itself has used (all threads, user and system), as a share of one core.
The clients read and throw away, in a process of their own; one of them may stop reading.
"""

import asyncio
import base64
import json
import multiprocessing
import os
import signal
import time
import urllib.request
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import msgspec

from bench.server import Running, running
from ledger.bus import PROPOSE_KEY, plans_key, report_key
from ledger.ids import PathKey, RobotName, SceneId
from ledger.link import Plan, Report, Space
from ledger.proposals import ConnectRobot
from ledger.scene import RobotConfig, SceneFile
from ledger.zenoh_bus import ZenohBus
from sim.warehouses import generate

ROBOTS, CLIENTS, SECONDS, HZ = 1000, 50, 30.0, 10
ORDERS_PER_S = 10
SETTLE_S = 3.0
SIDE = 32  # robots stand in a square of so many a side

Row = dict[str, float | str]


def scene() -> SceneFile:
    """A small map with very many robots: only what they report matters here."""
    robots = tuple(RobotConfig(name=RobotName(f"AMB-{n:04d}")) for n in range(ROBOTS))
    return msgspec.structs.replace(generate(aisles=2, bays=2, robots=1, seed=1), robots=robots)


class Feeder:
    """What robots and a scheduler would publish."""

    def __init__(self, endpoint: str, scene: SceneId, clock: tuple[int, float]) -> None:
        self._bus = ZenohBus(None, [endpoint])
        self._scene = scene
        self._clock = clock
        self._names = [RobotName(f"AMB-{n:04d}") for n in range(ROBOTS)]

    def connect(self) -> None:
        """Say that all robots answer."""
        for first in range(0, ROBOTS, 100):
            batch = [
                ConnectRobot(scene=self._scene, robot=name)
                for name in self._names[first : first + 100]
            ]
            self._bus.ask(PROPOSE_KEY, msgspec.json.encode(batch), 10.0)

    def feed(self, stop: Any) -> None:
        """Publish until told to stop."""
        due, tick = time.monotonic(), 0
        while not stop.is_set():
            at_ms = self._clock[0] + round((time.monotonic() - self._clock[1]) * 1000)
            for n, name in enumerate(self._names):
                payload = msgspec.json.encode(self._report(n, name, tick, at_ms))
                self._bus.publish(report_key(self._scene, name), payload)
            plans = [self._plan(n, tick, at_ms) for n in range(tick % HZ, ROBOTS, HZ)]
            self._bus.publish(plans_key(self._scene), msgspec.json.encode(plans))
            tick += 1
            due += 1 / HZ
            time.sleep(max(0.0, due - time.monotonic()))  # robots report at a pace
        self._bus.close()

    def _report(self, n: int, name: RobotName, tick: int, at_ms: int) -> Report:
        along_m = tick / HZ % 20
        return Report(
            scene=self._scene,
            robot=name,
            number=tick,
            at_ms=at_ms,
            area=0,
            x_m=n % SIDE * 25 + along_m,
            y_m=n // SIDE * 3.0,
            heading_rad=0.01 * (tick % 7),
            speed_mps=1.0 + 0.01 * (tick % 5),
            battery_ratio=0.9 - tick / 1e6,
            odometer_today_m=tick / HZ,
            map_name="warehouse",
            map_digest="0" * 32,
            session="s",
        )

    def _plan(self, n: int, tick: int, at_ms: int) -> Plan:
        step = tick // HZ % 10
        x0, y0 = n % SIDE * 25.0 + 2 * step, n // SIDE * 3.0
        corners = [((x, y0), (x + 2, y0), (x + 2, y0 + 1), (x, y0 + 1)) for x in (x0, x0 + 2)]
        return Plan(
            scene=self._scene,
            robot=self._names[n],
            at_ms=at_ms,
            ready=True,
            untravelled=tuple(PathKey(f"LM{p}->LM{p + 1}") for p in range(step, 12)),
            spaces=tuple(Space(points=points) for points in corners),
            commit=tick,
            moving=True,
        )


def _feeding(endpoint: str, scene: SceneId, clock: tuple[int, float], stop: Any) -> None:
    feeder = Feeder(endpoint, scene, clock)
    feeder.connect()  # waits for the core to answer
    feeder.feed(stop)


def _scheduler(server: Running) -> tuple[int, str]:
    """Find the scheduler's process, and the endpoint of the core in its command line."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            with suppress(OSError):
                words = (folder / "cmdline").read_bytes().decode().split("\0")
                if "scheduler" in words and str(server.data) in words:
                    return int(folder.name), words[words.index("--connect") + 1]
    raise RuntimeError("no scheduler")


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Reader(asyncio.Protocol):
    """A client that subscribes, and throws away what it reads, or reads no more."""

    def __init__(self, scene: str) -> None:
        content = json.dumps({"sceneId": scene})
        self._ask = json.dumps({"action": "Fleetledger::Scene::Subscribe", "content": content})
        self.bytes = 0
        self.transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask for a WebSocket."""
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        key = base64.b64encode(os.urandom(16)).decode()
        transport.write(
            f"GET /wsm HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Key: {key}\r\n\r\n".encode()
        )

    def data_received(self, data: bytes) -> None:
        """Subscribe once the handshake is answered; count all else."""
        if self.bytes == 0:  # the handshake's answer
            assert self.transport is not None
            text = self._ask.encode()
            length = bytes([0x80 | len(text)])
            if len(text) > 125:
                length = bytes([0xFE]) + len(text).to_bytes(2, "big")
            self.transport.write(b"\x81" + length + b"\0\0\0\0" + text)  # masked by nothing
        self.bytes += len(data)


def _reading(port: int, scene: str, clients: int, stalled: int, pipe: Connection) -> None:
    asyncio.run(_read(port, scene, clients, stalled, pipe))


async def _read(port: int, scene: str, clients: int, stalled: int, pipe: Connection) -> None:
    loop = asyncio.get_running_loop()
    readers = []
    for _ in range(clients + stalled):
        _, reader = await loop.create_connection(lambda: Reader(scene), "127.0.0.1", port)
        readers.append(reader)
    await asyncio.sleep(SETTLE_S)
    for reader in readers[clients:]:
        assert reader.transport is not None
        reader.transport.pause_reading()
    pipe.send("reading")
    while True:
        await asyncio.to_thread(pipe.recv)
        pipe.send(sum(reader.bytes for reader in readers[:clients]))


def _orders(port: int, scene: str, stop: Any) -> None:
    body = {"sceneId": scene, "stepFixed": True, "steps": [{"location": "LM1"}]}
    while not stop.is_set():
        with suppress(OSError):  # the server is busy
            _post(port, "/api/fleet/orders/create", body)
        time.sleep(1 / ORDERS_PER_S)  # the load that is measured against has a pace


def _measured(server: Running, clients: int, stalled: int, what: str) -> Row:
    ours, theirs = multiprocessing.Pipe()
    arguments = (server.port, server.scene, clients, stalled, theirs)
    reading = multiprocessing.Process(target=_reading, args=arguments, daemon=True)
    reading.start()
    try:
        ours.recv()
        ours.send("")
        bytes_before, cpu_before, began = ours.recv(), _cpu_s(server.process.pid), time.monotonic()
        time.sleep(SECONDS)  # the time that is measured
        took_s, cpu_s = time.monotonic() - began, _cpu_s(server.process.pid) - cpu_before
        ours.send("")
        read = ours.recv() - bytes_before
    finally:
        reading.terminate()
        reading.join()
    each = read / max(clients, 1) / took_s
    rss_mb = _rss_mb(server.process.pid)
    return {
        "what": what,
        "cpu_share": cpu_s / took_s,
        "kB_per_client_s": each / 1e3,
        "rss_mb": rss_mb,
    }


def _rss_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> list[Row]:
    """Measure the server without clients, with all, and with one more that reads nothing."""
    rows: list[Row] = []
    context = multiprocessing.get_context("spawn")
    with running(scene()) as server:
        scheduler, endpoint = _scheduler(server)
        os.kill(scheduler, signal.SIGSTOP)
        stop = context.Event()
        clock = (_now_ms(server), time.monotonic())
        arguments = (endpoint, server.scene, clock, stop)
        feeder = context.Process(target=_feeding, args=arguments)
        orders = context.Process(target=_orders, args=(server.port, server.scene, stop))
        feeder.start()
        orders.start()
        try:
            time.sleep(SETTLE_S * 3)  # the first reports and caches are not to be measured
            for clients, stalled, what in (
                (0, 0, "no clients"),
                (CLIENTS, 0, f"{CLIENTS} clients"),
                (CLIENTS, 1, f"{CLIENTS} clients and a stalled one"),
            ):
                row = _measured(server, clients, stalled, what)
                rows.append(row)
                print(", ".join(
                    f"{k} {v:,.3f}" if isinstance(v, float) else v for k, v in row.items()
                ), flush=True)  # fmt: skip
        finally:
            stop.set()
            feeder.join(10)
            orders.join(10)
            os.kill(scheduler, signal.SIGCONT)
    return rows


def _now_ms(server: Running) -> int:
    """Give the server's time."""
    path = f"/api/fleet/scenes/{server.scene}/query-all"
    reply = _post(server.port, path, {"excluded": ["robots"]})
    return int(reply["replyTimestamp"])


def _post(port: int, path: str, body: object) -> Any:
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}{path}",
        json.dumps(body).encode(),
        {"content-type": "application/json"},
    )
    return json.loads(urllib.request.urlopen(request).read())


if __name__ == "__main__":
    main()
