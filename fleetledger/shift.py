"""All roles in one process on virtual time: a shift of hours in minutes, the same bytes each time.

The same core, scheduler and robots as in `serve`, over the bus in memory: used by the laws, by
`bench`, and by whoever wants to try a fleet before buying it.
"""

import random
from collections import deque
from collections.abc import Callable
from itertools import count

import msgspec

from commands.handle import Handler
from commands.orders import CreateOrder
from commands.scenes import ImportScene, scene_digest
from fleetledger.proposing import responder
from fleetledger.roles import SchedulerRole
from ledger.bus import LAST_KEY, PROPOSE_KEY, MemoryBus
from ledger.evolve import fold
from ledger.feed import FeedFollower, FeedServer
from ledger.ids import CommandId, OrderId, SceneId
from ledger.link import Plan, Report
from ledger.scene import SceneFile
from ledger.state import Fleet, StepTask
from ledger.store import Ledger, MemoryLedger
from sim.faults import NONE, FaultMix
from sim.link import SimRole
from sim.world import World

START_MS = 1_700_000_000_000
STEP_MS = 200  # of virtual time between two looks at everything
PLANS_KEPT = 8  # messages of plans: every fifth is of all robots

_report = msgspec.json.Decoder(Report)
_plans = msgspec.json.Decoder(list[Plan])


class Shift:
    """A site at work. Deterministic: no clock and no chance but what is handed in."""

    def __init__(
        self,
        scene: SceneFile,
        *,
        seed: int = 1,
        faults: FaultMix = NONE,
        ledger: Ledger | None = None,
        step_ms: int = STEP_MS,
        bus: MemoryBus | None = None,
    ) -> None:
        """Take the site, and the ledger to write to (default: one in memory)."""
        self.now_ms = START_MS
        self.step_ms = step_ms
        self.ledger = ledger or MemoryLedger()
        self.bus = bus or MemoryBus()
        self._numbers = count(1)
        self.handler = self._handler(Fleet())
        self._feed = FeedServer(self.bus, self.ledger, lambda: self.handler.fleet)
        self.bus.respond(PROPOSE_KEY, responder(self.handler, self.ledger))
        self._reports: dict[str, bytes] = {}
        self._plans: deque[bytes] = deque(maxlen=PLANS_KEPT)
        self.bus.subscribe("scenes/*/robots/*/report", self._reports.__setitem__)
        self.bus.subscribe("scenes/*/plans", lambda _, payload: self._plans.append(payload))
        self.bus.respond(LAST_KEY, self._last)
        self.scene = self._import(scene)
        self.world = World(random.Random(seed), faults)
        self.sim = SimRole(self.bus, FeedFollower(self.bus), self.world, report_ms=step_ms)
        self.sim.start(self.now_ms)
        self.role = self._scheduler()

    def _scheduler(self) -> SchedulerRole:
        others = set(map(id, self.bus.listeners()))
        role = SchedulerRole(self.bus, None)
        self._its_own = [entry for entry in self.bus.listeners() if id(entry) not in others]
        return role

    def _handler(self, fleet: Fleet) -> Handler:
        return Handler(
            fleet, self.ledger, lambda: self.now_ms, lambda: f"{next(self._numbers):024X}"
        )

    @property
    def fleet(self) -> Fleet:
        """The state as of now."""
        return self.handler.fleet

    def _command(self) -> tuple[CommandId, str, int]:
        return CommandId(self.handler.new_id()), "shift", self.now_ms

    def _import(self, file: SceneFile) -> SceneId:
        id_, by, at_ms = self._command()
        new = SceneId(self.handler.new_id())
        command = ImportScene(
            id=id_, by=by, at_ms=at_ms, scene=new, digest=scene_digest(file), file=file
        )
        return SceneId(self.handler.handle(command).made)

    def order(self, *tasks: StepTask, priority: int = 0) -> OrderId:
        """Send a sealed order."""
        id_, by, at_ms = self._command()
        command = CreateOrder(
            id=id_,
            by=by,
            at_ms=at_ms,
            scene=self.scene,
            sealed=True,
            tasks=tasks,
            priority=priority,
        )
        return OrderId(self.handler.handle(command).made)

    def _last(self, _: bytes) -> list[bytes]:
        """What the core knows of robots, as in `projections.live`."""
        reports = {r.robot: r for r in map(_report.decode, self._reports.values())}
        plans = {plan.robot: plan for some in self._plans for plan in _plans.decode(some)}
        known = [(reports[name], plan) for name, plan in plans.items() if name in reports]
        return [msgspec.json.encode(known)]

    def run(self, seconds: float, each_step: Callable[[], None] | None = None) -> None:
        """Let time pass; `each_step` looks on, or sends orders."""
        until_ms = self.now_ms + int(seconds * 1000)
        while self.now_ms < until_ms:
            self.now_ms += self.step_ms
            self.sim.tick(self.now_ms)
            self.role.tick(self.now_ms)
            if each_step is not None:
                each_step()

    def restart_core(self) -> None:
        """Lose the core, and have another go on from the ledger; those who follow it stay."""
        self.handler = self._handler(fold(Fleet(), self.ledger.read(0)))
        self.bus.respond(PROPOSE_KEY, responder(self.handler, self.ledger))

    def restart_scheduler(self) -> None:
        """Leave the scheduler and start a new one, which knows only state and reports."""
        self.bus.end(self._its_own)
        self.role = self._scheduler()
