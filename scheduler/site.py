"""One scene at work: its roads, its robots' newest reports, and what there is to remember."""

from collections import Counter
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from operator import is_

from ledger.ids import PointName, RobotName
from ledger.link import Drive, Plan, Report, TellRoute, ToDevice
from ledger.proposals import AnyProposal, GrantMapResources
from ledger.scene import Scene
from ledger.state import Fleet, Order, Robot
from scheduler.corridors import find_corridors
from scheduler.current import current
from scheduler.devices import SiteDevices
from scheduler.goal import Goal
from scheduler.places import Place, find_places
from scheduler.resources import Reservations
from scheduler.roads import TrafficFactory, TrafficLike
from scheduler.tally import Tally
from scheduler.traffic.classes import carries
from scheduler.view import RobotView, View
from scheduler.waiting import Waiting
from scheduler.watch import Watch, has_moved, watched
from scheduler.watchman import Watchman

REPORTS_QUEUED_MAX = 16  # of one robot between two ticks
GATHER_MS = 10_000  # robots that have not spoken for so long after our start are not waited for


class Site:
    """Who is where; asks and feeds the traffic of each area."""

    def __init__(
        self,
        scene: Scene,
        traffic: TrafficFactory,
        now_ms: int,
        last: Mapping[RobotName, tuple[Report, Plan]] = {},
    ) -> None:
        """`last`: what a scheduler before this one knew of the robots."""
        self.scene = scene
        self.waiting = Waiting(scene.config.dispatch_sort)
        self.reports: dict[RobotName, Report] = {}
        self.plans: dict[RobotName, Plan] = {}
        self.changed = True  # something happened that dispatch should look at
        self.devices = SiteDevices(now_ms)
        self.tally = Tally(now_ms)
        self._factory = traffic
        self._last = dict(last)
        self._since_ms = now_ms
        self._queues: dict[RobotName, list[Report]] = {}
        self._watches: dict[RobotName, Watch] = {}
        self._memo: dict[RobotName, tuple[tuple[object, ...], RobotView]] = {}  # and what it is of
        self._broken_doors: frozenset[str] = frozenset()
        self._resets: set[RobotName] = set()  # asked for, and not done yet
        self._loading: AbstractSet[RobotName] = frozenset()
        self._watchman = Watchman()
        self.build(scene)

    def build(self, scene: Scene) -> None:
        """Lay the roads of a new map; robots are placed again from their newest reports."""
        self.scene = scene
        self.places: dict[str, Place] = find_places(scene)
        self.corridors = find_corridors(scene)
        self.traffic: dict[int, TrafficLike] = {
            area.id: self._factory(scene.id, area, scene.groups)
            for area in sorted(scene.areas, key=lambda a: a.id)
            if not area.disabled
        }
        for traffic in self.traffic.values():
            traffic.lay_doors(scene.doors)
        self._expected: dict[RobotName, frozenset[int]] = {}  # areas whose traffic knows of it
        self._groups: dict[RobotName, int] = {}  # as those areas know it
        self._lost: set[RobotName] = set()
        self._settled: set[int] = set()  # areas whose traffic has been ready once
        self._reservations = Reservations()  # of which the new traffic knows nothing
        self.claims_changed = True
        self.plans.clear()
        for name, report in self.reports.items():
            self._queues.setdefault(name, []).append(report)
        self.changed = True
        self._tune()

    def configure(self, scene: Scene) -> None:
        """Take the scene on with other settings, or in another state; its map is the same."""
        before, self.scene = self.scene, scene
        if scene.config != before.config:
            self._tune()
        self.changed = True

    def _tune(self) -> None:
        for traffic in self.traffic.values():
            traffic.tune(self.scene.config)

    def reset(self, name: RobotName) -> None:
        """Have traffic forget the robot and place it anew, as soon as it is there to be asked."""
        self._resets.add(name)

    def hear(self, report: Report) -> None:
        """Queue a report for the next tick. Old ones give way, but none that tells a route."""
        newest = self.reports.get(report.robot)
        same = newest is not None and newest.session == report.session
        if newest is not None and same and report.number <= newest.number:
            return  # came late
        self.reports[report.robot] = report
        queue = self._queues.setdefault(report.robot, [])
        if queue and (queue[-1].route is None or len(queue) >= REPORTS_QUEUED_MAX):
            queue[-1] = report
        else:
            queue.append(report)

    def take_in(self, robots: Sequence[Robot], now_ms: int) -> None:
        """Bring the traffic up to date with robots and reports."""
        gathering = now_ms - self._since_ms < GATHER_MS
        for robot in robots:
            self._take_in(robot, now_ms, gathering=gathering)
        for name in sorted(self.reports.keys() - {robot.name for robot in robots}):
            self.forget(name)  # strangers report too

    def _take_in(self, robot: Robot, now_ms: int, *, gathering: bool) -> None:
        name, group = robot.name, robot.config.group
        newest = self.reports.get(name)
        if newest is None:
            wait = not robot.config.disabled and (robot.online or gathering)
            self._await(name, group, wait=wait)
            return
        queue = self._queues.pop(name, [])
        in_service = robot.online and not robot.config.disabled
        if self._must_be_placed_anew(name, group, in_service=in_service):
            self._expect(name, group, frozenset())
            queue = queue or [newest]
        if not in_service and name in self._lost and not self._is_news(queue):
            return
        for report in queue:
            self._watches[name] = watched(self._watches.get(name), report, now_ms)
            self._expect(name, group, frozenset({report.area} & self.traffic.keys()))
            self._load(name, carries(robot, report))
            self._observe(report)
        if not queue:
            self._load(name, carries(robot, newest))
        if in_service:
            if name in self._lost and not queue:
                self._observe(newest)  # back, and nothing heard since
            self._lost.discard(name)
        elif queue or name not in self._lost:  # it still stands there, and no one else may
            self._lose(name)

    def _await(self, name: RobotName, group: int, *, wait: bool) -> None:
        """A robot that has not been heard since our start may be anywhere, or where it was last."""
        last = self._last.get(name)
        if last is None or last[0].area not in self.traffic:
            self._expect(name, group, frozenset(self.traffic) if wait else frozenset())
            return
        report, plan = last
        self._expect(name, group, frozenset({report.area}))
        self.traffic[report.area].remember(plan)
        if not wait and name not in self._lost:
            self._lose(name)

    def _must_be_placed_anew(self, name: RobotName, group: int, *, in_service: bool) -> bool:
        """Another group is another shape. One that does not answer keeps its ground until it does:
        nobody else could tell where it is, or what of its route it still has.
        """
        other_shape = self._groups.get(name, group) != group
        if not in_service or not (other_shape or name in self._resets):
            return False
        self._resets.discard(name)
        return True

    def _is_news(self, queue: list[Report]) -> bool:
        """Tell whether a robot out of service has moved, or says what traffic asked for.

        Each report would have the whole area planned anew.
        """
        watch = self._watches.get(queue[-1].robot) if queue else None
        if watch is None:
            return bool(queue)
        return has_moved(watch, queue[-1]) or any(report.route is not None for report in queue)

    def _load(self, name: RobotName, loaded: bool) -> None:
        for area in self._expected.get(name, ()):
            self.traffic[area].load(name, loaded=loaded or name in self._loading)

    def _observe(self, report: Report) -> None:
        traffic = self.traffic.get(report.area)
        if traffic is not None:
            traffic.observe(report)

    def _lose(self, name: RobotName) -> None:
        self._lost.add(name)
        for area in sorted(self._expected.get(name, frozenset())):
            self.traffic[area].lost(name)

    def _expect(self, name: RobotName, group: int, areas: frozenset[int]) -> None:
        """Have exactly these areas know of the robot."""
        before = self._expected.get(name, frozenset())
        if areas == before:
            return
        for area in sorted(before - areas):
            self.traffic[area].remove(name)
        for area in sorted(areas - before):
            self.traffic[area].add(name, group)
        if areas:
            self._expected[name], self._groups[name] = areas, group
        else:
            del self._expected[name]
            del self._groups[name]

    def forget(self, name: RobotName) -> None:
        """Drop all that is known of a robot that is not of this scene any more."""
        self._expect(name, 0, frozenset())
        self._lost.discard(name)
        self._resets.discard(name)
        self._last.pop(name, None)
        for memory in (self.reports, self._queues, self._watches, self._memo, self.plans):
            memory.pop(name, None)

    def view(
        self,
        fleet: Fleet,
        robots: Sequence[Robot],
        waiting: Sequence[Order] = (),
        *,
        reallocate: bool = False,
    ) -> View:
        """Show the scene as it is now to the dispatch phases."""
        self._settled.update(area for area, traffic in self.traffic.items() if traffic.ready)
        return View(
            scene=self.scene,
            places=self.places,
            corridors=self.corridors,
            robots={robot.name: self._robot(fleet, robot) for robot in robots},
            waiting=waiting,
            roads=self,
            broken_doors=self._broken_doors,
            reallocate=reallocate,
        )

    def _robot(self, fleet: Fleet, robot: Robot) -> RobotView:
        """Look at it anew only if something has come in; a pass looks twice."""
        name = robot.name
        orders = tuple([fleet.orders[o] for o in robot.orders if o in fleet.orders])
        report, plan, watch = self.reports.get(name), self.plans.get(name), self._watches.get(name)
        settled = report is not None and report.area in self._settled
        seen = robot, report, plan, watch, settled, *orders
        memo = self._memo.get(name)
        if memo is not None and _identical(memo[0], seen):
            return memo[1]
        known = memo is not None and _identical(memo[1].orders, orders)
        found = RobotView(
            name=name,
            robot=robot,
            orders=orders,
            at=memo[1].at if memo is not None and known else current(orders),
            report=report,
            ready=settled and plan is not None and plan.ready,
            blocked_by=() if plan is None else plan.blocked_by,
            still_since_ms=self._since_ms if watch is None else watch.still_since_ms,
            charging_since_ms=None if watch is None else watch.charging_since_ms,
        )
        self._memo[name] = seen, found
        return found

    def _traffic_of(self, robot: RobotName) -> TrafficLike | None:
        plan, report = self.plans.get(robot), self.reports.get(robot)
        if plan is None or not plan.ready or report is None:
            return None
        return self.traffic.get(report.area)

    def stands_at(self, robot: RobotName, point: PointName) -> bool:
        """Ask the traffic of the robot's area; a robot that is not placed stands nowhere."""
        traffic = self._traffic_of(robot)
        return traffic is not None and traffic.stands_at(robot, point)

    def cost_s(self, robot: RobotName, point: PointName) -> float:
        """Ask the traffic of the robot's area."""
        traffic = self._traffic_of(robot)
        return float("inf") if traffic is None else traffic.cost_s(robot, point)

    def reserved(self, robot: RobotName, point: PointName) -> tuple[str, ...]:
        """Ask the traffic of the robot's area."""
        traffic = self._traffic_of(robot)
        return () if traffic is None else traffic.reserved(robot, point)

    def has_room(self, robot: RobotName) -> bool:
        """Ask the traffic of the robot's area."""
        traffic = self._traffic_of(robot)
        return traffic is not None and traffic.has_room(robot)

    @property
    def is_awaited(self) -> bool:
        """Whether a reservation has not been granted yet."""
        return self._reservations.pending

    def reserve(
        self, fleet: Fleet, robots: Sequence[Robot], now_ms: int
    ) -> list[GrantMapResources]:
        """Have traffic keep reserved ground free; gives what it has got since.

        What is only asked for has time until all robots have spoken, those out of service too:
        one of them may stand there.
        """
        if self.claims_changed:
            heard = all(robot.name in self.reports for robot in robots)
            gathered = heard or now_ms - self._since_ms >= GATHER_MS
            self.claims_changed = not gathered
            claims = [c for c in fleet.claims.values() if c.scene == self.scene.id]
            claims = [c for c in claims if c.granted or gathered]
            self._reservations.follow(claims, self.scene.areas, self.traffic)
        return self._reservations.due(self.scene.id, self.traffic)

    def judge(self, robots: Sequence[Robot], now_ms: int) -> list[AnyProposal]:
        """Stop whom the guard of traffic will not have drive on; let them go when it is over."""
        return self._watchman.look(self.scene.id, robots, self.reports, self.traffic, now_ms)

    def steer(
        self,
        now_ms: int,
        goals: Mapping[RobotName, Goal],
        busy: AbstractSet[RobotName],
        loading: AbstractSet[RobotName] = frozenset(),
    ) -> list[Drive | TellRoute]:
        """Let every area's traffic move its robots; `loading` are about to take a load."""
        self._loading = loading
        for name in sorted(loading):
            self._load(name, True)
        messages: list[Drive | TellRoute] = []
        doors = self.devices.doors(self.scene, now_ms) if self.scene.doors else {}
        for area, traffic in self.traffic.items():
            if doors:
                traffic.follow_doors(doors)
                self._broken_doors = frozenset(
                    door.name for door in self.scene.doors if not doors[door.id].works
                )
            here = {name for name, areas in self._expected.items() if area in areas}
            mine = {name: goal for name, goal in goals.items() if name in here}
            messages.extend(traffic.step(now_ms, mine, frozenset(busy & here)))
        return messages

    def tell_devices(self, now_ms: int) -> list[ToDevice]:
        """Say what doors and lifts are to be told, after `steer`."""
        if not (self.scene.doors or self.scene.lifts):
            return []
        wanted: dict[int, tuple[RobotName, ...]] = {}
        for traffic in self.traffic.values():
            wanted.update(traffic.wanted_doors())
        waited_for = self.traffic.keys() - self._settled
        settled = frozenset(area.id for area in self.scene.areas if area.id not in waited_for)
        return self.devices.tell(self.scene, wanted, settled, now_ms)

    def take_plans(self, now_ms: int) -> list[Plan]:
        """Ask what traffic intends; it also says which robots it can move."""
        plans = [
            self._watchman.alarmed(plan)
            for traffic in self.traffic.values()
            for plan in traffic.plans(now_ms)
        ]
        self.plans = {plan.robot: plan for plan in plans}
        return plans

    def sum_up(self, now_ms: int) -> None:
        """Add who waits now, and what traffic has counted, to the sums."""
        waits = (plan.wait for plan in self.plans.values())
        self.tally.take((wait for wait in waits if wait is not None), now_ms)
        plannings: Counter[str] = Counter()
        ladder: Counter[str] = Counter()
        for traffic in self.traffic.values():
            plannings.update(traffic.plannings)
            ladder.update(traffic.ladder)
        every = self.traffic.values()
        breaches = sum(traffic.breaches_so_far for traffic in every)
        self.tally.count(sum(t.pushes for t in every), plannings, ladder, breaches)


def _identical(before: tuple[object, ...], now: tuple[object, ...]) -> bool:
    return len(before) == len(now) and all(map(is_, before, now))
