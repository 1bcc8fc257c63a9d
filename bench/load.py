"""A load from another process: keep-alive HTTP clients on raw sockets, and the disk's own rate."""

import os
import select
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

from ledger.scene import Value

RECV_BYTES = 65_536


class Spread(Value, frozen=True, kw_only=True):
    """Latencies of many calls, in milliseconds, and their rate."""

    calls: int
    per_s: float
    p50_ms: float
    p99_ms: float
    failed: int


def spread(latencies_s: list[float], took_s: float, failed: int) -> Spread:
    """Sum up."""
    ordered = sorted(latencies_s)
    if not ordered:
        raise RuntimeError(f"all {failed} calls failed")
    return Spread(
        calls=len(ordered),
        per_s=len(ordered) / took_s,
        p50_ms=ordered[len(ordered) // 2] * 1e3,
        p99_ms=ordered[int(len(ordered) * 0.99)] * 1e3,
        failed=failed,
    )


class Run:
    """What the clients of one measurement share: requests to send, and how they were answered."""

    def __init__(self, requests: list[bytes]) -> None:
        """Take one request, to be sent again and again, or several, to be sent once each."""
        self.latencies: list[float] = []
        self.failed = 0
        self._requests = requests
        self._next: Iterator[bytes] = iter(requests)

    def take(self) -> bytes | None:
        """Give the next request; None where all have been sent."""
        return self._requests[0] if len(self._requests) == 1 else next(self._next, None)

    def note(self, began: float, *, good: bool) -> None:
        """Note an answer."""
        if good:
            self.latencies.append(time.perf_counter() - began)
        else:
            self.failed += 1


class Client:
    """One connection: it waits for the answer to its call before it sends the next."""

    def __init__(self, port: int) -> None:
        """Connect."""
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._began = 0.0
        self._come = b""

    def send(self, request: bytes) -> None:
        """Send a call."""
        self._began = time.perf_counter()
        self.socket.sendall(request)

    def hear(self, run: Run) -> bool:
        """Take what has come; gives whether the answer is whole, and then notes it."""
        part = self.socket.recv(RECV_BYTES)
        if not part:
            raise ConnectionError("the server closed a connection")
        self._come += part
        end = self._come.find(b"\r\n\r\n")
        if end < 0:
            return False
        at = self._come.find(b"content-length: ", 0, end) + len(b"content-length: ")
        if len(self._come) < end + 4 + int(self._come[at : self._come.index(b"\r", at)]):
            return False
        run.note(self._began, good=self._come.startswith(b"HTTP/1.1 200"))
        self._come = b""
        return True


def http_load(port: int, run: Run, connections: int, seconds: float) -> float:
    """Call over so many connections at once; gives the seconds that it took.

    One loop over epoll: with asyncio's streams the load took as much of the two cores as the server
    that it is to measure (80 µs an order, 25 so).
    """
    clients = {
        client.socket.fileno(): client for client in (Client(port) for _ in range(connections))
    }
    poll = select.epoll()
    began = time.perf_counter()
    until = began + seconds
    waiting = 0
    try:
        for number, client in clients.items():
            if (request := run.take()) is not None:
                poll.register(number, select.EPOLLIN)
                client.send(request)
                waiting += 1
        while waiting:
            for number, _ in poll.poll():
                client = clients[number]
                if not client.hear(run):
                    continue
                request = run.take() if time.perf_counter() < until else None
                if request is None:
                    waiting -= 1
                else:
                    client.send(request)
    finally:
        poll.close()
        for client in clients.values():
            client.socket.close()
    return time.perf_counter() - began


def post(path: str, body: object) -> bytes:
    """Give the bytes of a request."""
    raw = msgspec.json.encode(body)
    head = f"POST {path} HTTP/1.1\r\nhost: fleet\r\ncontent-type: application/json\r\n"
    return (head + f"content-length: {len(raw)}\r\n\r\n").encode() + raw


def load(port: int, request: bytes, connections: int, seconds: float) -> Spread:
    """Send one request again and again over so many connections."""
    run = Run([request])
    took_s = http_load(port, run, connections, seconds)
    return spread(run.latencies, took_s, run.failed)


def syncs_per_s(folder: Path, seconds: float) -> float:
    """Append 400 bytes and fdatasync, one after another: the raw control."""
    path = folder / "control"
    with path.open("wb", buffering=0) as file:
        began = time.perf_counter()
        count = 0
        while time.perf_counter() - began < seconds:
            file.write(b"x" * 400)
            os.fdatasync(file.fileno())
            count += 1
        took_s = time.perf_counter() - began
    path.unlink()
    return count / took_s


def timed(work: Callable[[], object], times: int) -> Spread:
    """Call so many times and sum up."""
    latencies = []
    began = time.perf_counter()
    for _ in range(times):
        start = time.perf_counter()
        work()
        latencies.append(time.perf_counter() - start)
    return spread(latencies, time.perf_counter() - began, 0)
