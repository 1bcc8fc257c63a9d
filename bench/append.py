"""How fast the ledger takes events, beside the raw disk in that minute: `python -m bench.append`.

Sync latency of a virtual disk changes from minute to minute by a factor of ten, so each measured
round of acknowledged appends stands between two rounds of plain write + fdatasync.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from queue import SimpleQueue

import msgspec

from ledger import snapshot
from ledger.disk import Disk
from ledger.errors import Conflict
from ledger.events import AnyEvent, OrderCreated
from ledger.evolve import fold
from ledger.ids import CommandId, OrderId, SceneId
from ledger.scan import read_folder
from ledger.state import Fleet, StepTask
from ledger.store import FileLedger

RESULTS = Path(__file__).parent / "results" / "append.json"
RAW_BYTES = 700  # about what one commit of one event writes
CLIENTS = (1, 8, 64, 512)
QUEUE_MAX = 20_000  # events on their way in the throughput run


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the table."""

    what: str
    per_s: float
    p50_ms: float | None = None
    p99_ms: float | None = None
    raw_per_s: float | None = None  # of the control with as many, just before and after


def order(position: int) -> OrderCreated:
    """A two-step order as clients send them."""
    return OrderCreated(
        position=position,
        at_ms=1_790_000_000_000 + position,
        scene=SceneId("5f0c1e9a2b3c4d5e6f708192"),
        by="wms",
        command=CommandId(f"c-{position:012}"),
        order=OrderId(f"TO20260922-{position:06}"),
        external_id=f"wms-{position}",
        priority=position % 10,
        container=f"C{position % 997}",
        sealed=True,
        tasks=(
            StepTask(location="B-01-17", arguments='{"binTask": "load"}', loads=True),
            StepTask(location="B-09-03", arguments='{"binTask": "unload"}', unloads=True),
        ),
    )


def percentile(values: list[float], q: float) -> float:
    """Nearest rank of unsorted values."""
    return sorted(values)[min(len(values) - 1, int(q * len(values)))]


def raw(folder: Path, seconds: float, clients: int = 1) -> list[float]:
    """Seconds of each write + fdatasync to one growing file, of what so many clients wait for."""
    fd = os.open(folder / "raw", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    payload, taken = b"x" * (RAW_BYTES * clients), []
    end = time.perf_counter() + seconds
    try:
        while (start := time.perf_counter()) < end:
            os.write(fd, payload)
            os.fdatasync(fd)
            taken.append(time.perf_counter() - start)
    finally:
        os.close(fd)
    return taken


def acknowledged(folder: Path, clients: int, seconds: float) -> tuple[float, list[float]]:
    """Closed loop: each client appends one order and waits until it is on disk.

    As in the server one thread decides for all of them, and wakes the committer when it has.
    """
    ledger = FileLedger.open(folder)
    commits: SimpleQueue[Sequence[AnyEvent]] = SimpleQueue()
    wakes: list[Callable[[], None]] = []
    ledger.listen(commits.put)
    ledger.rouse_by(wakes.append)
    begun: dict[int, float] = {}
    waits: list[float] = []
    start = time.perf_counter()
    sending = clients
    while sending or begun:
        for _ in range(sending):
            begun[ledger.position + 1] = time.perf_counter()
            ledger.append((order(ledger.position + 1),), ledger.position)
        while wakes:
            wakes.pop()()
        commit = commits.get(timeout=60)
        now = time.perf_counter()
        waits += [now - begun.pop(event.position) for event in commit]
        sending = len(commit) if now < start + seconds else 0
    took = time.perf_counter() - start
    ledger.close()
    return len(waits) / took, waits


def rounds(root: Path, seconds: float) -> Iterator[Row]:
    """Control, clients, control; the control of many clients writes all that they wait for."""
    for clients in CLIENTS:
        control = raw(root, seconds / 2, clients)
        rate, waits = acknowledged(root / f"ledger-{clients}", clients, seconds)
        control += raw(root, seconds / 2, clients)
        raw_per_s = clients * len(control) / sum(control)
        yield Row(
            what=f"raw write + fdatasync, {clients} at once",
            per_s=raw_per_s,
            p50_ms=percentile(control, 0.5) * 1e3,
            p99_ms=percentile(control, 0.99) * 1e3,
        )
        yield Row(
            what=f"acknowledged appends, {clients} waiting",
            per_s=rate,
            p50_ms=percentile(waits, 0.5) * 1e3,
            p99_ms=percentile(waits, 0.99) * 1e3,
            raw_per_s=raw_per_s,
        )


class NoSync(Disk):
    """Leaves out the sync, so that what remains is our own work."""

    def sync(self, fd: int) -> None:
        """Do nothing."""


def throughput(folder: Path, events: list[AnyEvent], disk: Disk, size: int) -> float:
    """Events a second, `size` to a command, with no client waiting for its own."""
    ledger = FileLedger.open(folder, disk=disk)
    start = time.perf_counter()
    for n in range(0, len(events), size):
        ledger.append(events[n : n + size], n)
        if ledger.position - ledger.durable > QUEUE_MAX:
            ledger.wait(ledger.position - QUEUE_MAX // 2, 60)
    ledger.wait(len(events), 60)
    took = time.perf_counter() - start
    ledger.close()
    return len(events) / took


def timed(what: str, count: int, run: Callable[[], object]) -> Row:
    """Rate of something done `count` times by one call: best of three."""
    best = min(_seconds(run) for _ in range(3))
    return Row(what=what, per_s=count / best)


def _seconds(run: Callable[[], object]) -> float:
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def cpu(root: Path, count: int) -> Iterator[Row]:
    """What one core does, without waiting for a disk."""
    events: list[AnyEvent] = [order(n) for n in range(1, count + 1)]
    for size in (1, 8):
        rates = [throughput(root / f"cpu-{size}-{n}", events, NoSync(), size) for n in range(3)]
        yield Row(what=f"append + encode + write, {size} a command, no sync", per_s=max(rates))
    folder = root / "cpu-1-0"
    yield timed("read, every CRC checked", count, lambda: sum(1 for _ in read_folder(folder)))
    yield timed("fold from the files", count, lambda: fold(Fleet(), read_folder(folder)))
    fleet = fold(Fleet(), events[:10_000])
    yield timed("snapshots of 10 000 live orders", 1, lambda: snapshot.to_bytes(fleet))


def conflicts_are_refused(root: Path) -> None:
    """One look that what was measured is a ledger: a stale append is refused."""
    ledger = FileLedger.open(root / "stale")
    ledger.append((order(1),), 0)
    try:
        ledger.append((order(1),), 0)
    except Conflict:
        return
    finally:
        ledger.close()
    sys.exit("a stale append was accepted: these figures mean nothing")


def table(rows: list[Row]) -> str:
    """The rows for people."""

    def cell(value: float | None, form: str) -> str:
        return "" if value is None else format(value, form)

    lines = [f"{'':48}{'per s':>12}{'p50 ms':>9}{'p99 ms':>9}{'raw per s':>11}"]
    lines += [
        f"{row.what:48}{row.per_s:12,.0f}{cell(row.p50_ms, '9.2f'):>9}"
        f"{cell(row.p99_ms, '9.2f'):>9}{cell(row.raw_per_s, '11,.0f'):>11}"
        for row in rows
    ]
    return "\n".join(lines)


def main() -> None:
    """Run everything, print the table, keep the figures."""
    parser = argparse.ArgumentParser(prog="python -m bench.append", description=__doc__)
    parser.add_argument("--seconds", type=float, default=3.0, help="length of each round")
    parser.add_argument("--events", type=int, default=100_000, help="events of the CPU rounds")
    parser.add_argument("--data", type=Path, help="folder on the disk to measure [temporary]")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=arguments.data) as name:
        root = Path(name)
        conflicts_are_refused(root)
        rows = [*rounds(root, arguments.seconds), *cpu(root, arguments.events)]
    print(table(rows))
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_text(json.dumps(msgspec.to_builtins(rows), indent=1) + "\n")


if __name__ == "__main__":
    main()
