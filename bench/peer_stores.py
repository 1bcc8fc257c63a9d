"""Event stores that `bench.peers` compares: ours, SQLite in three ways, PostgreSQL.

Every one keeps the same events, each in a stream with a version that is unique, and says yes only
when it is on disk. Each is driven as somebody would who knows it well.
"""

import asyncio
import queue
import sqlite3
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple, Protocol
from uuid import UUID

import msgspec
from eventsourcing.persistence import StoredEvent
from eventsourcing.sqlite import SQLiteApplicationRecorder, SQLiteDatastore

from bench.append import order
from fleetledger.durability import Durability
from ledger.codec import Decoder, encode
from ledger.disk import Disk
from ledger.events import AnyEvent
from ledger.scan import read_folder
from ledger.seal import seal_folder
from ledger.store import FileLedger

BATCH_MAX = 512  # of one transaction of the writer that commits for all
FILL = 64  # events of a commit where a store is filled
SEGMENT_BYTES_MAX = 16 * 1024 * 1024  # of ours, so that some are finished and can be sealed
LOCK_S_MAX = 60.0
PAGE = 10_000  # events of a read
ORDERS = [order(n) for n in range(1, 1001)]
PAYLOADS = [encode(each) for each in ORDERS]
SQLITE = (
    "PRAGMA journal_mode=WAL",
    "PRAGMA synchronous=FULL",
    "CREATE TABLE IF NOT EXISTS events (position INTEGER PRIMARY KEY, stream TEXT NOT NULL,"
    " version INTEGER NOT NULL, payload BLOB NOT NULL, UNIQUE (stream, version))",
)
INSERT = "INSERT INTO events (stream, version, payload) VALUES (?, ?, ?)"

decode = Decoder().decode


class Ran(NamedTuple):
    """What clients saw."""

    waits_s: list[float]  # of each event
    took_s: float  # all of them, without their connecting


class Store(Protocol):
    """One way to keep events."""

    name: str

    def run(self, clients: int, seconds: float) -> Ran:
        """Let clients append one event after the other."""

    def fill(self, count: int) -> None:
        """Append so many events, 64 a commit."""

    def read(self) -> int:
        """Read all back, decoded; give how many there were."""

    def size_bytes(self) -> int:
        """Tell what it takes on disk, once it has settled."""

    def sealed_bytes_per_event(self) -> float | None:
        """Close, and put away as the past is kept, if the store does that."""

    def close(self) -> None:
        """Let it go."""


def row(number: int) -> tuple[str, int, bytes]:
    """Stream, version and payload of an event."""
    return f"TO20260922-{number:09}", 1, PAYLOADS[number % len(PAYLOADS)]


def at_position(position: int) -> AnyEvent:
    """Give an order as the next event of a ledger."""
    return msgspec.structs.replace(ORDERS[position % len(ORDERS)], position=position)


def in_threads(clients: int, seconds: float, once: Callable[[int], int]) -> Ran:
    """Closed loop in threads; `once` is told which client, and gives how many events it stored."""
    waits: list[float] = []
    began = time.perf_counter()
    end = began + seconds

    def client(number: int) -> None:
        while (start := time.perf_counter()) < end:
            stored = once(number)
            waits.extend([time.perf_counter() - start] * stored)

    threads = [threading.Thread(target=client, args=(n,)) for n in range(clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return Ran(waits, time.perf_counter() - began)


class Ours:
    """The ledger, and durability as the server has it: clients wait on an event loop."""

    def __init__(self, folder: Path) -> None:
        self.name = "fleetledger"
        self._folder = folder
        self._ledger = FileLedger.open(folder, segment_bytes_max=SEGMENT_BYTES_MAX)
        self._durability: Durability | None = None
        self._ledger.listen(self._heard)

    def _heard(self, events: Sequence[AnyEvent]) -> None:
        if self._durability is not None:
            self._durability.heard(events)

    def run(self, clients: int, seconds: float) -> Ran:
        """Append, and wait until it is known to be on disk."""
        waits: list[float] = []
        ledger = self._ledger

        async def client(durability: Durability, end: float) -> None:
            while (start := time.perf_counter()) < end:
                at = ledger.position
                await durability.reached(ledger.append((at_position(at + 1),), at))
                waits.append(time.perf_counter() - start)

        async def all_clients() -> None:
            loop = asyncio.get_running_loop()
            self._durability = durability = Durability(loop, ledger.durable, lambda events: None)
            end = time.perf_counter() + seconds
            await asyncio.gather(*(client(durability, end) for _ in range(clients)))
            self._durability = None

        began = time.perf_counter()
        asyncio.run(all_clients())
        return Ran(waits, time.perf_counter() - began)

    def fill(self, count: int) -> None:
        """Append in commits of many."""
        for first in range(0, count, FILL):
            at = self._ledger.position
            many = min(FILL, count - first)
            self._ledger.append([at_position(at + n) for n in range(1, many + 1)], at)
            self._ledger.wait(at + many, 60)

    def read(self) -> int:
        """Read by the ledger's own scan, every checksum checked."""
        return sum(1 for _ in read_folder(self._folder))

    def size_bytes(self) -> int:
        """Tell the size of the segments."""
        return sum(path.stat().st_size for path in self._folder.glob("*.mcap"))

    def sealed_bytes_per_event(self) -> float | None:
        """Close, and seal the segments that are finished."""
        self._ledger.close()
        done = list(seal_folder(Disk(), self._folder))
        events = sum(each.events for each in done)
        return sum(each.bytes_after for each in done) / events if events else None

    def close(self) -> None:
        """Close the ledger."""
        self._ledger.close()


class SqliteEach:
    """Plain SQLite as it is mostly used: a connection each, a transaction each."""

    def __init__(self, folder: Path) -> None:
        self.name = "SQLite, a connection each"
        self.path = folder / "events.sqlite"
        self._numbers = iter(range(1, 1 << 62))
        with closing(self.connect()) as connection:
            for statement in SQLITE:
                connection.execute(statement)

    def connect(self) -> sqlite3.Connection:
        """Open one more."""
        connection = sqlite3.connect(
            self.path, timeout=LOCK_S_MAX, isolation_level=None, check_same_thread=False
        )
        connection.execute(SQLITE[1])
        return connection

    def next_row(self) -> tuple[str, int, bytes]:
        """Give an event that is new."""
        return row(next(self._numbers))

    def run(self, clients: int, seconds: float) -> Ran:
        """Fight for the lock."""
        connections = [self.connect() for _ in range(clients)]

        def once(client: int) -> int:
            connections[client].execute(INSERT, self.next_row())
            return 1

        try:
            return in_threads(clients, seconds, once)
        finally:
            for connection in connections:
                connection.close()

    def fill(self, count: int) -> None:
        """Append in transactions of many."""
        with closing(self.connect()) as connection:
            for first in range(0, count, FILL):
                connection.execute("BEGIN IMMEDIATE")
                rows = [self.next_row() for _ in range(min(FILL, count - first))]
                connection.executemany(INSERT, rows)
                connection.execute("COMMIT")

    def read(self) -> int:
        """Read in order of position."""
        with closing(self.connect()) as connection:
            rows = connection.execute("SELECT payload FROM events ORDER BY position")
            return sum(decode(payload) is not None for (payload,) in rows)

    def size_bytes(self) -> int:
        """Tell the size of the file, the log written back."""
        with closing(self.connect()) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        return self.path.stat().st_size

    def sealed_bytes_per_event(self) -> float | None:
        """Nothing of the kind."""
        return None

    def close(self) -> None:
        """Nothing is held."""


class SqliteWriter(SqliteEach):
    """Plain SQLite as an expert would: one writer that commits what waits, clients on a loop."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.name = "SQLite, one writer, group commit"

    def run(self, clients: int, seconds: float) -> Ran:
        """Queue, and wait for the writer."""
        waits: list[float] = []
        waiting: queue.SimpleQueue[asyncio.Future[None] | None] = queue.SimpleQueue()

        async def client(end: float) -> None:
            loop = asyncio.get_running_loop()
            while (start := time.perf_counter()) < end:
                stored = loop.create_future()
                waiting.put(stored)
                await stored
                waits.append(time.perf_counter() - start)

        async def all_clients() -> None:
            writer = threading.Thread(
                target=self._write, args=(asyncio.get_running_loop(), waiting)
            )
            writer.start()
            end = time.perf_counter() + seconds
            await asyncio.gather(*(client(end) for _ in range(clients)))
            waiting.put(None)
            await asyncio.to_thread(writer.join)

        began = time.perf_counter()
        asyncio.run(all_clients())
        return Ran(waits, time.perf_counter() - began)

    def _write(
        self,
        loop: asyncio.AbstractEventLoop,
        waiting: "queue.SimpleQueue[asyncio.Future[None] | None]",
    ) -> None:
        with closing(self.connect()) as connection:
            while (first := waiting.get()) is not None:
                batch = [first]
                while len(batch) < BATCH_MAX and not waiting.empty():
                    more = waiting.get()
                    assert more is not None
                    batch.append(more)
                connection.execute("BEGIN IMMEDIATE")
                connection.executemany(INSERT, [self.next_row() for _ in batch])
                connection.execute("COMMIT")
                loop.call_soon_threadsafe(_wake, batch)


def _wake(batch: list["asyncio.Future[None]"]) -> None:
    for stored in batch:
        stored.set_result(None)


class EventSourcing:
    """The library's recorder on a file: WAL, synchronous FULL (SQLite's default)."""

    def __init__(self, folder: Path, *, batched: bool) -> None:
        self.name = "eventsourcing, " + ("clients' events a save" if batched else "one a save")
        self._batched = batched
        self._path = folder / "events.sqlite"
        self._store = SQLiteDatastore(
            str(self._path), lock_timeout=int(LOCK_S_MAX), pool_timeout=LOCK_S_MAX
        )
        self._recorder = SQLiteApplicationRecorder(self._store)
        self._recorder.create_table()
        self._numbers = iter(range(1, 1 << 62))

    def _events(self, count: int) -> list[StoredEvent]:
        numbers = (next(self._numbers) for _ in range(count))
        return [StoredEvent(UUID(int=n), 1, "event", row(n)[2]) for n in numbers]

    def run(self, clients: int, seconds: float) -> Ran:
        """Save one event for each client, or at best all that wait at once."""
        size, threads = (clients, 1) if self._batched else (1, clients)

        def once(_: int) -> int:
            self._recorder.insert_events(self._events(size))
            return size

        return in_threads(threads, seconds, once)

    def fill(self, count: int) -> None:
        """Save many at a time."""
        for first in range(0, count, FILL):
            self._recorder.insert_events(self._events(min(FILL, count - first)))

    def read(self) -> int:
        """Read the notification log, and decode as the others do."""
        read, after = 0, 0
        while found := self._recorder.select_notifications(after + 1, PAGE):
            read += sum(decode(each.state) is not None for each in found)
            after = found[-1].id
        return read

    def size_bytes(self) -> int:
        """Tell the size of the file, the log written back."""
        with closing(sqlite3.connect(self._path)) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        return self._path.stat().st_size

    def sealed_bytes_per_event(self) -> float | None:
        """Nothing of the kind."""
        return None

    def close(self) -> None:
        """Close the pool."""
        self._store.close()
