"""Who has somewhere to go and does not get nearer: the third rung of the liveness ladder.

A robot that waits for what will end by itself is left in peace: for a dead end to empty, or for
somebody who works where it wants to be. It is looked at only once even that has taken too long.
"""

from collections.abc import Mapping, Set

import msgspec

from ledger.ids import RobotName
from scheduler.traffic.costs import INFINITE
from scheduler.traffic.world import Agent, World, has_token

# Without progress for so long a robot is stuck. On busy floors robots are pushed aside, and a way
# out costs the others: with 30 s twenty robots in aisles did 604 orders an hour, and 673 without
# any; with 60 s 704, and 732, while the longest wait fell from 415 s to 259 s.
STALL_MS = 60_000
PATIENT_MS = 300_000  # and one that waits for others' work after so long
NEARER_S = 0.1  # of driving; less is no progress
COMMITTED_S = 1e6  # less is left than to any place, once the way to the goal is committed


class _Best(msgspec.Struct, kw_only=True):
    goal: int
    left_s: float
    since_ms: int


class Stalls:
    """Remembers when each robot last got nearer to where it is to go. Pure: time comes in."""

    def __init__(self) -> None:
        self._best: dict[str, _Best] = {}

    def look(
        self, world: World, lost: Set[RobotName], left: Mapping[RobotName, float], now_ms: int
    ) -> list[int]:
        """Numbers of the agents that are stuck, the first in rank first. `left` has what is still
        to be driven, in metres, of those whose committed moves lead to their goal.
        """
        late: list[int] = []
        known: dict[str, _Best] = {}
        for k, agent in enumerate(world.agents):
            name = RobotName(agent.name)
            committed = agent.goal == agent.place
            if agent.goal is None or name in lost or (committed and name not in left):
                continue
            if agent.fixed and not committed:
                continue
            left_s = (
                left[name] - COMMITTED_S
                if committed
                else agent.costs.cost_s(agent.place, agent.heading_rad, agent.goal)
            )
            best = known[name] = self._progress(name, agent.goal, left_s, now_ms)
            if now_ms - best.since_ms >= STALL_MS:
                late.append(k)
        self._best = known
        agents = world.agents
        hopeless = lost | {RobotName(agents[k].name) for k in late}
        hopeless |= {RobotName(a.name) for a in agents if a.goal is None and not a.fixed}
        return [
            k
            for k in late
            if now_ms - known[agents[k].name].since_ms >= PATIENT_MS
            or agents[k].goal == agents[k].place
            or not is_patient(world, agents[k], hopeless)
        ]

    def least_s(self, name: str) -> float:
        """The least that a robot ever had left to its goal."""
        best = self._best.get(name)
        return INFINITE if best is None else best.left_s

    def since_ms(self, name: str) -> int | None:
        """When a robot last got nearer to its goal; None = it has none to get nearer to."""
        best = self._best.get(name)
        return None if best is None else best.since_ms

    def _progress(self, name: str, goal: int, left_s: float, now_ms: int) -> _Best:
        best = self._best.get(name)
        if best is None or best.goal != goal or left_s < best.left_s - NEARER_S:
            return _Best(goal=goal, left_s=left_s, since_ms=now_ms)
        return best


def is_patient(world: World, agent: Agent, hopeless: Set[RobotName]) -> bool:
    """Does it wait for somebody who works on its goal, or for a dead end to empty, and can that be
    expected; of the hopeless it cannot.
    """
    goal, roadmap = agent.goal, world.roadmap
    assert goal is not None
    kept = roadmap.places.conflict[goal] | 1 << goal
    awaited = [other for other in world.agents if other.fixed and kept >> other.place & 1]
    pocket = roadmap.pockets.pocket[goal]
    if not awaited and pocket >= 0 and roadmap.pockets.pocket[agent.place] != pocket:
        for other in world.agents:
            wants = other.place if other.goal is None else other.goal
            inside = roadmap.pockets.pocket[other.place] == pocket
            if inside and not has_token(roadmap, pocket, goal, [wants]):
                awaited.append(other)
    return bool(awaited) and not any(RobotName(other.name) in hopeless for other in awaited)
