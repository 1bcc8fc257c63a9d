"""The whole core on virtual time over a disk as bad as can be, through many lives.

One thread, one seed: the same seed does the same again, to the byte.
"""

import hashlib
import os
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from random import Random

import structlog

from fleetledger.shift import START_MS
from ledger import store
from ledger.errors import LedgerError, Unknown
from ledger.evolve import fold
from ledger.scan import read_folder
from ledger.scene import Value
from ledger.seal import seal_folder
from ledger.snapshot import restore
from ledger.state import Fleet
from ledger.verify import verify
from sim.faults import FaultMix
from sim.warehouses import generate
from sim.world import World
from tests.laws.crash.clients import Clients, Request
from tests.laws.crash.core import STEP_MS, Core, Site, Sizes
from tests.laws.crash.disk import Crashed, FaultyDisk, Trouble
from tests.laws.crash.rows import Rows
from tests.laws.crash.witness import Witness

log = structlog.get_logger()

STEPS = 120  # things that happen in one simulation
STARTS_MAX = 50  # in a row without one that succeeds
QUIET_S = 8.0  # of virtual time at the end, without trouble
MOMENTS_MAX = 20

DiskKind = Callable[[Path, Random], FaultyDisk]


class Done(Value, frozen=True, kw_only=True):
    """What came about, for counting and comparing."""

    digest: str  # of all segments' bytes
    events: int
    lives: int
    calls: int  # of the disk
    seen: Counter[str]  # what happened how often


class Simulation:
    """One seed's story."""

    def __init__(self, seed: int, folder: Path, kind: DiskKind = FaultyDisk) -> None:
        """Take a folder that may be filled, and what disk to use."""
        self.rng = Random(seed)
        disk_rng = Random(self.rng.random())
        folder.mkdir(parents=True, exist_ok=True)
        file = generate(aisles=2, bays=2, robots=self.rng.choice((2, 3)), seed=seed)
        faults = FaultMix(late_ratio=0.2, late_mean_s=3.0)
        self.site = Site(
            folder=folder,
            maps=Path(_maps().name),
            disk=kind(folder, disk_rng),
            file=file,
            sizes=Sizes.drawn(self.rng),
            world=World(Random(self.rng.random()), faults),
            rows=Rows(),
            witness=Witness(),
            rng=Random(self.rng.random()),
        )
        self.clients = Clients(Random(self.rng.random()), file, self.site.witness.made)
        self.wall_ms = START_MS
        self.seen: Counter[str] = Counter()
        self.moments: dict[int, str] = {}  # position -> hash of the state that a query saw
        self.core: Core | None = None

    def run(self, steps: int = STEPS) -> Done:
        """Live through all steps, then put everything right, and count."""
        usual = store.CHUNK_EVENTS_MAX
        try:
            for _ in range(steps):
                self._survive(self._something)
            self._end()
        finally:
            store.CHUNK_EVENTS_MAX = usual
            if self.core is not None:
                self.core.let_go()
            self.site.rows.close()
        files = sorted(self.site.ledger.glob("*.mcap"))
        return Done(
            digest=hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest(),
            events=len(self.site.witness.shown),
            lives=self.seen["start"],
            calls=self.site.disk.calls,
            seen=self.seen + self.site.disk.fates,
        )

    def _survive(self, act: Callable[[Core], None]) -> None:
        """Do something with a core that is alive; it need not live through it."""
        core = self.core or self._start()
        try:
            act(core)
        except Crashed:
            self._lost(core)
        except LedgerError:
            assert core.failure() is not None
        failure = core.failure() if self.core is core else None
        if failure is not None:
            if not _is_of_the_disk(failure):
                raise failure
            self.seen["failure"] += 1
            with suppress(Crashed):
                self._accepts_nothing(core)
            self._lost(core)

    def _lost(self, core: Core) -> None:
        core.let_go()
        self.wall_ms = core.now_ms
        self.core = None

    def _accepts_nothing(self, core: Core) -> None:
        """After a failure nothing is acknowledged, and the failed file is left alone."""
        before = len(self.site.witness.replies)
        try:
            core.ask(self.clients.request())
        except Unknown:
            core.commit()
        else:
            raise AssertionError("a failed ledger took a command")
        assert len(self.site.witness.replies) == before, "a failed ledger acknowledged"
        assert self.site.disk.broken_rules == []

    # from one life to the next

    def _start(self, *, trouble: bool = True) -> Core:
        """Start the core until it stands; what it finds is held to what was said."""
        rng, disk = self.rng, self.site.disk
        for _ in range(STARTS_MAX):
            self.wall_ms += rng.choice((0, 1_000, -60_000))  # somebody sets the clock
            disk.live(Trouble(rng, soon=rng.random() < 0.3) if trouble else None)
            try:
                self.core = Core(self.site, self.wall_ms, self._opened)
            except Crashed:
                self.seen["crash at start"] += 1
            except (OSError, Unknown) as error:
                if not _is_of_the_disk(error):
                    raise
                self.seen["failure at start"] += 1
                disk.die()
            else:
                self.seen["start"] += 1
                self._retry(self.core)
                return self.core
        raise AssertionError(f"no start succeeds: {disk.faults[-STARTS_MAX:]}")

    def _opened(self, core: Core) -> None:
        """Check what recovery found, before anything new happens."""
        site, fleet = self.site, core.handler.fleet
        site.witness.check(site.ledger)
        self._orders_agree(fleet)
        anew = fold(Fleet(), read_folder(site.ledger))
        assert anew.canonical() == fleet.canonical(), "snapshot and fold differ"
        for position in self.rng.sample(sorted(self.moments), min(2, len(self.moments))):
            then = restore(site.ledger, site.snapshots, position=position)
            assert _hash(then) == self.moments[position], f"the state at {position} has changed"
        self.moments = {p: h for p, h in self.moments.items() if p <= fleet.position}

    def _orders_agree(self, fleet: Fleet) -> None:
        """The live state is what a fold of plain JSON comes to."""
        live = {o.id: (o.priority, len(o.steps), o.sealed) for o in fleet.orders.values()}
        mine = {i: now for i, now in self.site.witness.orders.by_id.items() if now is not None}
        assert live == mine, "live orders differ from the model's"

    def _retry(self, core: Core) -> None:
        """Clients send again what got no answer; some have lost patience."""
        witness = self.site.witness
        for key, request in list(witness.asked.items()):
            if key not in witness.replies and self.rng.random() < 0.8:
                self._ask(core, request)

    def _ask(self, core: Core, request: Request) -> None:
        try:
            core.ask(request)
        except LedgerError:
            assert core.failure() is not None

    # what happens

    def _something(self, core: Core) -> None:
        acts: tuple[tuple[Callable[[Core], None], int], ...] = (
            (self._requests, 8),
            (self._time, 8),
            (Core.commit, 6),
            (self._repeat, 3),
            (self._rows, 2),
            (self._seal, 2),
            (self._look, 2),
            (Core.restart_scheduler, 1),
            (self._stop, 1),
            (self._cut, 1),
        )
        act = self.rng.choices([a for a, _ in acts], [weight for _, weight in acts])[0]
        act(core)

    def _requests(self, core: Core) -> None:
        for _ in range(self.rng.randrange(1, 6)):
            core.ask(self.clients.request())
        if self.rng.random() < 0.5:
            core.commit()

    def _time(self, core: Core) -> None:
        for _ in range(self.rng.choice((1, 4, 15))):
            core.tick()

    def _repeat(self, core: Core) -> None:
        keys = list(self.site.witness.replies)
        if keys:
            core.ask(self.site.witness.asked[self.rng.choice(keys)])
            core.commit()

    def _rows(self, core: Core) -> None:
        self.site.rows.commit()

    def _seal(self, core: Core) -> None:
        """Pack what is finished: another process does it, which dies with the core."""
        try:
            for _ in seal_folder(self.site.disk, self.site.ledger):
                self.seen["sealed"] += 1
        except OSError:
            self.seen["not sealed"] += 1

    def _look(self, core: Core) -> None:
        if len(self.moments) < MOMENTS_MAX:
            self.moments[core.live.position] = _hash(core.live.fleet)

    def _stop(self, core: Core) -> None:
        core.stop()
        if core.failure() is None:
            self.seen["stop"] += 1
            self.wall_ms, self.core = core.now_ms, None

    def _cut(self, core: Core) -> None:
        """Kill the process or the machine between two calls of the disk."""
        if self.rng.random() < 0.5:
            self.site.disk.lose_power()
        else:
            self.site.disk.die()
        raise Crashed

    # the end

    def _end(self) -> None:
        """Without trouble every request is answered, and everything is as was said."""
        if self.core is not None:
            self._cut_quietly(self.core)
        if self.rng.random() < 0.3:
            self.site.rows.begin_anew()
        core = self._start(trouble=False)
        witness = self.site.witness
        for key, request in list(witness.asked.items()):
            if key not in witness.replies:
                core.ask(request)
        for _ in range(int(QUIET_S * 1000 / STEP_MS)):
            core.tick()
            core.commit()
        assert witness.asked.keys() == witness.replies.keys(), "somebody got no answer"
        for key in self.rng.sample(sorted(witness.replies), min(5, len(witness.replies))):
            core.ask(witness.asked[key])
        core.commit()
        self.site.rows.commit()
        core.stop()
        self.core = None
        witness.check(self.site.ledger)
        self._orders_agree(core.live.fleet)
        assert core.live.fleet.canonical() == core.handler.fleet.canonical()
        self.site.rows.check(witness)
        verdict = verify(self.site.folder)
        assert verdict.sound, verdict.findings
        assert verdict.events == len(witness.shown)
        assert self.site.disk.broken_rules == []

    def _cut_quietly(self, core: Core) -> None:
        self.site.disk.lose_power()
        self._lost(core)


@cache
def _maps() -> tempfile.TemporaryDirectory[str]:
    """Compiling the map took most of the time."""
    return tempfile.TemporaryDirectory(prefix="crash-maps-")


def _is_of_the_disk(error: BaseException | None) -> bool:
    """Tell a failure that the disk brought about from our own mistake."""
    while error is not None and not isinstance(error, OSError):
        error = error.__cause__
    return error is not None


def _hash(fleet: Fleet) -> str:
    return hashlib.sha256(fleet.canonical()).hexdigest()


def repeats(seed: int, steps: int) -> str:
    """Give the command that lives through a seed again."""
    return f"python -m tests.laws.crash --seed {seed}" + (
        f" --steps {steps}" if steps != STEPS else ""
    )


def simulate(seed: int, steps: int = STEPS, kind: DiskKind = FaultyDisk) -> Done:
    """Run one seed in a folder of its own, which is gone afterwards.

    What fails bears a note that says how to repeat it.
    """
    memory = Path("/dev/shm")  # its own syncs would only cost time
    where = memory if os.access(memory, os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="crash-", dir=where) as folder:
        try:
            return Simulation(seed, Path(folder), kind).run(steps)
        except BaseException as error:
            error.add_note(f"to repeat it: {repeats(seed, steps)}")
            raise
