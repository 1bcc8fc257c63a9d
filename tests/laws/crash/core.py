"""One life of the core and its roles, over a bad disk: from recovery to whatever ends it."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random

from commands.handle import Answered, Handler
from commands.resources import LapseMapResources
from commands.scenes import ImportScene, scene_digest
from fleetledger.proposing import responder
from fleetledger.roles import SchedulerRole
from ledger import store
from ledger.bus import EVENTS_KEY, PROPOSE_KEY, MemoryBus
from ledger.errors import LedgerError
from ledger.events import AnyEvent
from ledger.feed import FeedFollower, FeedServer
from ledger.ids import CommandId
from ledger.scene import SceneFile, Value
from ledger.snapshot import Snapshotter, restore
from ledger.store import FileLedger
from projections.live import Live
from sim.link import SimRole
from sim.world import World
from tests.laws.crash.clients import SCENE, Request, answer
from tests.laws.crash.disk import Crashed, FaultyDisk
from tests.laws.crash.rows import Rows
from tests.laws.crash.witness import Witness

STEP_MS = 200


class Sizes(Value, frozen=True, kw_only=True):
    """When segments are full and snapshots due: small, so that much begins and ends."""

    segment_bytes_max: int
    segment_chunks_max: int
    snapshot_events: int
    chunk_events_max: int

    @classmethod
    def drawn(cls, rng: Random) -> "Sizes":
        """Draw them."""
        return cls(
            segment_bytes_max=rng.choice((5_000, 40_000, 1_000_000)),
            segment_chunks_max=rng.choice((2, 7, 40)),
            snapshot_events=rng.choice((5, 30, 10_000)),
            chunk_events_max=rng.choice((1, 6, store.CHUNK_EVENTS_MAX)),
        )


@dataclass(frozen=True, kw_only=True)
class Site:
    """What outlives the core."""

    folder: Path
    maps: Path  # compiled ones, for all sites
    disk: FaultyDisk
    file: SceneFile
    sizes: Sizes
    world: World  # robots drive on, whatever becomes of the core
    rows: Rows
    witness: Witness
    rng: Random

    @property
    def ledger(self) -> Path:
        """Folder of segments."""
        return self.folder / "ledger"

    @property
    def snapshots(self) -> Path:
        """Folder of snapshots."""
        return self.folder / "snapshots"


class Core:
    """Opened as `fleetledger.app` does it, but for threads, sockets and the event loop."""

    def __init__(self, site: Site, wall_ms: int, opened: Callable[["Core"], None]) -> None:
        """Recover, and begin; `opened` is called once the state is there and nothing is new.

        Raises OSError or LedgerError where the disk does not let it, Crashed where it dies.
        """
        self.site = site
        self._waiting: list[tuple[Request, Answered]] = []
        store.CHUNK_EVENTS_MAX = site.sizes.chunk_events_max  # so that commands do not share one
        self.ledger = FileLedger.open(
            site.ledger,
            disk=site.disk,
            threaded=False,
            segment_bytes_max=site.sizes.segment_bytes_max,
            segment_chunks_max=site.sizes.segment_chunks_max,
        )
        try:
            self._begin(wall_ms, opened)
        except BaseException:
            self.let_go()
            raise

    def _begin(self, wall_ms: int, opened: Callable[["Core"], None]) -> None:
        site = self.site
        fleet = restore(site.ledger, site.snapshots)
        self.now_ms = max(fleet.at_ms + 1, wall_ms)
        self.handler = Handler(
            fleet, self.ledger, lambda: self.now_ms, lambda: f"{site.rng.getrandbits(96):024X}"
        )
        self.live = Live(fleet.copy())
        opened(self)
        site.rows.go_on(self.ledger, self.live)
        self._snapshotter = Snapshotter(site.snapshots, site.sizes.snapshot_events, site.disk)
        self.ledger.listen(self._apply)
        self.bus = MemoryBus()
        self.bus.subscribe(EVENTS_KEY, site.witness.follow)
        self._feed = FeedServer(self.bus, self.ledger, self.live.fleet.copy)
        self.bus.respond(PROPOSE_KEY, responder(self.handler, self.ledger))
        id_ = CommandId(self.handler.new_id())
        if SCENE not in fleet.scenes:
            file, digest = site.file, scene_digest(site.file)
            command = ImportScene(
                id=id_, by="serve", at_ms=self.now_ms, scene=SCENE, digest=digest, file=file
            )
            self.handler.handle(command)
        self.handler.handle(LapseMapResources(id=id_, by="serve", at_ms=self.now_ms))
        self.ledger.wait(self.handler.fleet.position, 0)
        self.sim = SimRole(self.bus, FeedFollower(self.bus), site.world, report_ms=STEP_MS)
        self.sim.start(self.now_ms)
        self.restart_scheduler()

    def _apply(self, events: Sequence[AnyEvent]) -> None:
        """Make a commit visible, as the event loop does before it acknowledges."""
        self.live.apply(events)
        self.site.rows.follow(events)

    def ask(self, request: Request) -> None:
        """Take a client's request in; it waits for its answer until the disk has it."""
        self.site.witness.asked[request.key] = request
        command = request.command(self.now_ms)
        self._waiting.append((request, self.handler.handle_once(command, request.digest, answer)))

    def commit(self) -> None:
        """Let the committer do one commit, and do what follows from it."""
        self.ledger.step()
        self.acknowledge()
        if self._snapshotter.due(self.live.position):
            self._snapshotter.keep(self.live.fleet.copy())

    def acknowledge(self) -> None:
        """Answer those whose command is on disk and visible."""
        done = [pair for pair in self._waiting if pair[1].position <= self.live.position]
        self._waiting = [pair for pair in self._waiting if pair not in done]
        for request, answered in done:
            reply = (answered.reply.status, answered.reply.body)
            self.site.witness.acknowledge(request, reply)

    def tick(self) -> None:
        """Let a moment pass for robots and scheduler."""
        self.now_ms += STEP_MS
        self.sim.tick(self.now_ms)
        self.role.tick(self.now_ms)
        self.acknowledge()

    def restart_scheduler(self) -> None:
        """Start another scheduler, which knows only state and reports."""
        self.role = SchedulerRole(self.bus, self.site.maps)

    def failure(self) -> LedgerError | None:
        """Tell whether the ledger has stopped for good."""
        failures: list[LedgerError] = []
        self.ledger.on_failure(failures.append)
        return failures[0] if failures else None

    def stop(self) -> None:
        """End as after SIGTERM."""
        while self.ledger.step():
            pass
        self.acknowledge()
        self.ledger.close()
        self._snapshotter.keep(self.live.fleet)

    def let_go(self) -> None:
        """Give up the lock, as the kernel does for the dead."""
        self.site.disk.die()
        with suppress(Crashed):
            self.ledger.close()
