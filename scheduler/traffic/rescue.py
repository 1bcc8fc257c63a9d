"""A way out that was found, followed to its end: the moves of a few robots, in a fixed order.

Their moves go before what the planner proposes, their robots are nobody's to push, and the ground
of their next moves is closed to all others. Whoever is late holds up only those of them whose moves
could not be driven before its own.
"""

from collections.abc import Collection, Iterable

import msgspec

from scheduler.traffic.lacam import Way
from scheduler.traffic.world import Agent, World, room, standing_still

# A way on which nothing has been committed for so long is given up: somebody on it works, or
# stands still for another reason, and the floor around it has changed.
IDLE_MS_MAX = 20_000
CLOSED_AHEAD = 4  # moves whose ground is closed to others already


class _Step(msgspec.Struct, frozen=True, kw_only=True):
    agent: Agent
    moves: tuple[int, ...]
    need: int
    end: int  # place


class Rescue(msgspec.Struct, kw_only=True):
    """For whom, to what goal, and what is left of the way."""

    robot: str
    goal: int
    way: Way
    since_ms: int  # of the last commit on it
    sent: set[str] = set()  # proposed in this planning

    def robots(self) -> set[str]:
        """All who still have to move."""
        return {name for name, _ in self.way}

    def holds(self, world: World, lost: Collection[str], now_ms: int) -> bool:
        """Can it still be driven, and is it still wanted."""
        agents = {agent.name: agent for agent in world.agents}
        target = agents.get(self.robot)
        if not self.way or target is None or target.goal != self.goal:
            return False
        if now_ms - self.since_ms > IDLE_MS_MAX or not self.robots().isdisjoint(lost):
            return False
        steps = self._steps(world)
        closed = world.closed_places
        return len(steps) == len(self.way) and not any(step.need & closed for step in steps)

    def _steps(self, world: World) -> list[_Step]:
        """What is left, as it would be driven now; shorter if it cannot be."""
        roadmap = world.roadmap
        agents = {agent.name: agent for agent in world.agents}
        stands: dict[str, tuple[int, float]] = {}
        found: list[_Step] = []
        for name, moves in self.way:
            agent = agents.get(name)
            if agent is None:
                break
            place, heading = stands.get(name, (agent.place, agent.heading_rad))
            need = room(world, place, heading, moves, agent.goal) & ~(1 << place)
            for move in moves:
                closed = move in world.closed_moves or move in agent.costs.closed_moves
                end = roadmap.moves.end[move]
                if closed or roadmap.moves.start[move] != place:
                    return found
                if end >= roadmap.places.stops and end != agent.goal:
                    return found
                place, heading = end, roadmap.heading_end[move]
            if place == agent.goal and roadmap.final_turn_rad(place, heading):
                heading = roadmap.net.points[roadmap.places.point[place]].heading_rad or 0.0
            stands[name] = place, heading
            found.append(_Step(agent=agent, moves=moves, need=need, end=1 << place))
        return found

    def due(self, world: World, near: Collection[str]) -> Way:
        """What can be committed now. A move may go before earlier ones if it takes no room that
        one of these needs.
        """
        taken = 0
        for agent in world.agents:
            taken |= 1 << agent.place
        later: set[str] = set()
        needed = 0
        found: Way = []
        for step in self._steps(world):
            name, here = step.agent.name, 1 << step.agent.place
            can = name in near and name not in later and not step.agent.fixed
            if can and not step.need & taken & ~here and not step.end & needed:
                found.append((name, step.moves))
                taken = taken & ~here | step.end
            else:
                needed |= step.need | step.end
            later.add(name)
        self.sent = {name for name, _ in found}
        return found

    def shielded(self, world: World) -> World:
        """The world for everybody else: these robots stay, and their ground is closed."""
        closed = world.closed_places
        for step in self._steps(world)[:CLOSED_AHEAD]:
            closed |= step.need | step.end
        return msgspec.structs.replace(standing_still(world, self.robots()), closed_places=closed)

    def note(self, committed: Iterable[str], now_ms: int) -> None:
        """Take off what has been committed."""
        done = self.sent.intersection(committed)
        for name in done:
            first = next(k for k, (robot, _) in enumerate(self.way) if robot == name)
            del self.way[first]
            self.since_ms = now_ms
        self.sent = set()
