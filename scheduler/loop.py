"""The scheduler's pace: one bounded pass at a time over all scenes, from reports to messages.

It holds no truth. What it owes follows from the fleet and the robots' reports, so that after a
restart it goes on where it was; what it remembers beside them (pauses, timers) only delays.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias, get_args

import msgspec

from ledger.events import (
    AnyEvent,
    AssignmentRejected,
    CommandAnswered,
    DeviceEvent,
    DoorCloseAsked,
    ExecutionRejected,
    ResourceEvent,
    RobotAdded,
    RobotReconnectAsked,
    RobotRemoved,
    RobotsWaited,
    RobotTrafficReset,
    SceneEvent,
    SceneImported,
    SceneMapReplaced,
    SceneRemoved,
    StepStarted,
)
from ledger.events.orders import OfOrder
from ledger.evolve import evolve
from ledger.ids import RobotKey, RobotName, SceneId, robot_key
from ledger.link import Act, Cancel, DoorReport, LiftReport, Plan, Reconnect, Report
from ledger.proposals import AnyProposal
from ledger.state import Fleet, Order, Robot
from ledger.waits import Counts
from scheduler.backoff import Backoff
from scheduler.dispatch.execution import due_action, due_cancel, goals, is_busy, takes_load
from scheduler.dispatch.phases import ALL, QUICK, dispatch
from scheduler.dispatch.stopped import stopped
from scheduler.instructions import Telling
from scheduler.links.devices import DeviceLink, NoDevices
from scheduler.links.protocol import RobotLink
from scheduler.observe import Sighting, lost_after_ms, observe
from scheduler.reconnects import Reconnects
from scheduler.roads import TrafficFactory
from scheduler.site import Site
from scheduler.view import View

PASS_MS_MIN = 200  # assignment follows news no faster than this
PASS_MS_MAX = 1_000  # and without news it still looks at batteries, waits and ways so often
REALLOCATE_MS = 2_000
PLANS_MS = 200  # so often traffic is asked what it intends: dispatch waits for the answers
SHOW_MS = 400  # and so often those who look on are told what has changed
SHOW_WHOLE_MS = 2_000  # and everything, for those who came later
RETELL_MS = 2_000  # an action that no report has confirmed is told again
SIGHTINGS_MAX = 100_000

Propose: TypeAlias = Callable[[Sequence[AnyProposal]], Sequence[AnyEvent]]
Plans: TypeAlias = Callable[[SceneId, Sequence[Plan]], None]
Counted: TypeAlias = Callable[[Counts], None]

_OF_SCENE = (*get_args(SceneEvent), *get_args(DeviceEvent))
_NO_NEWS = (AssignmentRejected, ExecutionRejected, CommandAnswered, StepStarted, RobotsWaited)


class Pace(msgspec.Struct, kw_only=True):
    """When a site had what last."""

    pass_ms: int = 0
    reallocate_ms: int = 0
    plans_ms: int = 0
    shown_ms: int = 0
    whole_ms: int = 0
    shown: dict[RobotName, Plan] = {}
    told: dict[RobotName, tuple[str, int]] = {}  # message last told, and when


class Scheduler:
    """Call everything on one thread; nothing here waits, but `propose` does for the disk."""

    def __init__(
        self,
        fleet: Fleet,
        propose: Propose,
        link: RobotLink,
        plans: Plans,
        traffic: TrafficFactory,
        devices: DeviceLink | None = None,
        counted: Counted = lambda counts: None,
    ) -> None:
        """Take the fleet over: from here on only the scheduler evolves it."""
        self._fleet = fleet
        self._propose = propose
        self._link = link
        self._plans = plans
        self._traffic = traffic
        self._devices = devices or NoDevices()
        self._counted = counted
        self._backoff = Backoff()
        self._reconnects = Reconnects()
        self._telling = Telling()
        self._sites: dict[SceneId, Site] = {}
        self._opened: set[SceneId] = set()  # scenes looked at, removed ones included
        self._paces: dict[SceneId, Pace] = {}
        self._robots: dict[SceneId, list[RobotKey]] | None = None  # sorted; None = to be sorted
        self._sightings: dict[RobotKey, Sighting] = {}
        self._heard: set[RobotKey] = set()
        self._last: list[tuple[Report, Plan]] = []
        self._since_ms: int | None = None  # of the first tick
        self._now_ms = 0

    def remember(self, last: Sequence[tuple[Report, Plan]]) -> None:
        """Take what the scheduler before this one knew of robots, before the first tick: of those
        that do not answer nobody else could say where they stand.
        """
        self._last = list(last)

    def on_events(self, events: Sequence[AnyEvent]) -> None:
        """Evolve through events, in order; those that are known already are passed over."""
        for event in events:
            if event.position <= self._fleet.position:
                continue
            evolve(self._fleet, event)
            self._note(event)

    def _note(self, event: AnyEvent) -> None:
        site = self._sites.get(event.scene)
        if isinstance(event, RobotAdded | RobotRemoved):
            self._robots = None
        elif isinstance(event, SceneRemoved):
            self._close_site(event.scene)
            return
        elif isinstance(event, RobotReconnectAsked):
            self._reconnects.ask(robot_key(event.scene, event.robot))
        if site is None:
            return  # made at the next tick, from the state as it is then
        if isinstance(event, OfOrder):
            site.waiting.note(event.order, self._fleet.orders.get(event.order))
        elif isinstance(event, SceneImported | SceneMapReplaced):
            site.build(self._fleet.scenes[event.scene])
        elif isinstance(event, _OF_SCENE):
            self._take_on(site, event.scene)
        elif isinstance(event, RobotRemoved):
            site.forget(event.robot)
        elif isinstance(event, RobotTrafficReset):
            site.reset(event.robot)
        elif isinstance(event, ResourceEvent):
            site.claims_changed = True
        if isinstance(event, DoorCloseAsked):
            site.devices.close(event.door)
        if not isinstance(event, _NO_NEWS):
            site.changed = True

    def _take_on(self, site: Site, id_: SceneId) -> None:
        before, scene = site.scene, self._fleet.scenes[id_]
        site.configure(scene)
        if scene.config.dispatch_sort != before.config.dispatch_sort:
            site.waiting.sort_by(scene.config.dispatch_sort, self._fleet.orders)

    def on_report(self, report: Report) -> None:
        """Keep a report for the next tick."""
        site = self._sites.get(report.scene)
        if site is not None:
            site.hear(report)
            self._heard.add(robot_key(report.scene, report.robot))

    def on_device(self, report: DoorReport | LiftReport) -> None:
        """Keep what a door or a lift says for the next tick."""
        site = self._sites.get(report.scene)
        if site is not None:
            site.devices.hear(report)

    def on_alive(self, scene: SceneId, robot: RobotName, alive: bool) -> None:
        """Learn that a robot's token appeared or vanished."""
        key = robot_key(scene, robot)
        known = self._sightings.pop(key, Sighting())
        self._sightings[key] = msgspec.structs.replace(known, alive=alive)
        while len(self._sightings) > SIGHTINGS_MAX:
            del self._sightings[next(iter(self._sightings))]

    def tick(self, now_ms: int) -> None:
        """Observe, dispatch, propose, then let traffic drive on what has been decided."""
        if self._since_ms is None:
            self._since_ms = now_ms
        self._now_ms = now_ms
        self._open_sites()
        for key in self._heard:
            known = self._sightings.get(key, Sighting())
            self._sightings[key] = msgspec.structs.replace(known, reported_ms=now_ms)
        self._heard.clear()
        views: dict[SceneId, View] = {}
        proposals: list[AnyProposal] = []
        for scene, site in self._sites.items():
            robots = self._robots_of(scene)
            silent_ms_max = lost_after_ms(site.scene.config)
            proposals.extend(
                observe(robots, self._sightings, silent_ms_max, self._since_ms, now_ms)
            )
            proposals.extend(self._reach(site, robots))
            site.take_in(robots, now_ms)
            proposals.extend(site.judge(robots, now_ms))
            proposals.extend(site.reserve(self._fleet, robots, now_ms))
            site.devices.take_in(site.scene, now_ms)
            proposals.extend(site.devices.news(self._fleet, site.scene, now_ms))
            if (sums := site.tally.due(scene, now_ms)) is not None:
                proposals.append(sums)
            views[scene], found = self._dispatch(scene, site, robots)
            proposals.extend(found)
        fit = self._backoff.fit(self._fleet, proposals, now_ms) if proposals else []
        if fit:
            self.on_events(self._propose(fit))
        for scene, site in self._sites.items():
            view = site.view(self._fleet, self._robots_of(scene)) if fit else views[scene]
            self._instruct(scene, view)
            self._act(scene, view)
            self._steer(scene, site, view)

    @property
    def is_awaited(self) -> bool:
        """Whether somebody waits for ground to be granted: the sooner the next pass the better."""
        return any(site.is_awaited for site in self._sites.values())

    def _open_sites(self) -> None:
        if self._opened == self._fleet.scenes.keys():
            return
        self._opened = set(self._fleet.scenes)
        there = {id_ for id_, scene in self._fleet.scenes.items() if not scene.removed}
        for scene in sorted(there - self._sites.keys()):
            last = {r.robot: (r, plan) for r, plan in self._last if r.scene == scene}
            self._sites[scene] = Site(self._fleet.scenes[scene], self._traffic, self._now_ms, last)
            self._paces[scene] = Pace()
            for id_, order in self._fleet.orders.items():
                if order.scene == scene:
                    self._sites[scene].waiting.note(id_, order)
        self._sites = dict(sorted(self._sites.items()))
        self._robots = None

    def _close_site(self, scene: SceneId) -> None:
        self._sites.pop(scene, None)
        self._paces.pop(scene, None)
        self._robots = None

    def _robots_of(self, scene: SceneId) -> list[Robot]:
        if self._robots is None:
            self._robots = {}
            for key in sorted(self._fleet.robots):
                self._robots.setdefault(self._fleet.robots[key].scene, []).append(key)
        return [self._fleet.robots[key] for key in self._robots.get(scene, ())]

    def _dispatch(
        self, scene: SceneId, site: Site, robots: list[Robot]
    ) -> tuple[View, tuple[AnyProposal, ...]]:
        """Run the cheap phases every time, the others when there is news, or now and then."""
        pace, now_ms = self._paces[scene], self._now_ms
        since_ms = now_ms - pace.pass_ms
        if since_ms < (PASS_MS_MIN if site.changed else PASS_MS_MAX):
            view = site.view(self._fleet, robots)
            return view, dispatch(view, now_ms, QUICK)
        site.changed, pace.pass_ms = False, now_ms
        reallocate = now_ms - pace.reallocate_ms >= REALLOCATE_MS
        if reallocate:
            pace.reallocate_ms = now_ms
        waiting: list[Order] = [self._fleet.orders[o] for o in site.waiting.slice()]
        view = site.view(self._fleet, robots, waiting, reallocate=reallocate)
        return view, dispatch(view, now_ms, ALL)

    def _reach(self, site: Site, robots: list[Robot]) -> list[AnyProposal]:
        """Tell those that do not answer to connect anew, and say whom it is no use to tell."""
        proposals: list[AnyProposal] = []
        for robot in robots if not site.scene.disabled else ():
            found = self._reconnects.due(robot, site.scene.config, self._now_ms)
            if isinstance(found, Reconnect):
                self._link.tell(site.scene.id, found)
            elif found is not None:
                proposals.append(found)
        return proposals

    def _instruct(self, scene: SceneId, view: View) -> None:
        for robot in view.robots.values():
            if robot.robot.instructions:
                message = self._telling.to_tell(robot.robot, robot.report, self._now_ms)
                if message is not None:
                    self._link.tell(scene, message)

    def _act(self, scene: SceneId, view: View) -> None:
        told = self._paces[scene].told
        for name, robot in view.robots.items():
            message: Cancel | Act | None = None
            in_service = robot.robot.online and not robot.robot.config.disabled
            if in_service and not view.scene.disabled:
                message = due_cancel(view, robot) or due_action(view, robot, self._now_ms)
            if message is None:
                told.pop(name, None)
                continue
            what = f"{type(message).__name__} {message.id}"
            before = told.get(name)
            if before is None or before[0] != what or self._now_ms - before[1] >= RETELL_MS:
                told[name] = (what, self._now_ms)
                self._link.tell(scene, message)

    def _steer(self, scene: SceneId, site: Site, view: View) -> None:
        paused = view.scene.disabled or view.scene.config.traffic_paused
        wanted = {} if paused else goals(view)
        busy = {
            name
            for name, robot in view.robots.items()
            if stopped(robot) is not None or is_busy(view, robot)
        }
        loading = {name for name, robot in view.robots.items() if takes_load(view, robot)}
        for message in site.steer(self._now_ms, wanted, busy, loading):
            self._link.tell(scene, message)
        for order in site.tell_devices(self._now_ms):
            self._devices.tell(scene, order)
        states = site.devices.to_show(self._now_ms)
        if states is not None:
            self._devices.show(scene, states)
        pace = self._paces[scene]
        if self._now_ms - pace.plans_ms >= PLANS_MS:
            pace.plans_ms = self._now_ms
            self._show(scene, pace, site.take_plans(self._now_ms))
            if pace.shown_ms == self._now_ms:
                site.sum_up(self._now_ms)
            if pace.whole_ms == self._now_ms:
                self._counted(site.tally.counts(scene, self._now_ms))

    def _show(self, scene: SceneId, pace: Pace, plans: Sequence[Plan]) -> None:
        """Tell those who look on what has changed, and now and then everything."""
        if self._now_ms - pace.shown_ms < SHOW_MS:
            return
        pace.shown_ms = self._now_ms
        whole = self._now_ms - pace.whole_ms >= SHOW_WHOLE_MS
        if whole:
            pace.whole_ms = self._now_ms
        shown, pace.shown = pace.shown, {plan.robot: plan for plan in plans}
        news = [plan for plan in plans if whole or _differs(shown.get(plan.robot), plan)]
        if news:
            self._plans(scene, news)


def _differs(shown: Plan | None, plan: Plan) -> bool:
    return shown is None or msgspec.structs.replace(shown, at_ms=plan.at_ms) != plan
