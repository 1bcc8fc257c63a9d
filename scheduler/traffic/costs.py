"""What it costs to drive on from a place: rows per goal over (place, heading of arrival)."""

from collections import Counter, OrderedDict
from typing import Any

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


class Costs:
    """Durations of moves and cost rows for one set of limits.

    A state is a place with the heading under which some move arrives there. Only the last move of
    a way may end at a goal-only stop, so those have no way *into* them in the graph of states but
    one to a node of their own, which stands for "this place is the goal".
    """

    def __init__(self, roadmap: Roadmap, limits: Kinematics) -> None:
        """Make the graph once per group."""
        self.roadmap = roadmap
        self.limits = limits
        moves = roadmap.moves
        self.move_s = [roadmap.move_s(move, limits) for move in range(moves.count)]
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
        self._goal = len(states)  # node of place k as a goal: _goal + k
        self._reversed, component = self._graph(place_of, heading_of)
        main = Counter(component).most_common(1)[0][0] if component else -1
        home = {place for state, place in enumerate(place_of) if component[state] == main}
        # Moves that end outside the largest part whose places all lead to each other, and those of
        # them that leave it: no way back.
        self.outside = [component[self.state[move]] != main for move in range(moves.count)]
        self.trap = [
            outside and moves.start[move] in home for move, outside in enumerate(self.outside)
        ]
        self._kept: OrderedDict[int, list[float]] = OrderedDict()
        self._ways: dict[tuple[int, float, int], list[tuple[float, int]]] = {}

    def _graph(self, place_of: list[int], heading_of: list[float]) -> tuple[csr_matrix, list[int]]:
        roadmap, moves = self.roadmap, self.roadmap.moves
        tails, heads, costs = [], [], []
        for state, place in enumerate(place_of):
            for move in roadmap.leaving[place]:
                turn = self.departure_s(place, heading_of[state], move)
                if turn == INFINITE:
                    continue
                end, cost = moves.end[move], turn + self.move_s[move]
                if end < roadmap.places.stops:
                    tails.append(state)
                    heads.append(self.state[move])
                    costs.append(cost)
                final = roadmap.final_turn_rad(end, roadmap.heading_end[move])
                tails.append(state)
                heads.append(self._goal + end)
                costs.append(cost + roadmap.turn_cost_s(final, self.limits))
        nodes = self._goal + len(roadmap.places.point)
        lowest = _lowest(np.array(tails), np.array(heads), np.array(costs), nodes)
        within = lowest[: self._goal, : self._goal]
        _, labels = connected_components(within, directed=True, connection="strong")
        return lowest.T.tocsr(), labels.tolist()

    def departure_s(self, place: int, heading_rad: float, move: int) -> float:
        """The turn before a move; infinite where turning is forbidden."""
        angle = turn_rad(heading_rad, self.roadmap.heading_start[move])
        if angle and not self.roadmap.turning[place]:
            return INFINITE
        return self.roadmap.turn_cost_s(angle, self.limits)

    def arrival_s(self, move: int) -> float:
        """The turn that its end demands of who has its goal there."""
        roadmap = self.roadmap
        angle = roadmap.final_turn_rad(roadmap.moves.end[move], roadmap.heading_end[move])
        return roadmap.turn_cost_s(angle, self.limits)

    def row(self, goal: int) -> list[float]:
        """Seconds from each state to a place; infinite if there is no way."""
        row = self._kept.get(goal)
        if row is None:
            source = np.array([self._goal + goal])
            found = dijkstra(self._reversed, directed=True, indices=source)[0]
            row = found[: self._goal].tolist()
            self._kept[goal] = row
            if len(self._kept) > ROWS_MAX:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(goal)
        return row

    def onward_s(self, place: int, heading_rad: float, move: int, goal: int) -> float:
        """Seconds to the goal if this move is driven first."""
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
            final = self.roadmap.final_turn_rad(place, heading_rad)
            return self.roadmap.turn_cost_s(final, self.limits)
        ways = self.ways(place, heading_rad, goal)
        return min(ways)[0] if ways else INFINITE

    def ways(self, place: int, heading_rad: float, goal: int) -> list[tuple[float, int]]:
        """Moves that lead to a goal, each with the seconds to it; only to be read.

        Robots that plan again and again from where they are ask the same: kept, for it costs more
        to find than all the rest of a planning step (measured).
        """
        key = (place, heading_rad, goal)
        ways = self._ways.get(key)
        if ways is None:
            onward = (
                (self.onward_s(place, heading_rad, move, goal), move)
                for move in self.roadmap.leaving[place]
            )
            ways = [way for way in onward if way[0] < INFINITE]
            if len(self._ways) >= WAYS_MAX:
                self._ways.clear()
            self._ways[key] = ways
        return ways


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
