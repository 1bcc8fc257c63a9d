"""Who waits for whom in one area, and why: looked up in what traffic holds, deciding nothing.

A committed robot waits for who owns its next ground, or was promised it before. One that rests
waits for what kept the planner from its best move: who stands there, a dead end that has to empty,
or a move that was planned before its own and could not be committed yet.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from enum import StrEnum
from typing import TypeAlias

import msgspec

from ledger.ids import PathKey, PointName, RobotName
from ledger.link import DISPATCHER, DOOR, EXTERNAL, Mark, Report
from ledger.waits import Wait, WaitReason
from scheduler.traffic.costs import INFINITE
from scheduler.traffic.grants import Grants
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.track import ARRIVED_M, Track
from scheduler.traffic.world import World, has_token, in_way, room

__all__ = ["Wait", "WaitReason", "Waits"]

LOOK_MS = 400  # between two looks; they cost a twentieth of traffic if twice as often (measured)
WAIT_MS_MIN = 1_000  # robots stand for less at every turn
LATE_MS_MIN = 3_000  # between a grant and the first report of progress lie a few hundred
BLOCKERS_MAX = 4  # named in one wait
REACH_M = 0.1  # so near to its authority a robot stops
NEARER_S = 0.1


class Due(StrEnum):
    """What made planning due."""

    ROBOTS = "Robots"  # one has come, gone, or been placed anew
    PROGRESS = "Progress"  # one is near the end of its route, or has reached it
    LOST = "Lost"  # one does not answer, or does so again
    GOALS = "Goals"  # one is to go elsewhere, or begins or ends its work
    GROUND = "Ground"  # others have reserved some, or given it back
    DOORS = "Doors"  # one has begun or ceased to work
    PACE = "Pace"  # nothing, for long enough


_Why: TypeAlias = tuple[WaitReason, tuple[RobotName, ...], PointName | None]


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """What became of one proposal of a planner."""

    robot: RobotName
    place: int  # before it
    heading_rad: float
    need: int  # bits of the places that had to be empty
    committed: bool
    unsafe_with: tuple[str, ...] = ()  # it was not: with these it would wait in a ring for ever


class Floor(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that waits of one moment follow from."""

    grants: Grants
    tracks: Mapping[RobotName, Track]
    fixed: Collection[RobotName]  # work where they are, or cannot be moved
    doors: Callable[[Track], tuple[str, ...]]  # shut before a robot, named as in a plan
    world: World  # as the planner last saw it
    refused: Mapping[RobotName, Outcome] = {}  # proposed, and not committed


class Waits:
    """Remembers since when each robot stands, and who has been pushed by whom."""

    def __init__(self, roadmap: Roadmap) -> None:
        """Take the map, for the names of its points."""
        self._roadmap = roadmap
        self._ends: dict[PathKey, PointName] = {path.key: path.end for path in roadmap.net.paths}
        self._seen: dict[RobotName, Mark] = {}
        self._since_ms: dict[RobotName, tuple[bool, int]] = {}  # is it late, and since when
        self._pushed: dict[RobotName, tuple[RobotName, int]] = {}  # by whom, and when
        self.refused: dict[RobotName, Outcome] = {}
        self.pushes = 0
        self.plannings: dict[str, int] = {}  # by what made them due
        self._looked: tuple[int, dict[RobotName, Wait]] = (-LOOK_MS, {})

    def planned(self, due: Due) -> None:
        """Count a planning."""
        self.plannings[due.value] = self.plannings.get(due.value, 0) + 1

    def note(
        self, outcomes: Iterable[Outcome], tracks: Mapping[RobotName, Track], now_ms: int
    ) -> None:
        """Take in what became of a plan. Who left a place that a later move of the plan needs, and
        got no nearer to where it is to go itself, was pushed.
        """
        self.refused = {}
        left: dict[int, Outcome] = {}
        vacated = 0  # bits of them
        for outcome in outcomes:
            while hit := outcome.need & vacated:
                low = hit & -hit
                vacated ^= low
                gone = left[low.bit_length() - 1]
                if gone.robot != outcome.robot and _strayed(tracks[gone.robot], gone):
                    self._pushed[gone.robot] = outcome.robot, now_ms
                    self.pushes += 1
            if outcome.committed:
                self._pushed.pop(outcome.robot, None)
                left[outcome.place] = outcome
                vacated |= 1 << outcome.place
            else:
                self.refused[outcome.robot] = outcome

    def look(self, floor: Floor, now_ms: int) -> dict[RobotName, Wait]:
        """Say who waits now, or did a moment ago: no more often than it is shown."""
        if not 0 <= now_ms - self._looked[0] < LOOK_MS:
            self._looked = now_ms, self._look(floor, now_ms)
        return self._looked[1]

    def _look(self, floor: Floor, now_ms: int) -> dict[RobotName, Wait]:
        at = {track.place: name for name, track in floor.tracks.items() if track.place is not None}
        found: dict[RobotName, Wait] = {}
        stands: dict[RobotName, tuple[bool, int]] = {}
        for name, track in floor.tracks.items():
            pushed, moves = self._pushed.get(name), self._moves(name, track)
            if pushed is not None and not track.driven and (moves or _may_drive(track)):
                by, since_ms = pushed
                place = self._name(track.goal)
                found[name] = _wait(name, since_ms, (WaitReason.PUSHED, (by,), place))
                continue
            why = None if moves else self._why(track, floor, at)
            if why is None:
                continue
            late = why[0] is WaitReason.LATE
            since = self._since_ms.get(name)
            if since is None or since[0] != late:
                since = late, now_ms
            stands[name] = since
            if now_ms - since[1] >= (LATE_MS_MIN if late else WAIT_MS_MIN):
                found[name] = _wait(name, since[1], why)
        self._since_ms = stands
        self._forget(floor.tracks)
        return _of_concern(found, floor.tracks)

    def _forget(self, tracks: Mapping[RobotName, Track]) -> None:
        for name, (by, _) in tuple(self._pushed.items()):
            if name not in tracks or by not in tracks or tracks[name].driven:
                del self._pushed[name]
        for name in self._seen.keys() - tracks.keys():
            del self._seen[name]

    def _moves(self, name: RobotName, track: Track) -> bool:
        before = self._seen.get(name)
        self._seen[name] = track.progress
        if track.report is None or track.lost:
            return False
        return not track.standing or (before is not None and before != track.progress)

    def _name(self, place: int | None) -> PointName | None:
        if place is None:
            return None
        return self._roadmap.net.points[self._roadmap.places.point[place]].name

    # -- one robot

    def _why(self, track: Track, floor: Floor, at: Mapping[int, RobotName]) -> _Why | None:
        goal = self._name(track.goal)
        if track.lost:
            return WaitReason.NOT_ANSWERING, (), goal
        if not track.placed or track.place is None or track.trouble is not None:
            return WaitReason.NOT_PLACED, (), goal
        if track.report is not None and _stopped(track.report):
            return WaitReason.STOPPED, (), goal
        if not track.driven:
            return self._on_its_way(track, floor)
        if track.goal is not None and track.barred and track.goal != track.place:
            doors = tuple(RobotName(o) for o in track.barred if o.startswith(DOOR))
            others = tuple(RobotName(f"{EXTERNAL}{o}") for o in track.barred)
            return (
                (WaitReason.DOOR, doors, goal)
                if doors
                else (WaitReason.RESERVED_GROUND, others, goal)
            )
        if track.aim is None or track.aim == track.place:  # it is where it is to be
            aside = self._aside(track, floor, at)
            return (WaitReason.BEHIND_ROBOT, aside, None) if aside else None
        return self._at_rest(track, track.place, track.aim, floor, at)

    def _on_its_way(self, track: Track, floor: Floor) -> _Why | None:
        if _may_drive(track):
            return WaitReason.LATE, (), self._next(track)
        if not track.promised:
            return None
        slot = track.promised[0]
        doors = floor.doors(track)
        if doors:
            return WaitReason.DOOR, tuple(map(RobotName, doors)), self._next(track)
        names = dict.fromkeys(floor.grants.blockers(slot.cell, track.name, slot.commit))
        robots = [RobotName(name) for name in names if name in floor.tracks]
        if len(robots) < len(names):
            others = (f"{EXTERNAL}{name}" for name in names if name not in floor.tracks)
            return WaitReason.RESERVED_GROUND, tuple(map(RobotName, others)), self._next(track)
        if not robots:
            return None  # it is granted at the next step
        lost = tuple(name for name in robots if floor.tracks[name].lost)
        if lost:
            return WaitReason.ROBOT_LOST, lost, self._next(track)
        return WaitReason.BEHIND_ROBOT, tuple(robots), self._next(track)

    def _next(self, track: Track) -> PointName | None:
        """The end of the path that it cannot drive on."""
        number = track.progress.piece
        if track.promised and (end := track.promised[0].end) is not None:
            number = end.piece
        for piece, _ in track.pieces:
            if piece.number >= number and piece.path in self._ends:
                return self._ends[piece.path]
        return self._name(track.place)

    def _at_rest(
        self, track: Track, place: int, aim: int, floor: Floor, at: Mapping[int, RobotName]
    ) -> _Why | None:
        """What kept the planner from the best move of a robot."""
        ways = track.costs.candidates(place, track.heading_rad, aim)
        if not ways:
            return WaitReason.NO_WAY, (), self._name(aim)
        move = min(ways)[1]
        end = self._roadmap.moves.end[move]
        name = self._name(end)
        world = floor.world
        closing = tuple(map(RobotName, in_way(world, place, track.heading_rad, move)))
        if closing:
            lost = tuple(other for other in closing if floor.tracks[other].lost)
            reason = WaitReason.ROBOT_LOST if lost else WaitReason.ROBOT_FIXED
            return reason, lost or closing, name
        need = room(world, place, track.heading_rad, (move,), aim) & ~(1 << place)
        inside = _standing(need, at)
        fixed = tuple(other for other in inside if other in floor.fixed)
        holder = at.get(aim)
        if holder is not None and holder in floor.fixed and (holder in fixed or not inside):
            return WaitReason.GOAL_BUSY, (holder,), self._name(aim)
        if fixed:
            return WaitReason.ROBOT_FIXED, fixed, name
        waited = self._for_token(track, place, end, floor)
        if waited:
            return WaitReason.POCKET_TOKEN, waited, name
        aside = self._aside(track, floor, at)
        if aside:
            return WaitReason.BEHIND_ROBOT, aside, name if aside == inside else None
        if inside:
            return WaitReason.BEHIND_ROBOT, inside, name
        own = floor.refused.get(track.name)
        if own is not None and own.unsafe_with:
            return WaitReason.YIELDING, tuple(map(RobotName, own.unsafe_with)), name
        need |= 1 << place
        first = (n for n, other in floor.refused.items() if other.need & need and n != track.name)
        return WaitReason.YIELDING, tuple(first), name

    def _aside(
        self, track: Track, floor: Floor, at: Mapping[int, RobotName]
    ) -> tuple[RobotName, ...]:
        """Who stands where the planner would have it go, and if only to make way."""
        own = floor.refused.get(track.name)
        return () if own is None else _standing(own.need & ~(1 << own.place), at)

    def _for_token(self, track: Track, place: int, end: int, floor: Floor) -> tuple[RobotName, ...]:
        """Who has to leave the dead end that a move leads into, if it may not be entered."""
        pockets = self._roadmap.pockets.pocket
        pocket = pockets[end]
        if pocket < 0 or pocket == pockets[place]:
            return ()
        inside = {
            name: other.place if other.goal is None else other.goal
            for name, other in floor.tracks.items()
            if other.place is not None and pockets[other.place] == pocket
        }
        goals = [goal for goal in inside.values() if goal is not None]
        return () if has_token(self._roadmap, pocket, track.aim, goals) else tuple(inside)


def _wait(name: RobotName, since_ms: int, why: _Why) -> Wait:
    reason, blockers, place = why
    return Wait(
        robot=name,
        since_ms=since_ms,
        reason=reason,
        blockers=blockers[:BLOCKERS_MAX],
        place=place,
    )


def _of_concern(
    found: dict[RobotName, Wait], tracks: Mapping[RobotName, Track]
) -> dict[RobotName, Wait]:
    """Leave out robots that have nowhere to go and are in nobody's way."""
    blocking = {name for wait in found.values() for name in wait.blockers}

    def wants(track: Track) -> bool:
        return not track.driven or track.goal not in (None, track.place)

    return {
        name: wait
        for name, wait in found.items()
        if wait.blockers or name in blocking or wants(tracks[name])
    }


def _standing(places: int, at: Mapping[int, RobotName]) -> tuple[RobotName, ...]:
    """Who stands on these places, ascending by place."""
    found = []
    while places:
        low = places & -places
        places ^= low
        name = at.get(low.bit_length() - 1)
        if name is not None:
            found.append(name)
    return tuple(found)


def _strayed(track: Track, before: Outcome) -> bool:
    """Is a robot no nearer to where it is to go than it was."""
    if track.aim is None or track.place is None:
        return True
    costs = track.costs
    was_s = costs.cost_s(before.place, before.heading_rad, track.aim)
    is_s = costs.cost_s(track.place, track.heading_rad, track.aim)
    return is_s > was_s - NEARER_S and is_s < INFINITE


def _stopped(report: Report) -> bool:
    """Would it not drive if it were told to, by its own report."""
    stops = report.emergency_stop or report.soft_stop or report.paused or report.blocked
    return stops or report.controller != DISPATCHER


def _may_drive(track: Track) -> bool:
    """Has it been granted ground that it has not driven over."""
    here, until = track.progress, track.authority
    if until <= here:
        return False
    if track.way_to_m(until) - track.way_to_m(here) > REACH_M:
        return True
    for piece, _ in track.pieces:
        if piece.path is None and here.piece <= piece.number <= until.piece:
            turned = here.along_m if piece.number == here.piece else 0.0
            granted = until.along_m if piece.number == until.piece else piece.length_m
            if granted - turned > ARRIVED_M:
                return True
    return False
