"""Who has somewhere to go and does not get nearer: the third rung of the liveness ladder.

A robot that waits for what will end by itself is left in peace: for a dead end to empty, or for
somebody who works where it wants to be. It is looked at only once even that has taken too long.
"""

import msgspec

from scheduler.traffic.costs import INFINITE
from scheduler.traffic.pibt import Agent, World, has_token

# Without progress for so long a robot is stuck. Robots that are pushed aside on busy floors are
# on their way again within 20 s nearly always (measured: lattices and aisles, design notes §11).
STALL_MS = 30_000
PATIENT_MS = 120_000  # and one that waits for others' work after so long
NEARER_S = 0.1  # of driving; less is no progress


class _Best(msgspec.Struct, kw_only=True):
    goal: int
    left_s: float
    since_ms: int


class Stalls:
    """Remembers when each robot last got nearer to where it is to go. Pure: time comes in."""

    def __init__(self) -> None:
        self._best: dict[str, _Best] = {}

    def look(self, world: World, now_ms: int) -> list[int]:
        """Numbers of the agents that are stuck, the first in rank first."""
        found: list[int] = []
        known: dict[str, _Best] = {}
        for k, agent in enumerate(world.agents):
            if agent.goal is None or agent.goal == agent.place or agent.fixed:
                continue
            best = known[agent.name] = self._progress(agent, agent.goal, now_ms)
            stands_ms = now_ms - best.since_ms
            if stands_ms < STALL_MS:
                continue
            if stands_ms >= PATIENT_MS or not is_patient(world, agent):
                found.append(k)
        self._best = known
        return found

    def since_ms(self, name: str) -> int | None:
        """When a robot last got nearer to its goal; None = it has none to get nearer to."""
        best = self._best.get(name)
        return None if best is None else best.since_ms

    def _progress(self, agent: Agent, goal: int, now_ms: int) -> _Best:
        left_s = agent.costs.cost_s(agent.place, agent.heading_rad, goal)
        best = self._best.get(agent.name)
        if best is None or best.goal != goal or left_s < best.left_s - NEARER_S:
            return _Best(goal=goal, left_s=left_s, since_ms=now_ms)
        if left_s < INFINITE and best.left_s == INFINITE:
            best.left_s = left_s
        return best


def is_patient(world: World, agent: Agent) -> bool:
    """Does it wait for somebody who works on its goal, or for a dead end to empty."""
    goal, roadmap = agent.goal, world.roadmap
    assert goal is not None
    kept = roadmap.places.conflict[goal] | 1 << goal
    if any(other.fixed and kept >> other.place & 1 for other in world.agents):
        return True
    pocket = roadmap.pockets.pocket[goal]
    if pocket < 0 or roadmap.pockets.pocket[agent.place] == pocket:
        return False
    inside = [
        other.place if other.goal is None else other.goal
        for other in world.agents
        if roadmap.pockets.pocket[other.place] == pocket
    ]
    return not has_token(roadmap, pocket, goal, inside)
