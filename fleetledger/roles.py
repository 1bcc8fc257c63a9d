"""The scheduler's process and the simulator's: threads and sockets around two pure roles."""

import random
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import msgspec
import structlog

from fleetledger.clock import Clock
from fleetledger.proposing import ProposalsAnswer
from fleetledger.stuck_log import StuckLog
from ledger.bus import EVENTS_KEY, LAST_KEY, PROPOSE_KEY, Bus, counts_key, plans_key
from ledger.events import AnyEvent
from ledger.feed import FeedFollower
from ledger.ids import RobotName, SceneId
from ledger.link import DoorReport, Plan, Report
from ledger.proposals import AnyProposal, StopRobot
from ledger.scene import Area, Group
from ledger.waits import Counts
from scheduler.links.bus import BusLink
from scheduler.links.devices import BusDevices, DeviceReport
from scheduler.loop import Scheduler
from scheduler.traffic.traffic import Traffic
from scheduler.traffic.venus import Think, at_once
from sim.faults import FaultMix
from sim.link import SimRole
from sim.world import World

log = structlog.get_logger()

PERIOD_S = 0.1  # of scaled time between two passes …
HURRIED_S_MIN = 0.005  # between two passes while somebody waits
PERIOD_REAL_S_MIN = 0.02  # … but no more often than this, which bounds --speed in effect
PROPOSE_S_MAX = 10.0  # a core that takes longer is gone, and so shall we be
FOLLOW_S_MAX = 5.0
# somebody waits for what comes of these: the next pass does not wait for its turn
URGENT = (b'"type":"MapResourcesAsked"', b'"type":"RobotSoftStopped"')
DEVICES_MAX = 10_000  # whose reports wait for the next pass


_answers = msgspec.json.Decoder(ProposalsAnswer)
_last = msgspec.json.Decoder(list[tuple[Report, Plan]])


class Inbox:
    """What the bus's threads heard, until the role's own thread takes it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._routes: list[Report] = []  # reports with a route answer TellRoute: none is dropped
        self._reports: dict[tuple[SceneId, RobotName], Report] = {}  # only the newest counts
        self._tokens: list[tuple[SceneId, RobotName, bool]] = []
        self._devices: dict[tuple[SceneId, str, int], DeviceReport] = {}  # only the newest counts

    def report(self, report: Report) -> None:
        """Keep a report in place of the robot's last one."""
        with self._lock:
            if report.route is not None:
                self._routes.append(report)
            self._reports[report.scene, report.robot] = report

    def alive(self, scene: SceneId, robot: RobotName, alive: bool) -> None:
        """Keep what happened to a token; the order matters."""
        with self._lock:
            self._tokens.append((scene, robot, alive))

    def device(self, report: DeviceReport) -> None:
        """Keep a report in place of the device's last one."""
        if isinstance(report, DoorReport):
            key = (report.scene, "door", report.door)
        else:
            key = (report.scene, "lift", report.lift)
        with self._lock:
            if key in self._devices or len(self._devices) < DEVICES_MAX:
                self._devices[key] = report

    def take_devices(self) -> list[DeviceReport]:
        """Give the devices' reports in the order of their ids, and have none."""
        with self._lock:
            reports, self._devices = self._devices, {}
        return [reports[key] for key in sorted(reports)]

    def take(self) -> tuple[list[Report], list[tuple[SceneId, RobotName, bool]]]:
        """Give everything and be empty; routes first, then reports by the robots' names."""
        with self._lock:
            routes, self._routes = self._routes, []
            reports, self._reports = self._reports, {}
            tokens, self._tokens = self._tokens, []
        return [*routes, *(reports[key] for key in sorted(reports))], tokens


class SchedulerRole:
    """The scheduler on a bus. What it owes after a start it derives from state and reports."""

    def __init__(self, bus: Bus, cache: Path | None, think: Think = at_once) -> None:
        """Take the bus to the core and the robots, a folder for compiled maps, and who does what
        planners take long for: on virtual time it is done at once.
        """
        self._bus = bus
        self._cache = cache
        self._follower = FeedFollower(bus)
        self._inbox = Inbox()
        self._stuck = StuckLog()
        self._in_vain = False  # the core takes no proposals for now
        self._think = think
        link = BusLink(bus)
        devices = BusDevices(bus)
        fleet = self._follower.start()
        self.scheduler = Scheduler(
            fleet, self._propose, link, self._show, self._traffic, devices, self._count
        )
        with suppress(TimeoutError):  # nobody knows anything
            self.scheduler.remember(_last.decode(bus.ask(LAST_KEY, timeout_s=FOLLOW_S_MAX)[0]))
        devices.hear(self._inbox.device, _dropped)
        link.hear(
            self._inbox.report,
            self._inbox.alive,
            _dropped,
        )

    def tick(self, now_ms: int) -> None:
        """Take what was heard, and make one pass."""
        self.scheduler.on_events(self._follower.drain())
        reports, tokens = self._inbox.take()
        for scene, robot, alive in tokens:
            self.scheduler.on_alive(scene, robot, alive)
        for report in reports:
            self.scheduler.on_report(report)
        for device in self._inbox.take_devices():
            self.scheduler.on_device(device)
        self.scheduler.tick(now_ms)

    def _propose(self, proposals: Sequence[AnyProposal]) -> Sequence[AnyEvent]:
        raw = msgspec.json.encode(proposals)
        answer = _answers.decode(self._bus.ask(PROPOSE_KEY, raw, timeout_s=PROPOSE_S_MAX)[0])
        if bool(answer.unavailable) is not self._in_vain:  # told once, not at every pass
            self._in_vain = not self._in_vain
            words = "proposals are not taken" if self._in_vain else "proposals are taken again"
            log.warning(words, reason=answer.unavailable)
        for proposal in proposals:
            if isinstance(proposal, StopRobot):
                log.error("robot stopped", robot=proposal.robot, reason=proposal.reason)
        for refused in answer.refused:
            log.info("refused", proposal=repr(proposals[refused.index]), reason=refused.code)
        self._follower.wait(answer.position, FOLLOW_S_MAX)
        return self._follower.drain()

    def _show(self, scene: SceneId, plans: Sequence[Plan]) -> None:
        self._stuck.look(plans)
        self._bus.publish(plans_key(scene), msgspec.json.encode(plans))

    def _count(self, counts: Counts) -> None:
        self._bus.publish(counts_key(counts.scene), msgspec.json.encode(counts))

    def _traffic(self, scene: SceneId, area: Area, groups: Sequence[Group]) -> Traffic:
        log.info("map is being compiled", scene=scene, area=area.name, points=len(area.points))
        return Traffic(scene, area, groups, self._cache, think=self._think)


def _dropped(key: str, reason: str) -> None:
    log.warning("report dropped", key=key, reason=reason)


def run_scheduler(bus: Bus, clock: Clock, cache: Path, stop: threading.Event) -> None:
    """Plan until told to stop."""
    # Venus searches beside the loop, for one area at a time: plain Python has one core anyway.
    thinker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="venus")
    role = SchedulerRole(bus, cache, thinker.submit)
    hurry = threading.Event()

    def heard(_: str, payload: bytes) -> None:
        if any(kind in payload for kind in URGENT):
            hurry.set()

    def tick() -> None:
        role.tick(clock.now_ms())
        if role.scheduler.is_awaited:
            hurry.set()

    bus.subscribe(EVENTS_KEY, heard)
    try:
        _paced(clock, stop, tick, hurry)
    finally:
        thinker.shutdown(wait=False, cancel_futures=True)


def run_sim(
    bus: Bus, clock: Clock, saved: Path, seed: int, faults: FaultMix, stop: threading.Event
) -> None:
    """Be the simulated robots until told to stop."""
    world = World(random.Random(seed), faults)
    role = SimRole(bus, FeedFollower(bus), world, memory=saved)
    role.start(clock.now_ms())
    try:
        _paced(clock, stop, lambda: role.tick(clock.now_ms()), threading.Event())
    finally:
        role.close()


def _paced(
    clock: Clock, stop: threading.Event, tick: Callable[[], None], hurry: threading.Event
) -> None:
    """Tick at an even pace; who is late skips, and never runs after lost time.

    Who hurries it has the next tick at once, but for the least pause between two.
    """
    period_s = max(clock.real_s(PERIOD_S), PERIOD_REAL_S_MIN)
    due = time.monotonic()
    while not stop.is_set():
        hurry.clear()
        tick()
        ended = time.monotonic()
        due = max(due + period_s, ended)
        if hurry.wait(max(0.0, due - ended)):
            stop.wait(max(0.0, ended + HURRIED_S_MIN - time.monotonic()))
            due = time.monotonic()
