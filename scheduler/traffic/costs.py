"""What it costs to drive on from a place: rows per goal over (place, heading of arrival)."""

import copy
from array import array
from collections import Counter, OrderedDict
from collections.abc import Sequence, Set
from typing import Any, TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from ledger.scene import Kinematics
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.moves import heading_bin
from scheduler.traffic.roadmap import Roadmap

ROWS_MAX = 4096  # rows kept; 10 000 states make 80 kB each
WAYS_MAX = 50_000  # lists of ways kept, some 300 bytes each
_Array = npt.NDArray[Any]
INFINITE = float("inf")

# A move as seen from a place and a heading: its seconds with the turn before it, the move, its end,
# the state in which it arrives there, and the other places that must be empty.
Departure: TypeAlias = tuple[float, int, int, int, tuple[int, ...]]
# The same on the way to a goal: seconds to the goal, the move, its end, the places.
Way: TypeAlias = tuple[float, int, int, tuple[int, ...]]


def places_in(bits: int) -> tuple[int, ...]:
    """The places of these bits, ascending."""
    found = []
    while bits:
        low = bits & -bits
        found.append(low.bit_length() - 1)
        bits ^= low
    return tuple(found)


class Edges(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The graph of states and goals, edge by edge, and what each edge is driven over."""

    tails: _Array
    heads: _Array
    costs: _Array
    move: _Array
    departure: _Array  # point of the turn before the move, -1 = none
    arrival: _Array  # point of the turn that the goal demands, -1 = none


class Costs:
    """Durations of moves and cost rows for one set of limits.

    A state is a place with the heading under which some move arrives there. Only the last move of
    a way may end at a goal-only stop, so those have no way *into* them in the graph of states but
    one to a node of their own, which stands for "this place is the goal".
    """

    def __init__(
        self,
        roadmap: Roadmap,
        limits: Kinematics,
        guidance: Sequence[float] = (),
        retreats: bool = False,
    ) -> None:
        """Make the graph once per group; `guidance`: seconds that each move is to seem longer;
        `retreats`: out of dead ends in reverse, too.
        """
        self.roadmap = roadmap
        self.limits = limits
        moves = roadmap.moves
        self.move_s = [roadmap.move_s(move, limits) for move in range(moves.count)]
        if guidance:
            self.move_s = [a + b for a, b in zip(self.move_s, guidance, strict=True)]
        states: dict[tuple[int, int], int] = {}
        self.state: list[int] = []  # move -> state in which it arrives
        place_of: list[int] = []
        heading_of: list[float] = []
        for move in range(moves.count):
            key = (moves.end[move], heading_bin(roadmap.heading_end[move]))
            if key not in states:
                states[key] = len(states)
                place_of.append(moves.end[move])
                heading_of.append(roadmap.heading_end[move])
            self.state.append(states[key])
        self.closed_moves = frozenset() if retreats else moves.retreats
        self._closed_turns: frozenset[int] = frozenset()
        self.place_of = place_of
        self._goal = len(states)  # node of place k as a goal: _goal + k
        self.edges = self._all_edges(place_of, heading_of)
        self._lay(~np.isin(self.edges.move, sorted(self.closed_moves)))

    def closed(self, moves: Set[int], turns: Set[int]) -> "Costs":
        """The same without these moves as well, and without turning on these points."""
        found, edges = copy.copy(self), self.edges
        found.closed_moves = self.closed_moves.union(moves)
        found._closed_turns = self._closed_turns.union(turns)
        closed = sorted(found._closed_turns)
        shut = np.isin(edges.move, sorted(found.closed_moves))
        shut |= np.isin(edges.departure, closed) | np.isin(edges.arrival, closed)
        found._lay(~shut)
        return found

    def apart(self) -> "Costs":
        """The same with rows of its own, for another thread."""
        found = copy.copy(self)
        found._kept, found._departures, found._ways = OrderedDict(), {}, {}
        return found

    def _lay(self, kept: _Array) -> None:
        """Make the graph of the edges that are kept; what was found in another is forgotten."""
        edges, moves = self.edges, self.roadmap.moves
        nodes = self._goal + len(self.roadmap.places.point)
        lowest = _lowest(edges.tails[kept], edges.heads[kept], edges.costs[kept], nodes)
        within = lowest[: self._goal, : self._goal]
        _, labels = connected_components(within, directed=True, connection="strong")
        self._reversed, component = lowest.T.tocsr(), labels.tolist()
        main = Counter(component).most_common(1)[0][0] if component else -1
        home = {place for state, place in enumerate(self.place_of) if component[state] == main}
        # Moves that end outside the largest part whose places all lead to each other, and those of
        # them that leave it: no way back.
        self.outside = [component[self.state[move]] != main for move in range(moves.count)]
        self.trap = [
            outside and moves.start[move] in home for move, outside in enumerate(self.outside)
        ]
        self._kept: OrderedDict[int, Sequence[float]] = OrderedDict()
        self._departures: dict[tuple[int, float], list[Departure]] = {}
        self._ways: dict[tuple[int, float, int], list[Way]] = {}

    def _all_edges(self, place_of: list[int], heading_of: list[float]) -> Edges:
        roadmap, moves = self.roadmap, self.roadmap.moves
        rows: list[tuple[int, int, float, int, int, int]] = []
        for state, place in enumerate(place_of):
            for move in roadmap.leaving[place]:
                turn = self.departure_s(place, heading_of[state], move)
                if turn == INFINITE:
                    continue
                end, cost = moves.end[move], turn + self.move_s[move]
                before = roadmap.places.point[place] if turn else -1
                if end < roadmap.places.stops:
                    rows.append((state, self.state[move], cost, move, before, -1))
                final = roadmap.final_turn_rad(end, roadmap.heading_end[move])
                total = cost + roadmap.turn_cost_s(final, self.limits)
                after = roadmap.places.point[end] if final else -1
                rows.append((state, self._goal + end, total, move, before, after))
        columns = [np.array(column) for column in zip(*rows, strict=True)] or 6 * [np.array([])]
        tails, heads, costs, move_of, departure, arrival = columns
        return Edges(
            tails=tails,
            heads=heads,
            costs=costs,
            move=move_of,
            departure=departure,
            arrival=arrival,
        )

    def goal_node(self, place: int) -> int:
        """Node of the graph that stands for "this place is the goal"; those below are states."""
        return self._goal + place

    def departure_s(self, place: int, heading_rad: float, move: int) -> float:
        """The turn before a move; infinite where turning is forbidden, or closed."""
        angle = turn_rad(heading_rad, self.roadmap.heading_start[move])
        if angle and not (self.roadmap.turning[place] and self.can_turn(place)):
            return INFINITE
        return self.roadmap.turn_cost_s(angle, self.limits)

    def arrival_s(self, move: int) -> float:
        """The turn that its end demands of who has its goal there."""
        return self._final_s(self.roadmap.moves.end[move], self.roadmap.heading_end[move])

    def can_turn(self, place: int) -> bool:
        """Is the ground for a turn in place not closed."""
        return self.roadmap.places.point[place] not in self._closed_turns

    def _final_s(self, place: int, heading_rad: float) -> float:
        angle = self.roadmap.final_turn_rad(place, heading_rad)
        if angle and not self.can_turn(place):
            return INFINITE
        return self.roadmap.turn_cost_s(angle, self.limits)

    def row(self, goal: int) -> Sequence[float]:
        """Seconds from each state to a place; infinite if there is no way."""
        row = self._kept.get(goal)
        if row is None:
            source = np.array([self._goal + goal])
            found = dijkstra(self._reversed, directed=True, indices=source)[0]
            row = array("d", found[: self._goal].tobytes())  # a list takes four times the memory
            self._kept[goal] = row
            if len(self._kept) > ROWS_MAX:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(goal)
        return row

    def onward_s(self, place: int, heading_rad: float, move: int, goal: int) -> float:
        """Seconds to the goal if this move is driven first."""
        if move in self.closed_moves:
            return INFINITE
        turn = self.departure_s(place, heading_rad, move)
        if turn == INFINITE:
            return INFINITE
        total = turn + self.move_s[move]
        end = self.roadmap.moves.end[move]
        if end == goal:
            return total + self.arrival_s(move)
        if end >= self.roadmap.places.stops:
            return INFINITE
        return total + self.row(goal)[self.state[move]]

    def cost_s(self, place: int, heading_rad: float, goal: int) -> float:
        """Seconds from a place and heading to a goal."""
        if place == goal:
            return self._final_s(place, heading_rad)
        ways = self.candidates(place, heading_rad, goal)
        return min(ways)[0] if ways else INFINITE

    def ways(self, place: int, heading_rad: float, goal: int) -> list[tuple[float, int]]:
        """Moves that lead to a goal, each with the seconds to it."""
        return [(way[0], way[1]) for way in self.candidates(place, heading_rad, goal)]

    def candidates(self, place: int, heading_rad: float, goal: int) -> list[Way]:
        """Ways to a goal by their first moves, with what these need; only to be read.

        Robots that plan again and again from where they are ask the same: kept, for it costs more
        to find than all the rest of a planning step (measured).
        """
        key = (place, heading_rad, goal)
        ways = self._ways.get(key)
        if ways is None:
            row, stops, ways = self.row(goal), self.roadmap.places.stops, []
            for seconds, move, end, state, needs in self.departures(place, heading_rad):
                if end == goal:
                    onward = seconds + self.arrival_s(move)
                    needs = self._arriving(move, place, needs)
                elif end < stops:
                    onward = seconds + row[state]
                else:
                    continue
                if onward < INFINITE:
                    ways.append((onward, move, end, needs))
            if len(self._ways) >= WAYS_MAX:
                self._ways.clear()
            self._ways[key] = ways
        return ways

    def departures(self, place: int, heading_rad: float) -> list[Departure]:
        """Moves that can be driven from a place, turning there first if need be; only to be read.
        Kept: there are as many as states.
        """
        key = (place, heading_rad)
        found = self._departures.get(key)
        if found is None:
            found, moves, here = [], self.roadmap.moves, 1 << place
            for move in self.roadmap.leaving[place]:
                turn = self.departure_s(place, heading_rad, move)
                if turn == INFINITE or move in self.closed_moves:
                    continue
                need = moves.need[move]
                if turn_rad(heading_rad, self.roadmap.heading_start[move]):
                    need |= self.roadmap.places.turning[place]
                needs = places_in(need & ~here)
                seconds = turn + self.move_s[move]
                found.append((seconds, move, moves.end[move], self.state[move], needs))
            if len(self._departures) >= WAYS_MAX:
                self._departures.clear()
            self._departures[key] = found
        return found

    def _arriving(self, move: int, place: int, needs: tuple[int, ...]) -> tuple[int, ...]:
        """What a move needs whose end is the goal: the turn that this demands included."""
        end = self.roadmap.moves.end[move]
        if not self.roadmap.final_turn_rad(end, self.roadmap.heading_end[move]):
            return needs
        turning = self.roadmap.places.turning[end] & ~(1 << place)
        return tuple(sorted({*needs, *places_in(turning)}))


def _lowest(tails: _Array, heads: _Array, costs: _Array, nodes: int) -> csr_matrix:
    """A graph with the cheapest of parallel edges; costs are kept above zero, which SciPy reads
    as no edge.
    """
    if not len(tails):
        return csr_matrix((nodes, nodes))
    order = np.lexsort((costs, heads, tails))
    tails, heads, costs = tails[order], heads[order], np.maximum(costs[order], 1e-9)
    first = np.append(True, (tails[1:] != tails[:-1]) | (heads[1:] != heads[:-1]))
    return csr_matrix((costs[first], (tails[first], heads[first])), shape=(nodes, nodes))
