"""TP2: routes for all robots for the next seconds, and the order in which they pass each other.

A plan stands, as an order of moves at the ground that they share, until a robot is later than a
tolerance, has another goal, or is somewhere else: then what is not committed of it is dropped and
planned anew. While there is no plan for everybody, PIBT proposes instead.
"""

from collections.abc import Callable
from typing import Generic, Protocol, TypeAlias, TypeVar

import msgspec

from scheduler.traffic import pibt
from scheduler.traffic.cbs import Search
from scheduler.traffic.costs import Costs
from scheduler.traffic.passing import Passing, passing
from scheduler.traffic.planner import Proposal
from scheduler.traffic.timetable import Timetable
from scheduler.traffic.windows import Planning
from scheduler.traffic.world import World

PLAN_MS_MIN = 500  # from one search to the next
PLAN_MS_MAX = 2_000  # a plan is not followed for longer
STATES_PER_MS = 6  # looked at in plain Python (measured: 5 on lattices, 12 in aisles)
BUDGET_MS_MAX = 500  # a plan that took longer finds the robots somewhere else
SHARE = 4  # of its time Venus plans a quarter at the most
# While a robot's patience is so far gone (40 s without progress) PIBT proposes, which pushes: a
# plan can have somebody wait for long (100 s in aisles). With 20 s PIBT did nearly all of it.
IMPATIENT_S = 15.0
COSTS_MAX = 64  # copies kept: one by group, and one for each robot that owns reserved ground

_T = TypeVar("_T")
_Out = TypeVar("_Out", covariant=True)


class Answer(Protocol[_Out]):
    """What a piece of work comes to, as `concurrent.futures.Future` has it."""

    def done(self) -> bool:
        """Is it there."""

    def result(self) -> _Out:
        """The answer; asked for only when it is there."""


class Think(Protocol):
    """Who does the searching: `at_once`, or a thread's `submit`."""

    def __call__(self, work: Callable[[], _T], /) -> Answer[_T]:
        """Begin, and give what will come of it."""


class _Now(Generic[_T]):
    def __init__(self, found: _T) -> None:
        self._found = found

    def done(self) -> bool:
        return True

    def result(self) -> _T:
        return self._found


def at_once(work: Callable[[], _T]) -> Answer[_T]:
    """Search where one stands: on virtual time, and in tests."""
    return _Now(work())


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """Of the scene; `cbsHighW` and `cbsLowW` bound how much dearer than the least a plan and a
    route may be.
    """

    high_w: float = 1.5
    low_w: float = 1.2
    interval_ms: int = 5_000


class Counted(msgspec.Struct, kw_only=True):
    """What planning has come to, for metrics and measurements."""

    plans: int = 0
    incomplete: int = 0  # of them, without a route for everybody
    proposals: int = 0
    by_pibt: int = 0  # of them


_Planned: TypeAlias = tuple[Passing | None, tuple[str, ...], int]  # and who failed, and the states


class Venus:
    """Follows one plan after the other."""

    looks_ahead = True

    def __init__(self, settings: Settings, think: Think = at_once) -> None:
        """Begin without a plan."""
        self.settings, self._think = settings, think
        self._times: Timetable | None = None
        self._costs: dict[int, tuple[Costs, Costs]] = {}
        self._passing: Passing | None = None
        self._thinking: Answer[_Planned] | None = None
        self._first: tuple[str, ...] = ()  # had no route the last time
        self._due_ms = 0  # for what does not fit any more
        self._old_ms = 0  # for what does
        self.counted = Counted()

    def propose(self, world: World) -> Proposal:
        """The next moves of the plan, or PIBT's while there is none for everybody."""
        self.counted.proposals += 1
        self._take(world)
        fresh = self._passing is not None and self._passing.follow(world)
        now_ms = world.now_ms
        due_ms = self._old_ms if fresh else self._due_ms
        if now_ms >= due_ms and self._thinking is None:
            interval_ms = self.settings.interval_ms
            self._due_ms = now_ms + min(PLAN_MS_MIN, interval_ms)
            self._old_ms = now_ms + min(PLAN_MS_MAX, interval_ms)
            self._thinking = self._think(self._work(world))
            self._take(world)
        stuck = any(agent.impatience_s >= IMPATIENT_S for agent in world.agents)
        if self._passing is None or stuck:
            self.counted.by_pibt += 1
            return pibt.propose(world)
        return self._passing.next(world)

    def _take(self, world: World) -> None:
        """Take a plan on that has come; what is stale of it is dropped robot by robot."""
        if self._thinking is None or not self._thinking.done():
            return
        self._passing, self._first, states = self._thinking.result()
        self._thinking = None
        self.counted.plans += 1
        self.counted.incomplete += self._passing is None
        pause_ms = max(PLAN_MS_MIN, SHARE * states // STATES_PER_MS)
        self._due_ms = world.now_ms + min(pause_ms, self.settings.interval_ms)
        self._old_ms = max(self._old_ms, self._due_ms)
        if self._passing is not None:
            self._passing.follow(world)

    def _work(self, world: World) -> Callable[[], _Planned]:
        """The search on a snapshot that nobody else touches."""
        if self._times is None:
            self._times = Timetable(world.roadmap)
        if len(self._costs) > COSTS_MAX:
            self._costs.clear()
        agents = [
            msgspec.structs.replace(agent, costs=self._own(agent.costs)) for agent in world.agents
        ]
        snapshot, times = msgspec.structs.replace(world, agents=agents), self._times
        settings, first = self.settings, self._first
        return lambda: _planned(snapshot, times, settings, first)

    def _own(self, costs: Costs) -> Costs:
        known = self._costs.get(id(costs))
        if known is None:
            known = self._costs[id(costs)] = (costs, costs.apart())
        return known[1]


def _planned(
    world: World, times: Timetable, settings: Settings, first: tuple[str, ...]
) -> _Planned:
    """A plan for everybody: one robot after the other, and by conflicts what that leaves."""
    budget = STATES_PER_MS * min(settings.interval_ms, BUDGET_MS_MAX)
    number = {agent.name: k for k, agent in enumerate(world.agents)}
    planning = Planning(world, world.ahead, times)
    window = planning.in_turn(
        [number[name] for name in first if name in number], settings.low_w, budget
    )
    failed = tuple(world.agents[k].name for k in window.failed)
    window = Search(planning, settings.high_w, settings.low_w).improve(window, budget)
    found = None if window.failed else passing(planning, window)
    return found, failed, planning.sipp.expanded
