"""The program as a user starts it: a server in a process of its own, watched without sleeping."""

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import httpx

from commands.imports.scene_json import write_scene
from ledger.scene import SceneFile
from sim.warehouses import generate

START_S_MAX = 60.0  # on a busy machine
STOP_S_MAX = 5.0  # contract
EVENT_S_MAX = 60.0
CALL_S_MAX = 30.0


class Server:
    """A server that has said `ready`."""

    def __init__(self, process: "subprocess.Popen[str]", data: Path, log: Path, line: str) -> None:
        self.process, self.data, self.log, self.line = process, data, log, line
        self.url = line.removeprefix("ready ").strip()
        self.port = int(self.url.rsplit(":", 1)[1])
        self.client = httpx.Client(base_url=self.url, timeout=CALL_S_MAX)
        self.children = children(data, process.pid)

    def get(self, path: str, **parameters: Any) -> Any:
        answer = self.client.get(path, params=parameters)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def post(self, path: str, body: object, **headers: str) -> Any:
        answer = self.client.post(path, json=body, headers=headers)
        assert answer.status_code == 200, answer.text
        return answer.json() if answer.content else None

    @property
    def scene(self) -> str:
        """Id of the first scene."""
        return str(self.get("/api/fleet/scenes/list")[0]["id"])

    def order(self, source: str, target: str, **headers: str) -> str:
        """Send a sealed order from bin to bin; gives its id."""
        body = order_body(self.scene, source, target)
        return str(self.post("/api/fleet/orders/create", body, **headers)["orderId"])

    def found(self, *ids: str) -> dict[str, Any]:
        """Find orders; those with these ids, or all."""
        query: dict[str, Any] = {"type": "All"}
        if ids:
            query = {"type": "General", "field1": "id", "operator": "In", "value": list(ids)}
        body = {"entityName": "TransportOrder", "query": query}
        rows = self.post("/api/entity/find/many", body)
        by_id = {row["id"]: row for row in rows}
        assert len(by_id) == len(rows), "an order was found twice"
        return by_id

    def until(self, wanted: Callable[[dict[str, Any]], bool], after: int = 0) -> dict[str, Any]:
        """Follow the stream of events behind a position to the first that is wanted."""
        deadline = time.monotonic() + EVENT_S_MAX
        headers = {"accept": "text/event-stream"}
        path = f"/api/ledger/events?after={after}"
        with self.client.stream("GET", path, headers=headers) as stream:
            for line in stream.iter_lines():
                if line.startswith("data: "):
                    event: dict[str, Any] = json.loads(line.removeprefix("data: "))
                    if wanted(event):
                        return event
                assert time.monotonic() < deadline, f"not within {EVENT_S_MAX} s"
        raise AssertionError("the stream ended")

    def until_finished(self, order: str) -> dict[str, Any]:
        """Wait for an order's end."""
        return self.until(lambda e: e["type"] == "OrderFinished" and e["order"] == order)

    def stop(self) -> int:
        """Tell it to end; gives its exit code."""
        self.client.close()
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(STOP_S_MAX)

    def kill(self) -> None:
        """End it as a power cut would, as far as it can tell."""
        self.process.kill()
        self.process.wait()
        self.client.close()


def order_body(scene: str, source: str, target: str) -> dict[str, Any]:
    """An order as clients write it."""
    load = {"location": source, "rbkArgs": {"binTask": "Load"}, "forLoad": True}
    unload = {"location": target, "rbkArgs": {"binTask": "Unload"}, "forUnload": True}
    return {"sceneId": scene, "stepFixed": True, "steps": [load, unload]}


def command(data: Path, *options: str) -> list[str]:
    """Command line of `serve` on a free port."""
    own = [sys.executable, "-m", "fleetledger", "serve", "--data", str(data)]
    return [*own, "--port", "0", *options]


def serving(data: Path, *options: str) -> AbstractContextManager[Server]:
    """Start a server."""
    return started(command(data, *options), data)


@contextmanager
def started(command_line: list[str], data: Path) -> Iterator[Server]:
    """Start a program that serves, wait for its line, and leave nothing behind."""
    log = data.parent / f"{data.name}.log"
    with log.open("a") as errors:
        process = subprocess.Popen(command_line, stdout=subprocess.PIPE, stderr=errors, text=True)
    try:
        assert process.stdout is not None
        assert select.select([process.stdout], [], [], START_S_MAX)[0], "it said nothing"
        line = process.stdout.readline()
        assert line.startswith(("ready http://", "ready https://")), log.read_text()[-2000:]
        server = Server(process, data, log, line)
        try:
            yield server
        finally:
            server.client.close()
    finally:
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(STOP_S_MAX)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        assert process.stdout is not None
        process.stdout.close()


def small_scene(folder: Path, robots: int = 3) -> Path:
    """Write a generated warehouse."""
    path = folder / "scene.json"
    path.write_bytes(write_scene(small_file(robots)))
    return path


def small_file(robots: int = 3) -> SceneFile:
    return generate(aisles=2, bays=2, robots=robots, seed=1)


def children(data: Path, but: int) -> list[int]:
    """Find the processes that work on a data folder."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal() and int(folder.name) != but:
            try:
                arguments = (folder / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue  # it has just ended
            if b"role" in arguments and str(data).encode() in arguments:
                found.append(int(folder.name))
    return found


def still_there(processes: list[int], seconds: float = 10.0) -> list[int]:
    """Wait for processes to end, and name those that do not."""
    deadline = time.monotonic() + seconds
    left = []
    for number in processes:
        try:
            handle = os.pidfd_open(number)
        except ProcessLookupError:
            continue
        try:
            ready = select.select([handle], [], [], max(0.0, deadline - time.monotonic()))[0]
            if not ready:
                left.append(number)
        finally:
            os.close(handle)
    return left
