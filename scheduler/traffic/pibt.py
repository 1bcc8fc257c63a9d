"""Causal PIBT over stops: who moves where next, in an order in which they could move one by one.

Each robot in the order of its rank takes its cheapest move; whoever rests in the way of that move
is pushed, recursively, and must end where no robot that pushes needs room. A pure function of the
`World`; what it proposes is committed elsewhere, against the grants of that moment.
"""

from typing import TypeAlias

from scheduler.traffic.costs import INFINITE, Way, places_in
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.world import Agent, World, has_token, may_be_pushed, turning_room

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
# Who is pushed had better not go where the one that pushes is bound next, or it is pushed again and
# again, all the way (fine lattice, 30 robots: 0.78 of free flow instead of 0.73, the longest wait
# 46 s instead of 74 s).
AHEAD_S = 6.0
AHEAD_MOVES = 4

FREE, TAKEN = -1, -2  # of a place, instead of the robot there
STAY, TURN = -1, -2  # instead of a move; a turn in place at the goal
# Value, the lowest first; what to do; where it ends; the other places that must be empty.
Option: TypeAlias = tuple[float, int, int, tuple[int, ...]]


class _Planner:
    """One step of planning. All that is asked for each candidate lies in flat lists by place: with
    bits of all places a step for 1,000 robots on 5,700 places took more than twice as long.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.agents = world.agents
        self.roadmap = world.roadmap
        self.pocket = world.roadmap.pockets.pocket
        self.pocketed = any(pocket >= 0 for pocket in self.pocket)
        count = len(world.roadmap.places.point)
        # place -> the robot there that has not been decided; TAKEN for good by one that has, by
        # one that pushes, or because the ground is closed
        self.at = [FREE] * count
        self.bound = [0] * count  # how many that push will come here next
        self.needed = [0] * count  # by how many that push: nobody below them may end there
        self.position = [agent.place for agent in world.agents]
        self.wanted = {agent.goal for agent in world.agents}
        self.closed = places_in(world.closed_places)
        self.decided = [agent.fixed for agent in world.agents]
        for k, agent in enumerate(world.agents):
            self.at[agent.place] = TAKEN if agent.fixed else k
        for place in self.closed:
            self.at[place] = TAKEN
        self.overlaid = bool(
            world.closed_moves or world.closed_turns or world.more_need or world.more_turning
        )
        self.found: list[tuple[int, tuple[int, ...]]] = []
        self.trail: list[tuple[int, int]] = []  # agent, place before
        self.visits: dict[int, int] = {}
        self.tries = 0
        longest_m = 2 * world.roadmap.longest_m  # who is pushed takes two moves at the most
        self.limited = world.push_m_min > 0.0 or world.push_m_max < longest_m
        self._options: list[list[Option] | None] = [None] * len(world.agents)

    def run(self) -> list[tuple[int, tuple[int, ...]]]:
        for k in range(len(self.agents)):
            if not self.decided[k]:
                self.visits.clear()
                self.trail.clear()
                self.tries = 0
                if not self.attempt(k, 0):
                    self.settle(k, self.position[k])
        return self.found

    # -- one robot

    def attempt(self, k: int, depth: int) -> bool:
        """Decide robot k, and before it all that it has to push; `depth` robots push it."""
        visits = self.visits.get(k, 0)
        if visits == VISITS_MAX or depth > DEPTH_MAX:
            return False
        self.visits[k] = visits + 1
        at, needed, here = self.at, self.needed, self.position[k]
        options = self._options[k] or self.options(k)
        if depth:
            bound = self.bound
            options = sorted((o[0] + AHEAD_S if bound[o[2]] else o[0], *o[1:]) for o in options)
        for _, move, end, needs in options:
            if move == STAY:
                if not needed[here]:
                    self.settle(k, here)
                    return True
                continue
            self.tries += 1
            if self.tries > TRIES_MAX:
                return False
            if needed[end] or (depth and self.limited and self.bars_push((move,))):
                continue
            if needs == (end,) and at[end] == FREE and not self.pocketed:
                self.found.append((k, (move,)))
                self.settle(k, end)
                return True
            moves = () if move == TURN else (move,)
            if self.perform(k, moves, end, needs, depth):
                return True
        return depth > 0 and self.by_two(k, depth)

    def perform(
        self, k: int, moves: tuple[int, ...], end: int, needs: tuple[int, ...], depth: int
    ) -> bool:
        """Clear the way for an operation, then take it; leaves nothing behind if it fails."""
        at, here = self.at, self.position[k]
        in_way = False
        for place in needs:
            if at[place] != FREE:
                if at[place] == TAKEN:
                    return False
                in_way = True
        if self.pocketed and moves and not self.may_enter(k, moves):
            return False
        if in_way:
            onward = self.onward(k, moves, end)
            for place in onward:
                self.bound[place] += 1
            cleared = self.clear(k, here, needs, depth)
            for place in onward:
                self.bound[place] -= 1
            if not cleared:
                return False
        self.found.append((k, moves))
        self.settle(k, end)
        return True

    def onward(self, k: int, moves: tuple[int, ...], place: int) -> list[int]:
        """Places that it will want to go to next, after an operation that ends at `place`."""
        agent, found = self.agents[k], list[int]()
        if agent.goal is None or not moves:
            return found
        move = moves[-1]
        while place != agent.goal and len(found) < AHEAD_MOVES:
            heading = self.roadmap.heading_end[move]
            ways = agent.costs.candidates(place, heading, agent.goal)
            if not ways:
                break
            _, move, place, _ = min(ways)
            found.append(place)
        return found

    def clear(self, k: int, here: int, needs: tuple[int, ...], depth: int) -> bool:
        """Push away who is where robot k needs room, the lowest place first."""
        at, needed = self.at, self.needed
        trail, found, before = len(self.trail), len(self.found), at[here]
        at[here] = TAKEN
        for place in needs:
            needed[place] += 1
        done = True
        for place in needs:
            other = at[place]
            if other >= 0 and not self.attempt(other, depth + 1):
                self.undo(trail, found)
                done = False
                break
        for place in needs:
            needed[place] -= 1
        at[here] = before
        return done

    def by_two(self, k: int, depth: int) -> bool:
        """Two moves in one: through room that a pushing robot needs, without ending in it. One-way
        lanes can only be left forwards.
        """
        agent, stops = self.agents[k], self.roadmap.places.stops
        looked_at = 0
        for _, first, between, needs in self.options(k):
            if first < 0 or between >= stops:
                continue
            if not self.needed[between] and not (self.limited and self.bars_push((first,))):
                continue
            if any(self.at[place] == TAKEN for place in needs):
                continue
            heading = self.roadmap.heading_end[first]
            for _, second, end, _, more in agent.costs.departures(between, heading):
                if end == agent.place or end >= stops or second in self.world.closed_moves:
                    continue
                if self.needed[end] or not self.sound(agent, second):
                    continue
                if self.limited and self.bars_push((first, second)):
                    continue
                looked_at += 1
                self.tries += 1
                if looked_at > PAIRS_MAX or self.tries > TRIES_MAX:
                    return False
                both = {*needs, *more, *self.extra(between, heading, second)} - {agent.place}
                if self.perform(k, (first, second), end, tuple(sorted(both)), depth):
                    return True
        return False

    def bars_push(self, moves: tuple[int, ...]) -> bool:
        return TURN not in moves and not may_be_pushed(self.world, moves)

    def settle(self, k: int, place: int) -> None:
        before = self.position[k]
        self.trail.append((k, before))
        if before not in self.closed:
            self.at[before] = FREE
        self.at[place] = TAKEN
        self.position[k] = place
        self.decided[k] = True

    def undo(self, trail: int, found: int) -> None:
        """Who is taken back was pushed, and so stood on no closed ground."""
        while len(self.trail) > trail:
            k, before = self.trail.pop()
            self.at[self.position[k]] = FREE
            self.at[before] = k
            self.position[k] = before
            self.decided[k] = False
        del self.found[found:]

    # -- what a move needs

    def extra(self, place: int, heading_rad: float, move: int) -> tuple[int, ...]:
        """What else must be empty, for bodies that stand otherwise than the map foresees."""
        world = self.world
        bits = world.more_need.get(move, 0)
        if world.more_turning and turn_rad(heading_rad, self.roadmap.heading_start[move]):
            bits |= world.more_turning.get(self.roadmap.places.point[place], 0)
        return places_in(bits)

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
        if self.agents[k].leaving:  # what it must pass on its way out counts as dead ends too
            return True
        here = self.pocket[self.agents[k].place]
        for move in moves:
            pocket = self.pocket[self.roadmap.moves.end[move]]
            if pocket >= 0 and pocket != here and not self.token(k, pocket):
                return False
        return True

    def token(self, k: int, pocket: int) -> bool:
        agents = self.agents
        return has_token(
            self.roadmap,
            pocket,
            agents[k].goal,
            [
                place if (goal := agents[other].goal) is None else goal
                for other, place in enumerate(self.position)
                if other != k and self.pocket[place] == pocket
            ],
        )

    # -- candidates

    def options(self, k: int) -> list[Option]:
        found = self._options[k]
        if found is None:
            agent = self.agents[k]
            found = self._idle(agent) if agent.goal is None else self._bound(agent, agent.goal)
            found.sort()
            self._options[k] = found
        return found

    def _usable(self, agent: Agent, move: int) -> bool:
        if move in self.world.closed_moves:
            return False
        if self.world.closed_turns:
            point = self.roadmap.places.point[agent.place]
            turn = turn_rad(agent.heading_rad, self.roadmap.heading_start[move])
            return not turn or point not in self.world.closed_turns
        return True

    def _bound(self, agent: Agent, goal: int) -> list[Option]:
        """Moves of a robot with a goal: the cheapest way on first. Staying is priced from the best
        of them, not from a row: a guessed heading would make it stay for ever.
        """
        at, place = self.at, agent.place
        ways = agent.costs.candidates(place, agent.heading_rad, goal)
        if self.overlaid:
            ways = self._as_it_stands(agent, ways)
        found = [w if at[w[2]] == FREE else (w[0] + OCCUPIED_S, w[1], w[2], w[3]) for w in ways]
        if self.pocketed and not agent.leaving:
            # a lane reserved in its middle is two dead ends, and one of them is the way out
            own = (-1, self.pocket[place], self.pocket[goal])
            found = [w if self.pocket[w[2]] in own else (w[0] + POCKET_S, *w[1:]) for w in found]
        if place == goal:
            found.append((0.0, STAY, place, ()))
            final = self.roadmap.final_turn_rad(goal, agent.heading_rad)
            if final and agent.costs.can_turn(goal):
                found.append((-1.0, TURN, place, places_in(turning_room(self.world, place))))
        elif found:
            found.sort()
            found.append((found[0][0] + STAY_S + agent.impatience_s, STAY, place, ()))
        else:
            return self._idle(agent)
        return found

    def _as_it_stands(self, agent: Agent, ways: list[Way]) -> list[Way]:
        """The same without what is closed just now, and with what else must be empty."""
        world = self.world
        if world.closed_moves or world.closed_turns:
            ways = [way for way in ways if self._usable(agent, way[1])]
        if not (world.more_need or world.more_turning):
            return ways
        found = []
        for value, move, end, needs in ways:
            more = {*self.extra(agent.place, agent.heading_rad, move)}
            arriving = self.roadmap.heading_end[move]
            if end == agent.goal and self.roadmap.final_turn_rad(end, arriving):
                more |= {*places_in(turning_room(world, end))}
            more = more.union(needs) - {agent.place}
            found.append((value, move, end, tuple(sorted(more))))
        return found

    def _idle(self, agent: Agent) -> list[Option]:
        """Moves of a robot without a goal: it stays, and makes way if it is pushed."""
        costs, pocket, stops = agent.costs, self.pocket, self.roadmap.places.stops
        ways = [
            (seconds, move, end, needs)
            for seconds, move, end, _, needs in costs.departures(agent.place, agent.heading_rad)
            if end < stops and not costs.trap[move]
        ]
        found: list[Option] = [(0.0, STAY, agent.place, ())]
        if self.overlaid:
            ways = self._as_it_stands(agent, ways)
        for value, move, end, needs in ways:
            value += IDLE_OCCUPIED_S if self.at[end] != FREE else 0.0
            value += IDLE_GOAL_S if end in self.wanted else 0.0
            value += IDLE_POCKET_S if pocket[end] >= 0 and pocket[agent.place] < 0 else 0.0
            found.append((value, move, end, needs))
        return found


def propose(world: World) -> list[tuple[str, tuple[int, ...]]]:
    """Operations by robot name, in an order in which they could be driven one after another."""
    return [(world.agents[k].name, moves) for k, moves in _Planner(world).run()]
