"""How long a server needs after a crash, by what it finds: `python -m bench.startup --events N`.

A ledger of so many events is written (its syncs left out, for this is not about them), with a torn
tail as a crash leaves it. Then `fleetledger serve` is started again and again, each time after a
kill -9: with and without snapshots, with and without `history.duckdb`, with segments as they were
written and sealed. What counts is the time from the start of the process to the line `ready`, the
import of the program included; CPU time and memory are those of the core by then. Beside it: how
fast events are folded, how long a past moment takes, what an event costs on disk.

With `--data` the folder is kept, and used again as it is: then the writing is spared.
"""

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import msgspec

from bench.append import NoSync
from bench.ledgers import START_MS, write
from ledger.disk import Disk
from ledger.evolve import fold
from ledger.lock import Lock
from ledger.moment import At
from ledger.scan import read_folder
from ledger.seal import LOCK_NAME, seal_folder
from ledger.state import Fleet
from replay.moment import Moments

EVENTS = 1_000_000
MOMENTS = 20
REBUILD_S_MAX = 900.0
RESULTS = Path(__file__).parent / "results" / "startup.json"

Row: TypeAlias = dict[str, float | str]


class Server:
    """`fleetledger serve` on a folder, from its start to its kill -9."""

    def __init__(self, data: Path) -> None:
        command = [sys.executable, "-m", "fleetledger", "serve", "--data", str(data)]
        self._log = (data.parent / "log").open("a")
        began_s = time.perf_counter()
        self._process = subprocess.Popen(
            [*command, "--port", "0", "--auth", "none"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        self.ready_s = time.perf_counter() - began_s
        if not line.startswith("ready "):
            raise RuntimeError(f"the server did not start, see {data.parent / 'log'}")
        self._url = line.split()[1]
        status = Path(f"/proc/{self._process.pid}/status").read_text()
        found = re.search(r"VmHWM:\s+(\d+) kB", status)
        assert found is not None
        self.peak_mb = int(found[1]) / 1000
        stat = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        self.cpu_s = (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")

    def _figure(self, name: str) -> float:
        with urllib.request.urlopen(f"{self._url}/metrics") as answer:
            found = re.search(rf"^{name} (\S+)$", answer.read().decode(), re.MULTILINE)
        return float(found[1]) if found else 0.0

    def wait_for_history(self, position: int) -> float:
        """Wait until DuckDB has so much; gives the seconds since ready."""
        began_s = time.monotonic()
        while self._figure("fleetledger_history_position") < position:
            if time.monotonic() - began_s > REBUILD_S_MAX:
                raise RuntimeError("history was not rebuilt")
            time.sleep(0.2)  # the server tells how far it is only when asked
        return time.monotonic() - began_s

    def kill(self) -> None:
        """End it as a crash does; its children see their input close."""
        self._process.kill()
        self._process.wait()
        self._log.close()


class Site:
    """The folder of the ledger, and what beside it is put away for a while."""

    def __init__(self, root: Path) -> None:
        self.data = root / "data"
        self.ledger, self.snapshots = self.data / "ledger", self.data / "snapshots"
        self.history = self.data / "history.duckdb"
        self._aside = root / "aside"

    def without(self, *paths: Path) -> Callable[[], None]:
        """Put files and folders away; the returned function brings back what is not made anew."""
        self._aside.mkdir(exist_ok=True)
        away = [(path, self._aside / path.name) for path in paths if path.exists()]
        for path, kept in away:
            path.rename(kept)

        def back() -> None:
            for path, kept in away:
                if path.is_dir():
                    shutil.rmtree(path)
                path.with_name(path.name + ".wal").unlink(missing_ok=True)
                path.unlink(missing_ok=True)
                kept.rename(path)

        return back

    def size_bytes(self) -> int:
        """Size of all segments."""
        return sum(path.stat().st_size for path in self.ledger.glob("*.mcap"))


def tear(ledger: Path) -> None:
    """Leave half a chunk at the end of the newest segment."""
    newest = max(ledger.glob("*.mcap"))
    with newest.open("ab") as file:
        file.write(b"\x06" + (1000).to_bytes(8, "little") + b"torn" * 100)


def starts(site: Site, how: str) -> Iterator[Row]:
    """Start in every way, and kill each time."""
    cases: list[tuple[str, tuple[Path, ...]]] = [
        ("with snapshots and history", ()),
        ("with snapshots, no history", (site.history,)),
        ("no snapshots, with history", (site.snapshots,)),
        ("no snapshots, no history", (site.snapshots, site.history)),
    ]
    for what, gone in cases:
        back = site.without(*gone)
        tear(site.ledger)
        server = Server(site.data)
        server.kill()
        back()
        yield {
            "what": f"ready after a crash, {how}, {what}",
            "ready_s": server.ready_s,
            "cpu_s": server.cpu_s,
            "peak_mb": server.peak_mb,
        }


def folds(site: Site, how: str, events: int) -> Iterator[Row]:
    """Read and fold everything, and go to random moments."""
    began_s = time.perf_counter()
    fold(Fleet(), read_folder(site.ledger))
    yield {
        "what": f"folded from the first event, {how}",
        "events_per_s": events / (time.perf_counter() - began_s),
        "bytes_per_event": site.size_bytes() / events,
    }
    chance = random.Random(1)
    took = []
    for _ in range(MOMENTS):
        at_ms = START_MS + chance.randrange(events) * 10
        began_s = time.perf_counter()
        Moments(site.data).fleet(At(at_ms=at_ms))
        took.append((time.perf_counter() - began_s) * 1e3)
    yield {
        "what": f"state at a moment, {how}, with snapshots",
        "median_ms": sorted(took)[MOMENTS // 2],
        "worst_ms": max(took),
    }


def rows(site: Site, events: int) -> Iterator[Row]:
    """Write if there is nothing yet, then measure as written and sealed."""
    if not site.ledger.exists():
        began_s = time.perf_counter()
        write(site.data, events, NoSync())
        took_s = time.perf_counter() - began_s
        yield {"what": "written, with snapshots, no sync", "events_per_s": events / took_s}
    lock = Lock(site.ledger, LOCK_NAME)  # the server's sealer has to wait
    try:
        if not site.history.exists():
            tear(site.ledger)
            server = Server(site.data)
            rebuilt_s = server.wait_for_history(events)
            server.kill()
            yield {
                "what": "history rebuilt while serving",
                "rebuilt_s": rebuilt_s,
                "events_per_s": events / rebuilt_s,
            }
        yield from folds(site, "as written", events)
        yield from starts(site, "as written")
    finally:
        lock.close()
    began_s = time.perf_counter()
    done = list(seal_folder(Disk(), site.ledger))
    if done:
        count = sum(each.events for each in done)
        yield {
            "what": "sealed",
            "events_per_s": count / (time.perf_counter() - began_s),
            "bytes_per_event": sum(each.bytes_after for each in done) / count,
        }
    yield from folds(site, "sealed", events)
    yield from starts(site, "sealed")


def main() -> None:
    """Run all, print a table, and keep the rows of this size beside those of others."""
    parser = argparse.ArgumentParser(prog="python -m bench.startup", description=__doc__)
    parser.add_argument("--events", type=int, default=EVENTS)
    parser.add_argument("--data", type=Path, help="folder to keep, and to use again [temporary]")
    arguments = parser.parse_args()
    folder = arguments.data or Path(tempfile.mkdtemp(prefix="fleetledger-bench-"))
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    try:
        for row in rows(Site(folder), arguments.events):
            figures = ", ".join(f"{k} {v:,.1f}" for k, v in row.items() if isinstance(v, float))
            print(f"{arguments.events:>12,} events  {row['what']:<62} {figures}", flush=True)
            found.append({"events": arguments.events, **row})
    finally:
        if arguments.data is None:
            shutil.rmtree(folder)
    known = json.loads(RESULTS.read_bytes()) if RESULTS.exists() else []
    found += [row for row in known if row["events"] != arguments.events]
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_bytes(msgspec.json.format(msgspec.json.encode(found)) + b"\n")


if __name__ == "__main__":
    main()
