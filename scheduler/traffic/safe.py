"""Is what a move leads to safe: can all that it makes wait for each other still be moved in some
order (`enablePrevent`; the banker's check, Dijkstra 1965, on stops).

Who rests where another one wants to drive is waited for; only robots that are waited for from the
end of the move, in a ring, need to be looked at. A ring in which nobody can move any more, because
a one-way lane has been filled up to its last stop, is not made; one that is there already is the
next rung's of the liveness ladder.
"""

from collections.abc import Collection, Mapping
from typing import TypeAlias

from scheduler.traffic.world import Agent, World, room

ROBOTS_MAX = 64  # followed from one move; a longer chain counts as safe

_Stand: TypeAlias = tuple[int, float]  # place and heading


class Safe:
    """Checks the moves of one planning in the order in which they are committed."""

    def __init__(self, world: World, excused: Collection[str] = ()) -> None:
        """`excused` follow a way that has been found to lead out."""
        self._world = world
        self._excused = excused
        self._agents = {agent.name: agent for agent in world.agents}
        self._stands: dict[str, _Stand] = {
            agent.name: (agent.place, agent.heading_rad) for agent in world.agents
        }
        self._at = {agent.place: agent.name for agent in world.agents}
        self.rings: dict[str, tuple[str, ...]] = {}  # of those refused: who would wait for whom

    def take(self, name: str, moves: tuple[int, ...]) -> bool:
        """Take an operation in, if all is as safe after it as it was before."""
        if not moves:
            return True
        roadmap, before = self._world.roadmap, self._stands[name]
        after = roadmap.moves.end[moves[-1]], roadmap.heading_end[moves[-1]]
        self._put(name, after)
        jam = set() if name in self._excused else self._jam(name)
        if not jam:
            return True
        self._put(name, before)
        if self._jam(name):  # it was so before, and this may be the way out
            self._put(name, after)
            return True
        self.rings[name] = tuple(sorted(jam - {name}))
        return False

    def _put(self, name: str, stand: _Stand) -> None:
        del self._at[self._stands[name][0]]
        self._at[stand[0]] = name
        self._stands[name] = stand

    def _jam(self, name: str) -> set[str]:
        """The ring of robots, none of whom can move, that it waits for, if only through others."""
        waits = self._followed(name)
        ring = _in_rings(waits)
        if not ring:
            return ring
        left = dict.fromkeys(waits)
        taken = 0
        for place in self._at:
            taken |= 1 << place
        again = True
        while again and not ring.isdisjoint(left):
            again = False
            for other in tuple(left):
                if self._can_move(other, taken):
                    taken &= ~(1 << self._stands[other][0])
                    del left[other]
                    again = True
        return ring.intersection(left)

    def _followed(self, name: str) -> dict[str, tuple[str, ...]]:
        """Who waits for whom, from one robot on."""
        found: dict[str, tuple[str, ...]] = {}
        todo = [name]
        while todo and len(found) < ROBOTS_MAX:
            waiting = todo.pop()
            if waiting not in found:
                found[waiting] = self._blockers(self._agents[waiting])
                todo += found[waiting]
        return {} if todo else found

    def _blockers(self, agent: Agent) -> tuple[str, ...]:
        place, heading = self._stands[agent.name]
        if agent.goal is None or agent.goal == place:
            return ()
        ways = agent.costs.ways(place, heading, agent.goal)
        if not ways:
            return ()
        need = room(self._world, place, heading, (min(ways)[1],), agent.goal) & ~(1 << place)
        found = []
        while need:
            low = need & -need
            need ^= low
            other = self._at.get(low.bit_length() - 1)
            if other is not None:
                found.append(other)
        return tuple(found)

    def _can_move(self, name: str, taken: int) -> bool:
        agent, (place, heading) = self._agents[name], self._stands[name]
        moves, world = self._world.roadmap.moves, self._world
        if agent.fixed:  # it works, and goes on when it is done
            return True
        for _, move, end, *_ in agent.costs.departures(place, heading):
            if end >= world.roadmap.places.stops and end != agent.goal:
                continue
            if move in world.closed_moves or world.closed_places >> moves.end[move] & 1:
                continue
            need = room(world, place, heading, (move,), agent.goal)
            if not need & taken & ~(1 << place):
                return True
        return False


def _in_rings(waits: Mapping[str, tuple[str, ...]]) -> set[str]:
    """Robots that wait for themselves, through others."""
    found = set()
    for name in waits:
        seen: set[str] = set()
        todo = list(waits[name])
        while todo:
            other = todo.pop()
            if other not in seen:
                seen.add(other)
                todo += waits.get(other, ())
        if name in seen:
            found.add(name)
    return found
