"""A load from another process: keep-alive HTTP clients on raw sockets, and the disk's own rate."""

import asyncio
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

from ledger.scene import Value


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


async def http_client(port: int, run: Run, until: float) -> None:
    """Send requests one after the other over one connection."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        while time.perf_counter() < until and (request := run.take()) is not None:
            began = time.perf_counter()
            writer.write(request)
            head = await reader.readuntil(b"\r\n\r\n")
            length = int(head.lower().split(b"content-length: ")[1].split(b"\r\n")[0])
            if length:
                await reader.readexactly(length)
            run.note(began, good=head.startswith(b"HTTP/1.1 200"))
    finally:
        writer.close()


def post(path: str, body: object) -> bytes:
    """Give the bytes of a request."""
    raw = msgspec.json.encode(body)
    head = f"POST {path} HTTP/1.1\r\nhost: fleet\r\ncontent-type: application/json\r\n"
    return (head + f"content-length: {len(raw)}\r\n\r\n").encode() + raw


def load(port: int, request: bytes, connections: int, seconds: float) -> Spread:
    """Send one request again and again over so many connections."""
    run = Run([request])

    async def all_clients() -> float:
        began = time.perf_counter()
        until = began + seconds
        await asyncio.gather(*(http_client(port, run, until) for _ in range(connections)))
        return time.perf_counter() - began

    return spread(run.latencies, asyncio.run(all_clients()), run.failed)


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
