"""A scheduler at work on a small site, on virtual time."""

from collections.abc import Callable, Sequence

from ledger.events import AnyEvent
from ledger.ids import RobotName, SceneId, robot_key
from ledger.link import Plan
from ledger.scene import Area, Group
from ledger.state import Fleet, Order, Robot
from scheduler.loop import Scheduler
from tests.scheduler.small_core import SmallCore
from tests.scheduler.small_site import SCENE, SmallRobots, SmallTraffic

TICK_MS = 100


class Shift:
    """Core, scheduler and robots, called in turn."""

    def __init__(self, *events: AnyEvent, lenient: bool = False) -> None:
        self.core = SmallCore(lenient=lenient)
        self.traffic: dict[int, SmallTraffic] = {}
        self.robots = SmallRobots(self.traffic)
        self.plans: list[Plan] = []
        self.on_plans: Callable[[Sequence[Plan]], None] = lambda plans: None
        self.mute: set[str] = set()  # robots whose reports get lost
        self.core.happen(*events)
        self.restart()

    def restart(self) -> None:
        """Start a new scheduler on the state as it is; the robots stay where they are."""
        self.core.unseen()
        self.scheduler = Scheduler(
            self.core.fleet.copy(), self.core.propose, self.robots, self._on_plans, self._roads
        )

    def _roads(self, scene: SceneId, area: Area, groups: Sequence[Group]) -> SmallTraffic:
        self.traffic[area.id] = SmallTraffic(scene, area, groups)
        return self.traffic[area.id]

    def _on_plans(self, scene: SceneId, plans: Sequence[Plan]) -> None:
        self.plans = list(plans)
        self.on_plans(plans)

    def happen(self, *events: AnyEvent) -> None:
        self.core.happen(*events)

    def tick(self) -> None:
        self.core.now_ms += TICK_MS
        for report in self.robots.step(self.core.now_ms):
            if report.robot not in self.mute:
                self.scheduler.on_report(report)
        self.scheduler.on_events(self.core.unseen())
        self.scheduler.tick(self.core.now_ms)
        assert self.scheduler._fleet.canonical() == self.core.fleet.canonical()

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass; tell whether the condition came true."""
        for _ in range(int(seconds * 1000 / TICK_MS)):
            if until():
                return True
            self.tick()
        return until()

    @property
    def fleet(self) -> Fleet:
        return self.core.fleet

    def order(self, number: int) -> Order | None:
        return next((o for i, o in self.fleet.orders.items() if i.endswith(f"-{number:06}")), None)

    def robot(self, name: str) -> Robot:
        return self.fleet.robots[robot_key(SCENE, RobotName(name))]

    def happened(self, kind: type[AnyEvent]) -> list[AnyEvent]:
        return [e for e in self.core.events if isinstance(e, kind)]
