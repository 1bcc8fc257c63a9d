"""The order of a plan's moves: who goes first where two of them need the same ground.

Kept as a graph over moves (as in action dependency graphs: Hönig et al., RA-L 2019), but only until
they are committed: from then on the grant table keeps the order, and what is not committed can be
dropped at any moment.
"""

import msgspec

from scheduler.traffic.bookings import Step
from scheduler.traffic.planner import Proposal
from scheduler.traffic.windows import Planning, Window
from scheduler.traffic.world import World, has_token, room

LATE_S = 2.0  # a move may be committed so much later than planned before the plan is dropped


class Turn(msgspec.Struct, kw_only=True):
    """A planned move."""

    robot: str
    start: int  # place
    step: Step
    after: tuple[int, ...]  # turns that must have been taken before


class Passing(msgspec.Struct, kw_only=True):
    """A plan as it is followed."""

    at_ms: int  # from which its seconds count
    goals: dict[str, int | None]
    turns: list[Turn]  # by departure
    todo: dict[str, list[int]]  # robot -> its turns that are left, the next one last
    places: dict[str, int]  # robot -> where its committed moves end

    def follow(self, world: World) -> bool:
        """Note what has been committed, and drop the rest of who goes elsewhere; False if the plan
        does not fit any more.
        """
        now_s, fits, ends = (world.now_ms - self.at_ms) / 1000, True, world.roadmap.moves.end
        for agent in world.agents:
            todo = self.todo.get(agent.name)
            if todo is None:
                fits = False
                continue
            while todo and self.places[agent.name] != agent.place:
                self.places[agent.name] = ends[self.turns[todo.pop()].step.move]
            if self.places[agent.name] != agent.place or self.goals[agent.name] != agent.goal:
                todo.clear()
                fits = False
            elif todo and now_s - self.turns[todo[-1]].step.commit_s > LATE_S:
                fits = False
        return fits

    def next(self, world: World) -> Proposal:
        """Turns that may be taken now, in the order of the plan, each over room that is empty."""
        agents = {agent.name: agent for agent in world.agents}
        left = {k for todo in self.todo.values() for k in todo}
        positions = {agent.name: agent.place for agent in world.agents}
        taken = world.closed_places
        for place in positions.values():
            taken |= 1 << place
        found: Proposal = []
        for k in sorted(todo[-1] for todo in self.todo.values() if todo):
            turn = self.turns[k]
            agent = agents.get(turn.robot)
            if agent is None or agent.fixed or not world.ahead[turn.robot].near:
                continue
            if turn.step.move in world.closed_moves or any(j in left for j in turn.after):
                continue
            moves = (turn.step.move,)
            need = room(world, agent.place, agent.heading_rad, moves, agent.goal)
            if need & taken & ~(1 << agent.place) or not self._may_enter(world, turn, positions):
                continue
            left.discard(k)
            positions[turn.robot] = world.roadmap.moves.end[turn.step.move]
            taken = taken & ~(1 << agent.place) | 1 << positions[turn.robot]
            found.append((turn.robot, moves))
        return found + self._turns(world, positions, taken)

    def _turns(self, world: World, positions: dict[str, int], taken: int) -> Proposal:
        """Turns in place that goals demand of who stands there."""
        found: Proposal = []
        for agent in world.agents:
            here = agent.goal == agent.place == positions[agent.name]
            if not here or agent.fixed or not agent.costs.can_turn(agent.place):
                continue
            if world.roadmap.final_turn_rad(agent.place, agent.heading_rad):
                need = room(world, agent.place, agent.heading_rad, (), agent.goal)
                if not need & taken & ~(1 << agent.place):
                    found.append((agent.name, ()))
        return found

    def _may_enter(self, world: World, turn: Turn, positions: dict[str, int]) -> bool:
        """The token of a dead end, as PIBT asks for it: whoever is in it comes out first."""
        pockets = world.roadmap.pockets.pocket
        pocket = pockets[world.roadmap.moves.end[turn.step.move]]
        if pocket < 0 or pocket == pockets[turn.start]:
            return True
        goals = {agent.name: agent.goal for agent in world.agents}
        inside = [
            place if (goal := goals[name]) is None else goal
            for name, place in positions.items()
            if pockets[place] == pocket and name != turn.robot
        ]
        return has_token(world.roadmap, pocket, goals[turn.robot], inside)


def passing(planning: Planning, window: Window) -> Passing:
    """Put a window's moves in order."""
    world, booked = planning.world, planning.base
    ends = world.roadmap.moves.end
    rows: list[tuple[float, int, float, Step, int]] = []
    for route in window.routes:
        start = route.place
        for step in route.steps:
            rows.append((step.commit_s, route.robot, step.arrive_s, step, start))
            start = ends[step.move]
    rows.sort(key=lambda row: row[:3])
    turns: list[Turn] = []
    todo: dict[str, list[int]] = {agent.name: [] for agent in world.agents}
    over: dict[int, list[int]] = {}  # by move: turns so far
    needing: dict[int, list[int]] = {}  # by a place that they need
    leaving: dict[int, list[int]] = {}  # by their start
    for k, (_, robot, _, step, start) in enumerate(rows):
        name = world.agents[robot].name
        after = set(needing.get(ends[step.move], ()))
        for need in step.needs:
            after.update(leaving.get(need, ()))
        for kind in booked.all_kinds:
            for move, _, _ in booked.times.clashes(booked.kinds[robot], step.move, kind):
                after.update(over.get(move, ()))
        after.difference_update(todo[name])
        turns.append(Turn(robot=name, start=start, step=step, after=tuple(sorted(after))))
        todo[name].append(k)
        over.setdefault(step.move, []).append(k)
        leaving.setdefault(start, []).append(k)
        for need in step.needs:
            needing.setdefault(need, []).append(k)
    return Passing(
        at_ms=world.now_ms,
        goals={agent.name: agent.goal for agent in world.agents},
        turns=turns,
        todo={name: numbers[::-1] for name, numbers in todo.items()},
        places={agent.name: agent.place for agent in world.agents},
    )
