"""What each robot wants and who comes first: ranks, patience, pockets (the planner's input).

Rules found necessary by simulation (design notes, traffic, rules 2 and 5-8): who is in a dead end
that is not its goal's outranks everybody, or it is pushed back in by the one that waits outside;
who waits for a dead end to empty, or for a place where somebody works, drops below all others but
keeps its age, or it sits on the mouth and locks the worker in; an idle robot in a dead end that
somebody wants to enter gets a goal outside.
"""

from collections.abc import Iterable, Mapping, Set
from typing import TypeAlias

from ledger.ids import RobotName
from scheduler.traffic.costs import INFINITE
from scheduler.traffic.pockets import DEEPER_M
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.track import Track
from scheduler.traffic.world import Agent, has_token

Rank: TypeAlias = tuple[int, int, str]

ARRIVED_GRACE_MS = 3_000  # who has reached its goal is not pushed before its work can begin
PATIENCE_MS = 10_000
IMPATIENCE_PER_S = 0.5  # added to the price of staying for each second without progress
IMPATIENCE_S_MAX = 30.0
NEARER_S = 0.1

LEAVING, BOUND, WAITING, IDLE = range(4)


def relocate(roadmap: Roadmap, tracks: Iterable[Track], fixed: Set[RobotName]) -> None:
    """Give idle robots in dead ends that somebody wants to enter a goal outside it."""
    pockets = roadmap.pockets
    known = [track for track in tracks if track.place is not None]
    wanted: dict[int, float] = {}  # pocket -> deepest goal of somebody outside
    for track in known:
        if track.goal is not None and not track.barred and pockets.pocket[track.goal] >= 0:
            pocket = pockets.pocket[track.goal]
            if track.place is not None and pockets.pocket[track.place] != pocket:
                depth = pockets.depth_m[track.goal]
                wanted[pocket] = max(depth, wanted.get(pocket, depth))
    taken = {place for t in known for place in (t.place, t.goal, t.relocation) if place is not None}
    for track in known:
        assert track.place is not None
        pocket = pockets.pocket[track.place]
        idle = (track.goal is None or track.barred) and track.name not in fixed
        in_way = pocket in wanted and pockets.depth_m[track.place] <= wanted[pocket] + DEEPER_M
        if not idle or pocket < 0 or not in_way:
            track.relocation = None
        elif track.relocation in (None, track.place):
            track.relocation = _elsewhere(roadmap, track, wanted[pocket] + DEEPER_M, taken)
            if track.relocation is not None:
                taken.add(track.relocation)


def _elsewhere(roadmap: Roadmap, track: Track, deep_m: float, taken: set[int]) -> int | None:
    """The nearest free stop outside any pocket, else outside this one, else deep in this one."""
    assert track.place is not None
    pockets, depth = roadmap.pockets.pocket, roadmap.pockets.depth_m
    best: tuple[int, float, int] | None = None
    for place in range(roadmap.places.stops):
        same = pockets[place] == pockets[track.place]
        if place in taken or (same and depth[place] <= deep_m):
            continue
        cost = track.costs.cost_s(track.place, track.heading_rad, place)
        found = (2 if same else int(pockets[place] >= 0), cost, place)
        if cost < INFINITE and (best is None or found < best):
            best = found
    return None if best is None else best[2]


def agents(
    roadmap: Roadmap,
    tracks: Iterable[Track],
    ranks: Mapping[RobotName, Rank],
    fixed: Set[RobotName],
    now_ms: int,
) -> list[Agent]:
    """The planner's agents in the order of their ranks."""
    known = [track for track in tracks if track.place is not None]
    held = {track.place: track.name for track in known if track.name in fixed}
    found: list[tuple[int, Rank, Agent]] = []
    for track in known:
        assert track.place is not None
        goal = track.aim
        agent = Agent(
            name=track.name,
            place=track.place,
            heading_rad=track.heading_rad,
            costs=track.costs,
            goal=goal,
            fixed=track.name in fixed or _keeps_place(track, now_ms),
            leaving=track.leaving,
        )
        standing = _class(roadmap, track, agent, known, held)
        if standing in (LEAVING, BOUND) and goal is not None:
            agent.impatience_s = _impatience_s(track, goal, now_ms)
        found.append((standing, ranks.get(track.name, (0, 0, track.name)), agent))
    found.sort(key=lambda item: (item[0], item[1], item[2].name))
    return [agent for _, _, agent in found]


def _keeps_place(track: Track, now_ms: int) -> bool:
    """Rolling to its own goal, or there since a moment ago."""
    if track.goal is None or track.place != track.goal:
        return False
    return track.arrived_ms is None or now_ms - track.arrived_ms < ARRIVED_GRACE_MS


def _class(
    roadmap: Roadmap,
    track: Track,
    agent: Agent,
    known: list[Track],
    held: Mapping[int | None, RobotName],
) -> int:
    pockets = roadmap.pockets.pocket
    if agent.goal is None:
        return IDLE
    if track.leaving:
        return LEAVING
    pocket = pockets[agent.place]
    if pocket >= 0 and pockets[agent.goal] != pocket:
        return LEAVING
    if held.get(agent.goal, track.name) != track.name:
        return WAITING
    wanted = pockets[agent.goal]
    if wanted >= 0 and pocket != wanted:
        inside = [
            other.place if other.goal is None else other.goal
            for other in known
            if other.place is not None and pockets[other.place] == wanted
        ]
        if not has_token(roadmap, wanted, agent.goal, inside) and _at_mouth(roadmap, agent, wanted):
            return WAITING
    return BOUND


def _at_mouth(roadmap: Roadmap, agent: Agent, pocket: int) -> bool:
    return any(
        roadmap.pockets.pocket[roadmap.moves.end[move]] == pocket
        for move in roadmap.leaving[agent.place]
    )


def _impatience_s(track: Track, goal: int, now_ms: int) -> float:
    """How much dearer staying has become since the robot last got nearer to its goal."""
    assert track.place is not None
    left = track.costs.cost_s(track.place, track.heading_rad, goal)
    if left < track.best_s - NEARER_S:
        track.best_s, track.best_ms = left, now_ms
    over_ms = now_ms - track.best_ms - PATIENCE_MS
    return min(max(over_ms, 0) / 1000 * IMPATIENCE_PER_S, IMPATIENCE_S_MAX)
