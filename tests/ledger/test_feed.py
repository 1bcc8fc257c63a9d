import hashlib
import queue
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.bus import EVENTS_AFTER_KEY, EVENTS_KEY, STATE_KEY, Bus, Handler, MemoryBus
from ledger.codec import encode
from ledger.errors import LedgerDiverged
from ledger.events import AnyEvent
from ledger.evolve import fold
from ledger.feed import ANSWER_EVENTS, ANSWERS_MAX, READY_EVENTS_MAX, FeedFollower, FeedServer
from ledger.ids import CommandId
from ledger.snapshot import restore
from ledger.state import Fleet
from ledger.store import FileLedger, MemoryLedger
from ledger.zenoh_bus import LOOPBACK, ZenohBus
from tests.histories import history
from tests.ledger.disks import GatedDisk

EVENTS = history(51, 400)


class LossyBus(MemoryBus):
    """Loses, doubles and delays messages as it is told."""

    def __init__(self, fates: Sequence[int]) -> None:
        super().__init__()
        self._fates = iter(fates)
        self._held: list[tuple[str, bytes]] = []

    def publish(self, key: str, payload: bytes) -> None:
        fate = next(self._fates, 1)
        if fate < 0:
            self._held.append((key, payload))
            return
        for _ in range(fate):
            super().publish(key, payload)
        for held in self._held:
            super().publish(*held)
        self._held.clear()


class Core:
    """The core's side: a ledger and the state that follows it."""

    def __init__(self, bus: Bus, ledger: MemoryLedger | FileLedger) -> None:
        self.ledger = ledger
        self.fleet = Fleet()
        ledger.listen(lambda events: fold(self.fleet, events) and None)
        FeedServer(bus, ledger, lambda: self.fleet.copy())

    def happen(self, count: int) -> None:
        first = self.ledger.position
        self.ledger.append(EVENTS[first : first + count], first)


@given(
    before=st.integers(0, 30),
    sizes=st.lists(st.integers(1, 9), max_size=30),
    fates=st.lists(st.sampled_from((0, 1, 1, 2, -1)), max_size=30),
    drains=st.sets(st.integers(0, 29)),
)
def test_a_follower_gets_every_event_once_and_in_order(
    before: int, sizes: list[int], fates: list[int], drains: set[int]
) -> None:
    bus = LossyBus(fates)
    core = Core(bus, MemoryLedger(EVENTS[:before]))
    fold(core.fleet, EVENTS[:before])
    follower = FeedFollower(bus)
    fleet = follower.start()
    assert fleet == core.fleet
    got: list[AnyEvent] = []
    for n, size in enumerate(sizes):
        core.happen(size)
        if n in drains:
            got += follower.drain()
    follower.catch_up()  # the last message may be lost too
    got += follower.drain()
    assert got == EVENTS[before : core.ledger.position]
    assert fold(fleet, got).canonical() == core.fleet.canonical()


class LateBus(MemoryBus):
    """Lets things happen between a follower's subscription and the state it asks for."""

    def __init__(self) -> None:
        super().__init__()
        self.meanwhile: Callable[[], None] = lambda: None

    def subscribe(self, key: str, handler: Handler) -> None:
        super().subscribe(key, handler)
        if key == EVENTS_KEY:
            self.meanwhile()


def test_what_happens_between_subscribing_and_asking_comes_once() -> None:
    bus = LateBus()
    core = Core(bus, MemoryLedger())
    core.happen(10)
    bus.meanwhile = lambda: core.happen(5)
    follower = FeedFollower(bus)
    assert follower.start().position == 15
    assert follower.drain() == []
    core.happen(2)
    assert follower.drain() == EVENTS[15:17]


def test_a_long_absence_is_caught_up_in_several_questions() -> None:
    bus = LossyBus([0])
    kind = history(1, 3)[-1]
    count = ANSWER_EVENTS * ANSWERS_MAX * 2 + 123
    events = [type(kind)(position=n, scene=kind.scene, robot="R1") for n in range(1, count + 1)]  # type: ignore[call-arg]
    ledger = MemoryLedger()
    FeedServer(bus, ledger, Fleet)
    follower = FeedFollower(bus)
    follower.start()
    ledger.append(events, 0)
    assert follower.drain() == []
    follower.catch_up()
    first = follower.drain()
    assert READY_EVENTS_MAX <= len(first) < count
    follower.catch_up()
    assert first + follower.drain() == events


def test_a_core_that_hides_events_is_noticed() -> None:
    bus = LossyBus([0])
    core = Core(bus, MemoryLedger())
    follower = FeedFollower(bus)
    follower.start()
    bus.respond(EVENTS_AFTER_KEY, lambda question: [b'{"behind":{},"events":[]}'])
    core.happen(3)
    core.happen(3)
    with pytest.raises(LedgerDiverged, match="up to position 3, but the core ends at 0"):
        follower.drain()


def test_waiting_ends_where_nothing_comes() -> None:
    bus = MemoryBus()
    core = Core(bus, MemoryLedger())
    follower = FeedFollower(bus)
    follower.start()
    assert follower.wait(0, 0.0)
    assert not follower.wait(1, 0.01)
    core.happen(1)
    assert follower.wait(1, 0.0)


def test_a_state_ahead_of_the_disk_is_shown_when_it_is_on_disk(tmp_path: Path) -> None:
    disk = GatedDisk()
    disk.gate.set()
    ledger = FileLedger.open(tmp_path, disk=disk)
    bus = MemoryBus()
    ahead = fold(Fleet(), EVENTS[:5])
    disk.gate.clear()
    disk.waiting.clear()
    ledger.append(EVENTS[:5], 0)
    assert disk.waiting.wait(30)
    opened: list[int] = []

    def fleet() -> Fleet:
        opened.append(ledger.durable)
        disk.gate.set()  # only now can the disk go on
        return ahead

    FeedServer(bus, ledger, fleet)
    (answer,) = bus.ask(STATE_KEY)
    assert opened == [0]
    assert ledger.durable == 5
    assert b'"position":5' in answer
    ledger.close()


def test_without_a_core_there_is_nothing_to_follow() -> None:
    with pytest.raises(TimeoutError):
        FeedFollower(MemoryBus()).start()


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{LOOPBACK}:{probe.getsockname()[1]}"


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture
def buses(endpoint: str) -> Iterator[tuple[ZenohBus, ZenohBus]]:
    core = ZenohBus(endpoint)
    try:
        other = ZenohBus(None, [endpoint])
        try:
            yield core, other
        finally:
            other.close()
    finally:
        core.close()


def test_a_follower_over_zenoh_keeps_up(buses: tuple[ZenohBus, ZenohBus], tmp_path: Path) -> None:
    ledger = FileLedger.open(tmp_path, segment_chunks_max=20)
    try:
        assert ledger.wait(ledger.append(EVENTS[:150], 0), 30)
        FeedServer(
            buses[0],
            ledger,
            lambda: restore(tmp_path, tmp_path / "none", read=ledger.read),
        )
        follower = FeedFollower(buses[1])
        fleet = follower.start()
        assert fleet.position == 150
        got: list[AnyEvent] = []
        for n in range(150, 400, 5):
            ledger.append(EVENTS[n : n + 5], n)
            got += follower.drain()
        assert follower.wait(400, 30)
        got += follower.drain()
        assert got == EVENTS[150:]
        late = FeedFollower(buses[1])
        assert late.start().canonical() == fold(fleet, got).canonical()
    finally:
        ledger.close()


FOLLOWER = """
import hashlib, sys
from ledger.codec import encode
from ledger.feed import FeedFollower, Mark
from ledger.zenoh_bus import ZenohBus

bus = ZenohBus(None, [sys.argv[1]])
bus.live("following")
follower = FeedFollower(bus)
follower.start_behind(Mark())
print("ready", flush=True)
sys.stdin.readline()  # stopped before this
sha, last = hashlib.sha256(), int(sys.argv[2])
while follower.position < last:
    follower.wait(follower.position + 1, 5.0)
    for event in follower.drain():
        sha.update(encode(event))
print(sha.hexdigest(), flush=True)
bus.close()
"""
FLOOD = 60_000  # events, some 30 MB: more than all queues on the way hold


def test_a_follower_that_stalls_holds_up_nobody_and_misses_nothing(
    buses: tuple[ZenohBus, ZenohBus], endpoint: str
) -> None:
    """It is still there afterwards: nobody waited for it until its connection was closed."""
    core = buses[0]
    kind = EVENTS[4]
    events = [
        msgspec.structs.replace(kind, position=n, at_ms=n, command=CommandId(f"c{n}" * 60))
        for n in range(1, FLOOD + 1)
    ]
    ledger = MemoryLedger()
    FeedServer(core, ledger, Fleet)
    there: queue.Queue[bool] = queue.Queue()
    core.watch("following", lambda key, alive: there.put(alive))
    process = subprocess.Popen(
        [sys.executable, "-c", FOLLOWER, endpoint, str(FLOOD)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        assert there.get(timeout=30)
        process.send_signal(signal.SIGSTOP)
        for first in range(0, FLOOD, 100):
            ledger.append(events[first : first + 100], first)
        process.send_signal(signal.SIGCONT)
        said, _ = process.communicate("go on\n", timeout=60)
    finally:
        process.kill()
        process.wait()
    sha = hashlib.sha256(b"".join(encode(event) for event in events))
    assert said.strip() == sha.hexdigest()
    assert not there.get(timeout=30)  # it left at the end …
    assert there.empty()  # … and only then
