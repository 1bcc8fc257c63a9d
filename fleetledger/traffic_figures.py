"""How many robots wait and for what, and what traffic has counted, for Prometheus."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping

import msgspec
import structlog
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from ledger.bus import Bus
from ledger.ids import RobotKey, SceneId
from ledger.link import Plan
from ledger.waits import Counts, WaitReason

STALE_MS = 10_000  # every plan is told again every two seconds; the scheduler has gone
SCENES_MAX = 1_000

log = structlog.get_logger()

_counts = msgspec.json.Decoder(Counts)


class TrafficFigures:
    """Read on the event loop, as the plans are; counts may be heard on any thread."""

    def __init__(self, plans: Mapping[RobotKey, Plan], now_ms: Callable[[], int]) -> None:
        """Take the newest plans, and the time that they are told in."""
        self._plans = plans
        self._now_ms = now_ms
        self._counts: dict[SceneId, Counts] = {}

    def hear(self, bus: Bus) -> None:
        """Follow what the scheduler counts."""
        bus.subscribe("scenes/*/counts", self._heard)

    def _heard(self, key: str, payload: bytes) -> None:
        try:
            counts = _counts.decode(payload)
        except msgspec.DecodeError as trouble:
            log.warning("message dropped", reason=str(trouble), key=key)
            return
        if counts.scene in self._counts or len(self._counts) < SCENES_MAX:
            self._counts[counts.scene] = counts

    def collect(self) -> Iterator[Metric]:
        """Give the figures of every scene in which robots are planned for."""
        now_ms = self._now_ms()
        fresh = [plan for plan in self._plans.values() if now_ms - plan.at_ms <= STALE_MS]
        waiting: Counter[tuple[SceneId, WaitReason]] = Counter()
        longest_ms: dict[SceneId, int] = dict.fromkeys((plan.scene for plan in fresh), 0)
        for plan in fresh:
            if plan.wait is not None:
                waiting[plan.scene, plan.wait.reason] += 1
                lasts_ms = now_ms - plan.wait.since_ms
                longest_ms[plan.scene] = max(longest_ms[plan.scene], lasts_ms)
        robots = GaugeMetricFamily(
            "fleetledger_traffic_waiting_robots",
            "Robots that wait, by reason",
            labels=["scene", "reason"],
        )
        longest = GaugeMetricFamily(
            "fleetledger_traffic_longest_wait_seconds",
            "For how long the robot that waits longest has stood",
            labels=["scene"],
        )
        for scene, lasts_ms in sorted(longest_ms.items()):
            for reason in WaitReason:
                robots.add_metric([scene, reason.value], waiting[scene, reason])
            longest.add_metric([scene], lasts_ms / 1000)
        stuck = GaugeMetricFamily(
            "fleetledger_traffic_stuck_robots",
            "Robots that cannot get on without a person",
            labels=["scene"],
        )
        for scene in sorted(longest_ms):
            alarmed = [plan for plan in fresh if plan.scene == scene and plan.stuck is not None]
            stuck.add_metric([scene], len(alarmed))
        yield robots
        yield longest
        yield stuck
        yield from self._counters()

    def _counters(self) -> Iterator[Metric]:
        plannings = CounterMetricFamily(
            "fleetledger_traffic_plannings",
            "Plannings, by what made them due",
            labels=["scene", "due"],
        )
        pushes = CounterMetricFamily(
            "fleetledger_traffic_pushes", "Robots sent out of the way of others", labels=["scene"]
        )
        cycles = CounterMetricFamily(
            "fleetledger_traffic_wait_cycles",
            "Times that robots waited for each other, for seconds",
            labels=["scene"],
        )
        ladder = CounterMetricFamily(
            "fleetledger_traffic_ladder",
            "Searches for robots that were stuck, ways found for them, and alarms",
            labels=["scene", "what"],
        )
        breaches = CounterMetricFamily(
            "fleetledger_traffic_breaches",
            "Times that robots were held for what must not be: bodies or ground that overlap",
            labels=["scene"],
        )
        for scene, counts in sorted(self._counts.items()):
            breaches.add_metric([scene], counts.breaches)
            for due, count in sorted(counts.plannings.items()):
                plannings.add_metric([scene, due], count)
            pushes.add_metric([scene], counts.pushes)
            cycles.add_metric([scene], counts.cycles)
            for what, count in sorted(counts.ladder.items()):
                ladder.add_metric([scene, what], count)
        yield from (plannings, pushes, cycles, ladder, breaches)
