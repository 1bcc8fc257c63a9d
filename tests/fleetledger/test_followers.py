"""Others follow a real server, by the programs of docs/followers.md: killed, flooded, stalled."""

import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import httpx

from fleetledger.listening import free_port
from ledger.scan import read_folder
from tests.fleetledger.server import Server, serving, small_scene
from tests.laws.test_kill import Clients

PAGE = Path(__file__).parents[2] / "docs" / "followers.md"
LINE_S_MAX = 60.0


def program(folder: Path, name: str) -> Path:
    """Write a program of the page into a file."""
    blocks = re.findall(r"```python\n# (\S+).*?\n(.*?)```", PAGE.read_text(), re.DOTALL)
    path = folder / name
    path.write_text(dict(blocks)[name])
    return path


@contextmanager
def running(folder: Path, name: str, *arguments: str) -> Iterator[tuple[subprocess.Popen, Path]]:
    """Run a program of the page; what it prints is in the file."""
    printed = folder / f"{name}.txt"
    command = [sys.executable, str(program(folder, name)), *arguments]
    with printed.open("a") as out:
        process = subprocess.Popen(command, stdout=out)
    try:
        yield process, printed
    finally:
        process.kill()
        process.wait()


def seen(printed: Path) -> list[tuple[int, str]]:
    whole, _, _ = printed.read_text().rpartition("\n")  # the last line is perhaps being written
    lines = [line.split() for line in whole.splitlines()]
    return [(int(position), kind) for position, kind in lines]


def until_seen(printed: Path, server: Server, position: int) -> None:
    """Wait: each heartbeat of our own stream is a moment to look again."""
    with server.client.stream(
        "GET", "/api/ledger/events?after=0", headers={"accept": "text/event-stream"}, timeout=60
    ) as stream:
        looks = 0
        for line in stream.iter_lines():
            if line.startswith(":"):
                looks += 1
                assert looks * 5 < LINE_S_MAX, seen(printed)[-3:]
            if (found := seen(printed)) and found[-1][0] >= position:
                return


def stalled(server: Server) -> socket.socket:
    """Ask for the stream, and never read."""
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.connect(("127.0.0.1", server.port))
    made.sendall(b"GET /api/ledger/events HTTP/1.1\r\nHost: x\r\nAccept: text/event-stream\r\n\r\n")
    return made


def flood(server: Server, round_: int) -> Clients:
    clients = Clients(server, round_, Random(round_))
    assert clients.enough.wait(60)
    return clients


def another_history_is_told(server: Server, folder: Path) -> None:
    """As after a backup was restored: what was followed is not there, or is something else."""
    newest = server.get("/api/ledger/position")["position"]
    headers = {"accept": "text/event-stream", "last-event-id": str(newest + 50)}
    answer = httpx.get(f"{server.url}/api/ledger/events", headers=headers, timeout=60)
    assert (answer.status_code, answer.json()["code"]) == (409, "errAheadOfLedger")
    event = server.get("/api/ledger/events", after=newest - 1)[0]
    kept = folder / "another.json"
    kept.write_text(json.dumps(event | {"command": "another"}))
    other = [sys.executable, str(program(folder, "follow_http.py")), server.url, str(kept)]
    done = subprocess.run(other, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr.strip()) == (1, "another history: begin anew")


def test_followers_miss_nothing_through_flood_stall_kill_and_restart(tmp_path: Path) -> None:
    data, scene = tmp_path / "data", small_scene(tmp_path)
    feed, port = free_port(), free_port()
    options = ("--auth", "none", "--feed-port", str(feed), "--port", str(port))
    endpoint = f"tcp/127.0.0.1:{feed}"
    with serving(data, *options, "--scene", str(scene)) as server:
        http = running(tmp_path, "follow_http.py", server.url, str(tmp_path / "kept.json"))
        with running(tmp_path, "follow_zenoh.py", endpoint) as (bus, by_bus), http as (_, by_http):
            first = flood(server, 1)
            until_seen(by_bus, server, 5)
            bus.send_signal(signal.SIGSTOP)
            server.kill()
            first.join()
            with serving(data, *options) as again, stalled(again):
                another_history_is_told(again, tmp_path)
                second = flood(again, 2)
                again_kill = again.get("/api/ledger/position")["position"]
                bus.send_signal(signal.SIGCONT)
                until_seen(by_bus, again, again_kill)
                until_seen(by_http, again, again_kill)
                code = again.stop()
                second.join()
            assert code == 0
    events = list(read_folder(data / "ledger"))
    for printed in (by_bus, by_http):
        told = seen(printed)
        assert told == [(e.position, type(e).__name__) for e in events[: len(told)]]
        assert len(told) >= again_kill
