"""Our ledger beside other event stores, on this disk in this hour: `python -m bench.peers`.

The same events (orders of about 625 bytes as JSON), the same number of clients that each wait for
the yes before they send the next, the same promise: yes means synced. Rounds of all stores are
interleaved, and each run stands between two of a raw write + fdatasync, for a virtual disk changes
by a factor of ten from minute to minute. What is said is the median over the rounds.

*What the raw control allows* is clients per sync times syncs a second: all who wait share one sync.

What is not comparable: PostgreSQL is a server of its own and pays for sockets, its client, 512
threads of Python here, more than it does; it and SQLite keep indexes that we keep elsewhere. Ours
encodes its events and checks positions, the others get ready bytes. `eventsourcing` is measured at
its recorder, without the work of its aggregates; its batch is its best case: one save of as many
events as clients wait, which its users would have to collect themselves.
"""

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from bench.append import percentile, raw

if TYPE_CHECKING:
    from bench.peer_stores import Store

RESULTS = Path(__file__).parent / "results" / "peers.json"
NEEDED = ("eventsourcing", "psycopg")
CLIENTS = (1, 8, 64, 512)
ROUNDS = 3
RAW_S = 0.25  # of the control before and after each run
RAW = "raw write + fdatasync, shared by all who wait"
FILLED = 100_000  # events by which size and reading are measured


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """One store, once."""

    per_s: float
    p50_ms: float
    p99_ms: float
    raw_per_s: float  # syncs a second just before and after


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the first table."""

    what: str
    clients: int
    per_s: float
    p50_ms: float
    p99_ms: float
    raw_per_s: float
    of_raw_percent: float  # of what the raw control allows


class Kept(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the second table."""

    what: str
    bytes_per_event: float
    read_per_s: float
    sealed_bytes_per_event: float | None = None


def measured(store: "Store", clients: int, seconds: float, root: Path) -> Run:
    """Run a store between two controls."""
    control = raw(root, RAW_S)
    waits, took_s = store.run(clients, seconds)
    control += raw(root, RAW_S)
    (root / "raw").unlink()
    return Run(
        per_s=len(waits) / took_s,
        p50_ms=percentile(waits, 0.5) * 1e3,
        p99_ms=percentile(waits, 0.99) * 1e3,
        raw_per_s=len(control) / sum(control),
    )


def line(what: str, clients: int, runs: Sequence[Run]) -> Row:
    """Take the median of the rounds, each beside its own control."""

    def median(of: str) -> float:
        found: float = statistics.median(getattr(run, of) for run in runs)
        return found

    share = statistics.median(run.per_s / (run.raw_per_s * clients) for run in runs)
    return Row(
        what=what,
        clients=clients,
        per_s=median("per_s"),
        p50_ms=median("p50_ms"),
        p99_ms=median("p99_ms"),
        raw_per_s=median("raw_per_s"),
        of_raw_percent=share * 100,
    )


def appended(made: Sequence["Store"], seconds: float, root: Path) -> list[Row]:
    """Go round all stores, for each number of clients."""
    rows = []
    for clients in CLIENTS:
        runs: dict[str, list[Run]] = {store.name: [] for store in made}
        for store in made:  # warm
            store.run(clients, seconds / 4)
        for _ in range(ROUNDS):
            for store in made:
                runs[store.name].append(measured(store, clients, seconds, root))
        controls = [run.raw_per_s for each in runs.values() for run in each]
        syncs = statistics.median(controls)
        wait_ms = 1e3 / syncs
        bound = Run(per_s=syncs * clients, p50_ms=wait_ms, p99_ms=wait_ms, raw_per_s=syncs)
        found = [line(RAW, clients, [bound])]
        found += [line(name, clients, each) for name, each in runs.items()]
        for row in found:
            print(
                f"{row.what:46}{row.clients:8}{row.per_s:12,.0f}{row.p50_ms:10.2f}{row.p99_ms:10.2f}"
                f"{row.raw_per_s:11,.0f}{row.of_raw_percent:10.1f}",
                flush=True,
            )
        rows += found
    return rows


def kept(store: "Store", count: int) -> Kept:
    """Fill a fresh store; tell what an event takes, and how fast all are read back."""
    store.fill(count)
    size = store.size_bytes()
    began_s = time.perf_counter()
    if store.read() != count:
        sys.exit(f"{store.name} did not give back what it took: these figures mean nothing")
    took_s = time.perf_counter() - began_s
    sealed = store.sealed_bytes_per_event()
    row = Kept(
        what=store.name,
        bytes_per_event=size / count,
        read_per_s=count / took_s,
        sealed_bytes_per_event=sealed,
    )
    more = "" if sealed is None else f"   sealed {sealed:,.0f}"
    print(f"{row.what:46}{row.bytes_per_event:14,.0f}{row.read_per_s:14,.0f}{more}", flush=True)
    return row


def stores(root: Path) -> Iterator[Callable[[], "Store"]]:
    """Give what makes each; what is not installed is left out, with a word."""
    # only now, for they import what may be missing
    from bench.peer_postgres import POSTGRES, Postgres
    from bench.peer_stores import EventSourcing, Ours, SqliteEach, SqliteWriter

    def folder(name: str) -> Path:
        path = root / name
        path.mkdir()
        return path

    yield lambda: Ours(folder("ours"))
    yield lambda: EventSourcing(folder("eventsourcing"), batched=False)
    yield lambda: EventSourcing(folder("eventsourcing-batched"), batched=True)
    yield lambda: SqliteEach(folder("sqlite"))
    yield lambda: SqliteWriter(folder("sqlite-writer"))
    if (POSTGRES / "initdb").exists():
        yield lambda: Postgres(folder("postgres"))
    else:
        print(f"PostgreSQL is left out: there is no {POSTGRES / 'initdb'}")


def main() -> None:
    """Run everything, print two tables, and keep the rows."""
    parser = argparse.ArgumentParser(prog="python -m bench.peers", description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="length of each run")
    parser.add_argument("--data", type=Path, help="folder on the disk to measure [temporary]")
    arguments = parser.parse_args()
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        print(f"skipped: not installed: {', '.join(missing)}")
        return
    sys.setswitchinterval(0.0005)  # as `serve` does: who comes back from the disk goes on at once
    rows: list[Row | Kept] = []
    with tempfile.TemporaryDirectory(dir=arguments.data, prefix="fleetledger-peers-") as name:
        root = Path(name)
        root.chmod(0o755)  # PostgreSQL runs as somebody else
        (root / "append").mkdir()
        made = [make() for make in stores(root / "append")]
        try:
            print(
                f"{'':46}{'clients':>8}{'per s':>12}{'p50 ms':>10}{'p99 ms':>10}{'syncs/s':>11}"
                f"{'% of raw':>10}"
            )
            rows += appended(made, arguments.seconds, root)
        finally:
            for store in made:
                store.close()
        print(f"\n{'':46}{'bytes/event':>14}{'read back/s':>14}")
        (root / "kept").mkdir()
        for make in stores(root / "kept"):
            store = make()
            try:
                rows.append(kept(store, FILLED))
            finally:
                store.close()
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_bytes(msgspec.json.format(msgspec.json.encode(rows)) + b"\n")


if __name__ == "__main__":
    main()
