"""What sealing costs and saves: `python -m bench.seal`.

Rounds of acknowledged appends without and with a sealer at work stand next to each other, for the
latency of a virtual disk's sync changes from minute to minute.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from bench.append import order, percentile, raw
from bench.read import events
from ledger.codec import encode
from ledger.disk import Disk
from ledger.events import AnyEvent
from ledger.evolve import fold
from ledger.scan import read_folder
from ledger.seal import seal, unsealed
from ledger.segment import SEGMENT_BYTES_MAX
from ledger.state import Fleet
from ledger.store import FileLedger
from tests.histories import happenings

Row = dict[str, float | str]

CLIENTS = 8
ROUNDS = 4  # each without and with
COMMAND_EVENTS = 4  # of one decision, about
LIVES = 60_000  # orders whose lives fill more than one segment


def written(folder: Path, known: list[AnyEvent]) -> Path:
    """A ledger of these events in small commits, as clients make them; gives its folder."""
    ledger = FileLedger.open(folder)
    for at in range(0, len(known), COMMAND_EVENTS):
        ledger.append(known[at : at + COMMAND_EVENTS], at)
        if ledger.position - ledger.durable > 20_000:
            ledger.wait(ledger.position - 10_000, 60)
    ledger.close()
    return folder


def size_of(folder: Path) -> int:
    """Bytes of all segments."""
    return sum(path.stat().st_size for path in folder.glob("*.mcap"))


def sizes(root: Path) -> Iterator[Row]:
    """Bytes an event, live and sealed, and how long sealing takes."""
    sources = {
        "finished orders": events(LIVES, 0),
        "generated history": list(islice(happenings(1), 60_000)),
    }
    for what, known in sources.items():
        folder = written(root / what.replace(" ", "-"), known)
        live = size_of(folder)
        began, cpu = time.perf_counter(), time.process_time()
        for path in sorted(folder.glob("*.mcap")):
            seal(Disk(), path)
        took_s, cpu_s = time.perf_counter() - began, time.process_time() - cpu
        yield {
            "what": f"sealing {what}",
            "events": float(len(known)),
            "json_bytes_per_event": sum(len(encode(e)) for e in known) / len(known),
            "live_bytes_per_event": live / len(known),
            "sealed_bytes_per_event": size_of(folder) / len(known),
            "s_per_64_mb": took_s * SEGMENT_BYTES_MAX / live,
            "cpu_s_per_64_mb": cpu_s * SEGMENT_BYTES_MAX / live,
        }
        yield from reading(folder, what, len(known))


def reading(folder: Path, what: str, count: int) -> Iterator[Row]:
    """How fast sealed segments are checked at start, verified, read and folded."""
    forget(folder)
    began = time.perf_counter()
    FileLedger.open(folder).close()
    opened_s = time.perf_counter() - began
    began = time.perf_counter()
    assert sum(1 for _ in read_folder(folder)) == count
    read_s = time.perf_counter() - began
    began = time.perf_counter()
    fold(Fleet(), read_folder(folder))
    folded_s = time.perf_counter() - began
    ledger = FileLedger.open(folder)
    pages = []
    for after in range(0, count - 50, max(1, count // 200)):
        began = time.perf_counter()
        assert sum(1 for _ in ledger.read(after, after + 50)) == 50
        pages.append(time.perf_counter() - began)
    ledger.close()
    yield {
        "what": f"reading sealed {what}",
        "check_at_start_mb_per_s": size_of(folder) / 1e6 / opened_s,
        "read_events_per_s": count / read_s,
        "fold_events_per_s": count / folded_s,
        "50_events_anywhere_p50_ms": percentile(pages, 0.5) * 1e3,
        "50_events_anywhere_p99_ms": percentile(pages, 0.99) * 1e3,
    }


def forget(folder: Path) -> None:
    """Have the system forget the files, so that they come from the disk."""
    for path in folder.glob("*.mcap"):
        Disk().settle(path)


def waits(folder: Path, seconds: float) -> list[float]:
    """Closed loop of clients, each waiting for its order; their waits in seconds."""
    ledger = FileLedger.open(folder)
    taken: list[float] = []
    turn = threading.Lock()
    end = time.perf_counter() + seconds

    def client() -> None:
        while (began := time.perf_counter()) < end:
            with turn:
                position = ledger.append((order(ledger.position + 1),), ledger.position)
            ledger.wait(position, 60)
            taken.append(time.perf_counter() - began)

    threads = [threading.Thread(target=client) for _ in range(CLIENTS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    ledger.close()
    return taken


class Busy:
    """Sealers one after the other on copies of a full segment, as long as the round lasts."""

    def __init__(self, root: Path, full: Path) -> None:
        self._root, self._full = root, full
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.sealed = 0

    def __enter__(self) -> "Busy":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.is_set():
            data = self._root / f"busy-{self.sealed}"
            shutil.copytree(self._full, data / "ledger", copy_function=os.link)
            before = len(unsealed(data / "ledger"))
            arguments = ["-m", "fleetledger", "role", "sealer", "--data", str(data)]
            with subprocess.Popen(
                [sys.executable, *arguments], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL
            ) as child:
                while child.poll() is None:
                    if self._stop.wait(0.05):
                        child.terminate()
                        break
            self.sealed += before - len(unsealed(data / "ledger"))
            shutil.rmtree(data)


def stalls(root: Path, seconds: float) -> Iterator[Row]:
    """Waits of clients without and with a sealer beside them, round by round."""
    full = written(root / "full", events(LIVES, 0))
    quiet: list[float] = []
    beside: list[float] = []
    control: list[float] = []
    sealed = 0
    for number in range(ROUNDS):
        control += raw(root, seconds / 4)
        quiet += waits(root / f"quiet-{number}", seconds)
        with Busy(root, full) as busy:
            beside += waits(root / f"beside-{number}", seconds)
        sealed += busy.sealed
    for what, taken in (("without", quiet), ("with", beside)):
        yield {
            "what": f"acknowledged, {CLIENTS} waiting, {what} a sealer",
            "per_s": len(taken) / (ROUNDS * seconds),
            "p50_ms": percentile(taken, 0.5) * 1e3,
            "p99_ms": percentile(taken, 0.99) * 1e3,
            "raw_p50_ms": percentile(control, 0.5) * 1e3,
            "raw_p99_ms": percentile(control, 0.99) * 1e3,
            "segments_sealed": float(sealed if what == "with" else 0),
        }
    ratio = percentile(beside, 0.99) / percentile(quiet, 0.99)
    yield {"what": "p99 with a sealer / without", "ratio": ratio}


def main() -> list[Row]:
    """Run all, telling as it goes."""
    parser = argparse.ArgumentParser(prog="python -m bench.seal", description=__doc__)
    parser.add_argument("--seconds", type=float, default=6.0, help="length of each round")
    parser.add_argument("--data", type=Path, help="folder on the disk to measure [temporary]")
    arguments = parser.parse_args()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(dir=arguments.data) as name:
        for part in (sizes(Path(name)), stalls(Path(name), arguments.seconds)):
            for row in part:
                rows.append(row)
                words = (f"{k} {v:,.2f}" if isinstance(v, float) else v for k, v in row.items())
                print(", ".join(words), flush=True)
    return rows


if __name__ == "__main__":
    main()
