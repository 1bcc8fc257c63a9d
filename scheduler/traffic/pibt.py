"""Causal PIBT over stops: who moves where next, in an order in which they could move one by one.

Each robot in the order of its rank takes its cheapest move; whoever rests in the way of that move
is pushed, recursively, and must end where no robot that pushes needs room. A pure function of the
`World`; what it proposes is committed elsewhere, against the grants of that moment.
"""

from typing import TypeAlias

import msgspec

from scheduler.traffic.costs import INFINITE, Costs
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.pockets import DEEPER_M
from scheduler.traffic.roadmap import Roadmap

OCCUPIED_S = 0.5  # added to a move whose end is taken just now
STAY_S = 4.0  # staying costs this much more than the best move: little enough to try a detour
TRIES_MAX = 400  # candidates looked at per robot that is not pushed
VISITS_MAX = 2  # times that one robot is tried within that
DEPTH_MAX = 150  # length of a chain of pushes
PAIRS_MAX = 24  # two-move operations looked at per pushed robot
IDLE_OCCUPIED_S = 5.0  # an idle robot rather goes where it pushes nobody
IDLE_GOAL_S = 8.0  # and not where somebody wants to go
IDLE_POCKET_S = 15.0  # and not into a dead end
# Nor does one that is pushed on its way: whoever pushes may be bound for that dead end, and would
# have it in front of itself again (found on a real map: three robots at it for ever).
POCKET_S = 60.0

# Moves to be committed one after the other; () = turn in place at the goal, None = stay.
Operation: TypeAlias = tuple[int, ...] | None


class Agent(msgspec.Struct, kw_only=True):
    """One robot as the planner sees it: where its committed moves end, and what it wants."""

    name: str
    place: int
    heading_rad: float
    costs: Costs
    goal: int | None = None
    fixed: bool = False  # working, lost, or rolling to its goal: neither moves nor is pushed
    impatience_s: float = 0.0
    leaving: bool = False  # ground that somebody waits for: all around it may be dead ends


class World(msgspec.Struct, kw_only=True):
    """A snapshot to plan on. `agents` come in the order of rank; each place has one at most."""

    roadmap: Roadmap
    agents: list[Agent]
    closed_moves: frozenset[int] = frozenset()  # they lead over ground that will not become free
    closed_turns: frozenset[int] = frozenset()  # points where for that reason nobody can turn
    closed_places: int = 0  # bits
    # Bodies that stand otherwise than the map foresees: what else must be empty, by move and by
    # point of a turn.
    more_need: dict[int, int] = {}
    more_turning: dict[int, int] = {}


class _Planner:
    def __init__(self, world: World) -> None:
        self.world = world
        self.roadmap = world.roadmap
        self.need = world.roadmap.moves.need
        self.at: dict[int, int] = {}  # place -> agent that has not been decided
        self.waiting = 0  # bits of their places
        self.settled = world.closed_places  # bits of the places of those that have been
        self.position = [agent.place for agent in world.agents]
        self.decided = [False] * len(world.agents)
        self.goals = 0
        for k, agent in enumerate(world.agents):
            if agent.goal is not None:
                self.goals |= 1 << agent.goal
            if agent.fixed:
                self.settled |= 1 << agent.place
                self.decided[k] = True
            else:
                self.at[agent.place] = k
                self.waiting |= 1 << agent.place
        self.found: list[tuple[int, tuple[int, ...]]] = []
        self.trail: list[tuple[int, int]] = []  # agent, place before
        self.visits: dict[int, int] = {}
        self.tries = 0
        self._options: dict[int, list[tuple[float, Operation]]] = {}

    def run(self) -> list[tuple[int, tuple[int, ...]]]:
        for k in range(len(self.world.agents)):
            if not self.decided[k]:
                self.visits.clear()
                self.tries = 0
                if not self.attempt(k, 0, 0, 0):
                    self.settle(k, self.position[k])
        return self.found

    # -- one robot

    def attempt(self, k: int, forbidden: int, ancestors: int, depth: int) -> bool:
        """Decide robot k, and before it all that it has to push. `forbidden`: places where nobody
        below may end, for the pushing robots need them; `ancestors`: where these still stand.
        """
        self.visits[k] = self.visits.get(k, 0) + 1
        if self.visits[k] > VISITS_MAX or depth > DEPTH_MAX:
            return False
        here = 1 << self.position[k]
        for _, operation in self.options(k):
            if operation is None:
                if here & forbidden:
                    continue
                self.settle(k, self.position[k])
                return True
            self.tries += 1
            if self.tries > TRIES_MAX:
                return False
            if self.perform(k, operation, forbidden, ancestors, depth):
                return True
        return bool(forbidden) and self.by_two(k, forbidden, ancestors, depth)

    def perform(
        self, k: int, moves: tuple[int, ...], forbidden: int, ancestors: int, depth: int
    ) -> bool:
        """Clear the way for an operation, then take it; leaves nothing behind if it fails."""
        agent = self.world.agents[k]
        place = self.roadmap.moves.end[moves[-1]] if moves else agent.place
        end, here = 1 << place, 1 << agent.place
        if end & forbidden or (moves and not self.may_enter(k, moves)):
            return False
        need = self.room(agent, moves) & ~here
        if need & (ancestors | self.settled):
            return False
        mark = len(self.trail), len(self.found)
        while hit := need & self.waiting & ~here:
            low = hit & -hit
            other = self.at[low.bit_length() - 1]
            if not self.attempt(other, forbidden | need, ancestors | here, depth + 1):
                self.undo(*mark)
                return False
        self.found.append((k, moves))
        self.settle(k, place)
        return True

    def by_two(self, k: int, forbidden: int, ancestors: int, depth: int) -> bool:
        """Two moves in one: through room that a pushing robot needs, without ending in it. One-way
        lanes can only be left forwards.
        """
        agent, moves = self.world.agents[k], self.roadmap.moves
        looked_at = 0
        for _, operation in self.options(k):
            if not operation or not (1 << moves.end[operation[0]]) & forbidden:
                continue
            first = operation[0]
            between = moves.end[first]
            if between >= self.roadmap.places.stops:
                continue
            heading = self.roadmap.heading_end[first]
            for second in self.roadmap.leaving[between]:
                end = moves.end[second]
                if end == agent.place or end >= self.roadmap.places.stops:
                    continue
                if agent.costs.departure_s(between, heading, second) == INFINITE:
                    continue
                if second in self.world.closed_moves or second in agent.costs.closed_moves:
                    continue
                if not self.sound(agent, second):
                    continue
                looked_at += 1
                self.tries += 1
                if looked_at > PAIRS_MAX or self.tries > TRIES_MAX:
                    return False
                if self.perform(k, (first, second), forbidden, ancestors, depth):
                    return True
        return False

    def settle(self, k: int, place: int) -> None:
        before = self.position[k]
        self.trail.append((k, before))
        self.waiting &= ~(1 << before)
        self.settled |= 1 << place
        self.position[k] = place
        self.decided[k] = True

    def undo(self, trail: int, found: int) -> None:
        while len(self.trail) > trail:
            k, before = self.trail.pop()
            self.settled &= ~(1 << self.position[k])
            self.settled |= self.world.closed_places
            self.waiting |= 1 << before
            self.position[k] = before
            self.decided[k] = False
        del self.found[found:]

    # -- what a move needs

    def room(self, agent: Agent, moves: tuple[int, ...]) -> int:
        return room(self.world, agent.place, agent.heading_rad, moves, agent.goal)

    def sound(self, agent: Agent, move: int) -> bool:
        """Would the robot still be able to get where it wants, or, without a goal, anywhere."""
        if agent.goal is None:
            return not agent.costs.trap[move]
        end = self.roadmap.moves.end[move]
        return end == agent.goal or agent.costs.row(agent.goal)[agent.costs.state[move]] < INFINITE

    def may_enter(self, k: int, moves: tuple[int, ...]) -> bool:
        """The token of a pocket: past nobody. All inside must have goals deeper than one's own,
        and none may want out; who has no goal inside enters an empty pocket only.
        """
        pockets = self.roadmap.pockets
        agent = self.world.agents[k]
        here = pockets.pocket[agent.place]
        for move in moves:
            pocket = pockets.pocket[self.roadmap.moves.end[move]]
            if pocket >= 0 and pocket != here and not self.token(k, pocket):
                return False
        return True

    def token(self, k: int, pocket: int) -> bool:
        agents = self.world.agents
        return has_token(
            self.roadmap,
            pocket,
            agents[k].goal,
            [
                place if (goal := agents[other].goal) is None else goal
                for other, place in enumerate(self.position)
                if other != k and self.roadmap.pockets.pocket[place] == pocket
            ],
        )

    # -- candidates

    def options(self, k: int) -> list[tuple[float, Operation]]:
        found = self._options.get(k)
        if found is None:
            agent = self.world.agents[k]
            found = self._idle(agent) if agent.goal is None else self._bound(agent, agent.goal)
            self._options[k] = found
        return found

    def _usable(self, agent: Agent, move: int) -> bool:
        if move in self.world.closed_moves or move in agent.costs.closed_moves:
            return False
        if self.world.closed_turns:
            point = self.roadmap.places.point[agent.place]
            turn = turn_rad(agent.heading_rad, self.roadmap.heading_start[move])
            return not turn or point not in self.world.closed_turns
        return True

    def _bound(self, agent: Agent, goal: int) -> list[tuple[float, Operation]]:
        """Moves of a robot with a goal: the cheapest way on first. Staying is priced from the best
        of them, not from a row: a guessed heading would make it stay for ever.
        """
        taken = self.waiting | self.settled
        pocket = self.roadmap.pockets.pocket
        found: list[tuple[float, Operation]] = []
        for value, move in agent.costs.ways(agent.place, agent.heading_rad, goal):
            if self._usable(agent, move):
                end = self.roadmap.moves.end[move]
                value += OCCUPIED_S if taken >> end & 1 else 0.0
                strange = pocket[end] not in (-1, pocket[agent.place], pocket[goal])
                # a lane reserved in its middle is two dead ends, and one of them is the way out
                away = strange and not agent.leaving
                found.append((value + POCKET_S if away else value, (move,)))
        if agent.place == goal:
            found.append((0.0, None))
            if self.roadmap.final_turn_rad(goal, agent.heading_rad) and agent.costs.can_turn(goal):
                found.append((-1.0, ()))
        elif found:
            best = min(found)[0]
            found.append((best + STAY_S + agent.impatience_s, None))
        else:
            return self._idle(agent)
        found.sort(key=_price)
        return found

    def _idle(self, agent: Agent) -> list[tuple[float, Operation]]:
        """Moves of a robot without a goal: it stays, and makes way if it is pushed."""
        taken = self.waiting | self.settled
        pocket = self.roadmap.pockets.pocket
        found: list[tuple[float, Operation]] = [(0.0, None)]
        for move in self.roadmap.leaving[agent.place]:
            end = self.roadmap.moves.end[move]
            turn = agent.costs.departure_s(agent.place, agent.heading_rad, move)
            if end >= self.roadmap.places.stops or turn == INFINITE or agent.costs.trap[move]:
                continue
            if not self._usable(agent, move):
                continue
            value = turn + agent.costs.move_s[move]
            value += IDLE_OCCUPIED_S if taken >> end & 1 else 0.0
            value += IDLE_GOAL_S if self.goals >> end & 1 else 0.0
            value += IDLE_POCKET_S if pocket[end] >= 0 and pocket[agent.place] < 0 else 0.0
            found.append((value, (move,)))
        found.sort(key=_price)
        return found


def _price(option: tuple[float, Operation]) -> tuple[float, tuple[int, ...]]:
    return option[0], option[1] or ()


def room(
    world: World, place: int, heading_rad: float, moves: tuple[int, ...], goal: int | None
) -> int:
    """Bits of the places that must be empty for an operation, turns before and after included."""
    roadmap = world.roadmap
    bits = 0
    for move in moves:
        if turn_rad(heading_rad, roadmap.heading_start[move]):
            bits |= _turning(world, place)
        bits |= roadmap.moves.need[move] | world.more_need.get(move, 0)
        place, heading_rad = roadmap.moves.end[move], roadmap.heading_end[move]
    if place == goal and roadmap.final_turn_rad(place, heading_rad):
        bits |= _turning(world, place)
    return bits


def _turning(world: World, place: int) -> int:
    places = world.roadmap.places
    return places.turning[place] | world.more_turning.get(places.point[place], 0)


def has_token(roadmap: Roadmap, pocket: int, goal: int | None, goals_inside: list[int]) -> bool:
    """May a robot with this goal enter the pocket while robots with those goals are in it; a robot
    without one counts as having it where it is.
    """
    pockets = roadmap.pockets
    if not goals_inside:
        return True
    if goal is None or pockets.pocket[goal] != pocket:
        return False
    least = pockets.depth_m[goal] + DEEPER_M
    return all(
        pockets.pocket[other] == pocket and pockets.depth_m[other] > least for other in goals_inside
    )


def propose(world: World) -> list[tuple[str, tuple[int, ...]]]:
    """Operations by robot name, in an order in which they could be driven one after another."""
    return [(world.agents[k].name, moves) for k, moves in _Planner(world).run()]
