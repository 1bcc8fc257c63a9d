"""The liveness ladder of one area: who is stuck is looked for a way, and if there is none, a person
is told who and what is in the way. Never a silent hang.

Guidance and pushing are the planner's. What comes here is what they left: the first in rank of
those without progress gets a complete search over the robots around it, more of them each time.
Its way is then followed, with everybody else planned around it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from typing import TypeAlias

import msgspec

from ledger.ids import PointName, RobotName
from ledger.link import Mark
from ledger.scene import Value
from scheduler.traffic.costs import INFINITE
from scheduler.traffic.halts import Halts
from scheduler.traffic.lacam import Search
from scheduler.traffic.planner import Planner, Proposal
from scheduler.traffic.region import REGIONS, needs_of_way, region, search, until_nearer, way
from scheduler.traffic.rescue import Rescue
from scheduler.traffic.stalls import STALL_MS, Stalls
from scheduler.traffic.track import Track
from scheduler.traffic.world import World, in_way, standing_still

LOOK_MS = 1_000  # between two looks at all robots, and so between two searches
LOOKED_AT_MAX = 8  # of those that are stuck, the first in rank, at one time
# Who is not the first in rank around it waits for those that are. 40 robots with faults on lattices
# did 2.8 % less than with 120 s, and stood 44 s without a cause, not 103; 30 s cost a quarter.
OTHERS_MS = 60_000
# And between two for the same robot, twice as long after each in vain: 40 robots on a lattice with
# faults spent half of all time on them.
RETRY_MS, RETRY_MS_MAX = 10_000, 40_000
LONG_WAY = 300  # moves looked at for who stands in the way for good
NAMED_MAX = 8  # robots named in one alarm
# So long after a way was first looked for in vain a person is told; what stands in the way may
# have moved by then. Who only works there is given the time for that.
ALARM_MS = 30_000
WORKING_MS = 120_000
IN_WAY = "stands in the way and cannot be sent away"


class Stuck(Value, frozen=True, kw_only=True):
    """A robot that cannot get to its goal, and what a person has to know to help it."""

    robot: RobotName
    since_ms: int  # without progress
    text: str
    goal: PointName | None = None
    robots: tuple[RobotName, ...] = ()  # in its way, or with it in a jam
    claims: tuple[str, ...] = ()  # owners of reserved ground and doors, as `Track.barred` has them


# Who or what keeps a robot from the next ground of its committed route.
Blockers: TypeAlias = Callable[[Track], Sequence[str]]


class _Vain(msgspec.Struct, kw_only=True):
    """What the last search for a robot came to."""

    goal: int
    first_ms: int  # of the searches for this goal
    last_ms: int
    retry_ms: int
    working: bool
    stuck: Stuck


class Counted(msgspec.Struct, kw_only=True):
    """For metrics, since the start."""

    searches: int = 0
    rescues: int = 0
    alarms: int = 0

    def words(self) -> dict[str, int]:
        """As they are told."""
        return {"searches": self.searches, "rescues": self.rescues, "alarms": self.alarms}


class Ladder:
    """Stands between the world and the planner. Deterministic, and pure but for its memory."""

    def __init__(self) -> None:
        self.counted = Counted()
        self._stalls, self._halts = Stalls(), Halts()
        self._rescue: Rescue | None = None
        self._vain: dict[str, _Vain] = {}
        self._told: frozenset[RobotName] = frozenset()
        self._look_ms = 0
        self._roots: dict[RobotName, tuple[Mark, int]] = {}  # how far, and since when no further

    def propose(
        self,
        world: World,
        tracks: Mapping[RobotName, Track],
        blockers: Blockers,
        planner: Planner,
        now_ms: int,
    ) -> Proposal:
        """What the planner says, after what is left of the way of who was stuck."""
        lost = {track.name for track in tracks.values() if track.lost}
        if self._rescue is not None and not self._rescue.holds(world, lost, now_ms):
            self._rescue = None
        if now_ms >= self._look_ms:
            self._look_ms = now_ms + LOOK_MS
            self._look_round(world, tracks, blockers, lost, now_ms)
        rescue = self._rescue
        if rescue is None:
            return planner.propose(world)
        near = {track.name for track in tracks.values() if track.near}
        due = rescue.due(world, near)
        return due + planner.propose(rescue.shielded(world))

    @property
    def excused(self) -> Set[str]:
        """Robots on a way that is known to lead out."""
        return set() if self._rescue is None else self._rescue.robots()

    def _look_round(
        self,
        world: World,
        tracks: Mapping[RobotName, Track],
        blockers: Blockers,
        lost: Set[RobotName],
        now_ms: int,
    ) -> None:
        left = {t.name: t.way_m - t.way_to_m(t.progress) for t in tracks.values() if not t.driven}
        stalled = self._stalls.look(world, lost, left, now_ms)
        halted = self._halts.look(tracks.values(), now_ms)
        names = {world.agents[k].name for k in stalled}
        names |= self._note_barred(world, tracks, now_ms)
        self._vain = {name: vain for name, vain in self._vain.items() if name in names}
        if not stalled:
            self._roots.clear()
        elif self._rescue is None:
            self._rescue = self._look(world, tracks, blockers, stalled, halted, now_ms)

    def note(self, committed: Iterable[str], now_ms: int) -> None:
        """Learn which of the proposed moves have been committed."""
        if self._rescue is not None:
            self._rescue.note(committed, now_ms)

    def stuck(self, tracks: Mapping[RobotName, Track], now_ms: int) -> dict[RobotName, Stuck]:
        """Those that a person has to help, until they get on."""
        found: dict[RobotName, Stuck] = {}
        for name, vain in self._vain.items():
            waited_ms = now_ms - vain.first_ms
            track = tracks.get(RobotName(name))
            if track is not None and waited_ms >= (WORKING_MS if vain.working else ALARM_MS):
                found[track.name] = vain.stuck
        told = frozenset(found)
        self.counted.alarms += len(told - self._told)
        self._told = told
        return found

    # -- looking for a way

    def _look(
        self,
        world: World,
        tracks: Mapping[RobotName, Track],
        blockers: Blockers,
        stalled: Sequence[int],
        halted: Set[RobotName],
        now_ms: int,
    ) -> Rescue | None:
        """Search for the first of them that has not been searched for in vain just now."""
        for k in stalled[:LOOKED_AT_MAX]:
            agent = world.agents[k]
            vain = self._vain.get(agent.name)
            known = vain is not None and vain.goal == agent.goal
            if vain is not None and known and now_ms - vain.last_ms < vain.retry_ms:
                continue
            assert agent.goal is not None
            track = tracks[RobotName(agent.name)]
            if not track.near or agent.place == agent.goal:  # it has a way, and cannot drive it
                why = self._held_up(tracks, track, blockers, now_ms)
                if why is not None:
                    self._note_vain(agent.name, agent.goal, why, world, now_ms)
                if why is not None or agent.place == agent.goal or track.name in halted:
                    continue  # else it drives, if only to and fro
            around_them = standing_still(world, halted - {agent.name})
            nearest = region(around_them, k)
            since_ms = self._stalls.since_ms(agent.name) or now_ms
            if now_ms - since_ms < OTHERS_MS and _gives_way(world, k, nearest, stalled):
                continue
            self.counted.searches += 1
            found, proven, around = search(around_them, nearest)
            if found is not None:
                self.counted.rescues += 1
                self._vain.pop(agent.name, None)
                short = until_nearer(world, agent, found, self._stalls.least_s(agent.name))
                return Rescue(robot=agent.name, goal=agent.goal, way=short, since_ms=now_ms)
            why = _why(around_them, tracks, k, around, proven=proven)
            again_ms = 2 * vain.retry_ms if vain is not None and known else RETRY_MS
            self._note_vain(agent.name, agent.goal, why, world, now_ms, again_ms)
            return None
        return None

    def _note_barred(
        self, world: World, tracks: Mapping[RobotName, Track], now_ms: int
    ) -> set[str]:
        """Robots whose goal is on ground that is closed to them have nowhere to go until then."""
        found: set[str] = set()
        for track in tracks.values():
            if track.barred and track.goal not in (None, track.place):
                assert track.goal is not None
                why = _Why(
                    text=f"kept off by {', '.join(track.barred)}",
                    claims=track.barred,
                    working=True,
                )
                self._note_vain(track.name, track.goal, why, world, now_ms)
                found.add(track.name)
        return found

    def _held_up(
        self,
        tracks: Mapping[RobotName, Track],
        track: Track,
        blockers: Blockers,
        now_ms: int,
    ) -> "_Why | None":
        """Follow who waits for whom to the one that nobody holds up; None = it drives."""
        seen = [track.name]
        while len(seen) <= len(tracks):
            others = [name for name in blockers(track) if name not in seen]
            robots = [RobotName(name) for name in others if name in tracks]
            if others and not robots:
                text = f"kept off by {', '.join(others)}"
                return _Why(text=text, claims=tuple(others), working=True)
            silent = tuple(name for name in robots if tracks[name].lost)
            if silent:
                text = f"{', '.join(silent)} does not answer and holds ground on the way"
                return _Why(text=text, robots=silent)
            if not robots:
                break
            track = tracks[robots[0]]
            seen.append(track.name)
        mark, since_ms = self._roots.get(track.name, (track.progress, now_ms))
        if mark != track.progress:
            since_ms = now_ms
        self._roots[track.name] = track.progress, since_ms
        if now_ms - since_ms < STALL_MS:
            return None
        why = IN_WAY if track.driven else "has leave to drive and does not"
        text = f"{track.name} {why}"
        return _Why(text=text, robots=(track.name,), working=True)

    def _note_vain(
        self, name: str, goal: int, why: "_Why", world: World, now_ms: int, retry_ms: int = RETRY_MS
    ) -> None:
        before = self._vain.get(name)
        point = world.roadmap.net.points[world.roadmap.places.point[goal]].name
        known = before is not None and before.goal == goal
        first_ms = before.first_ms if before is not None and known else now_ms
        stuck = Stuck(
            robot=RobotName(name),
            since_ms=self._stalls.since_ms(name) or first_ms,
            goal=point,
            text=f"{name} cannot get to {point}: {why.text}",
            robots=why.robots,
            claims=why.claims,
        )
        self._vain[name] = _Vain(
            goal=goal,
            first_ms=first_ms,
            last_ms=now_ms,
            retry_ms=min(retry_ms, RETRY_MS_MAX),
            working=why.working,
            stuck=stuck,
        )


def _gives_way(world: World, k: int, nearest: list[int], stalled: Sequence[int]) -> bool:
    """Is there somebody around who comes before agent k, and gets on."""
    agents = world.agents
    return any(n < k and n not in stalled and agents[n].goal is not None for n in nearest)


class _Why(msgspec.Struct, frozen=True, kw_only=True):
    text: str
    robots: tuple[RobotName, ...] = ()
    claims: tuple[str, ...] = ()
    working: bool = False  # who stands in the way goes on by itself when its work is done


def _why(
    world: World, tracks: Mapping[RobotName, Track], k: int, around: list[int], *, proven: bool
) -> _Why:
    """Why there is no way for agent k, the plainest reason first."""
    agent = world.agents[k]
    assert agent.goal is not None
    if agent.costs.cost_s(agent.place, agent.heading_rad, agent.goal) == INFINITE:
        return _Why(text="the map has no way there")
    fixed = [n for n, other in enumerate(world.agents) if other.fixed]
    lost = {track.name for track in tracks.values() if track.lost}
    alone = Search(_without(world, {k, *fixed}), [sum(n < k for n in fixed)]).run(REGIONS[-1][1])
    if alone.way is None and alone.proven:
        here = agent.place, agent.heading_rad
        needs = needs_of_way(world, agent, here, LONG_WAY)
        standing = [world.agents[n] for n in fixed if needs >> world.agents[n].place & 1]
        closing = [n for step in way(world, agent, here, LONG_WAY) for n in in_way(world, *step)]
        names = tuple(dict.fromkeys(map(RobotName, (*(o.name for o in standing), *closing))))
        silent = tuple(name for name in names if name in lost)
        if silent:
            text = f"{', '.join(silent[:NAMED_MAX])} does not answer and stands in the way"
            return _Why(text=text, robots=silent[:NAMED_MAX])
        if names:
            text = f"{', '.join(names[:NAMED_MAX])} {IN_WAY}"
            return _Why(text=text, robots=names[:NAMED_MAX], working=True)
        return _Why(text="ground on the way is taken by what is not on the map's points")
    names = tuple(RobotName(world.agents[n].name) for n in around if n != k)[:NAMED_MAX]
    word = "there is no way" if proven else "no way was found"
    jam = f"{word} round {', '.join(names)}"
    near_lost = tuple(sorted(lost))[:NAMED_MAX]
    if near_lost:
        jam += f", while {', '.join(near_lost)} does not answer"
    return _Why(text=jam, robots=names + near_lost)


def _without(world: World, kept: Set[int]) -> World:
    agents = [agent for n, agent in enumerate(world.agents) if n in kept]
    return msgspec.structs.replace(world, agents=agents)
