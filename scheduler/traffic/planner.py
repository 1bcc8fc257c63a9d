"""What every planner is to the rest of traffic: it looks at a world and proposes moves.

A planner commits nothing. `execution.py` admits what it proposes against the present state, so
planners differ in how fast robots get on, never in who may be where.
"""

from typing import Protocol, TypeAlias

from scheduler.traffic import pibt
from scheduler.traffic.world import World

# Robots and their next moves, in an order in which they could be driven one at a time.
Proposal: TypeAlias = list[tuple[str, tuple[int, ...]]]


class Planner(Protocol):
    """One of the traffic methods at work in one area."""

    looks_ahead: bool  # it needs `World.ahead`

    def propose(self, world: World) -> Proposal:
        """Say who should move where next; the same calls in the same order give the same."""


class Distributed:
    """TP1: PIBT from scratch at every call, with nothing to remember."""

    looks_ahead = False

    def propose(self, world: World) -> Proposal:
        """Ask PIBT."""
        return pibt.propose(world)
