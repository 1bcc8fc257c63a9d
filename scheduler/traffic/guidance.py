"""Guidance: moves seem longer where many come the other way, so that two-way lanes sort themselves.

Robots that meet head-on cost more than a detour, and no planner that looks one move ahead sees it
coming. So a flow is laid over the map, one goal after another, each along the cheapest ways given
what is there already (after Chen et al., "Traffic flow optimisation for lifelong multi-agent path
finding", AAAI-24): what comes first makes a direction, what comes later follows it or goes around.
On RHCR's fulfilment floor it is worth more than alternating lanes drawn by hand: 4.7 against 4.4
tasks per step with 140 robots (bench/grids.py).
"""

import random
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from scheduler.traffic.costs import Costs
from scheduler.traffic.roadmap import Roadmap

_Array = npt.NDArray[Any]

# Price of flow, in durations of a move, where the other way has as much of it as the mean move and
# one in `share` of the stops has a robot on it. Tried on the fulfilment floor: 1.5-4 and 0-9.
AGAINST = 2.5
ARRIVING = 8.0  # for all that comes to the same end, by the share once more: spreads the load
PASSES = 2  # in the second each goal is laid anew among all others; a third changes nothing
GOALS_MAX = 512  # laid; of more each second, third, ... one
WORK_MAX = 1_000_000  # states looked at, some 0.8 s: on larger maps fewer goals
# What maps of scenes are laid out for, whoever drives on them. Four seeds of 600 s each with 0.2,
# 0.3 and 0.4, shares of free flow: 10, 20 and 30 robots in aisles 0.83, 0.72, 0.63; 0.85, 0.74,
# 0.59; 0.87, 0.74, 0.64. 60 on a fine lattice 0.50, 0.51, 0.50. 4 and 8 on seer_sample_3, a ring
# with two dead ends, 0.69, 0.43; 0.69, 0.39; 0.66, 0.40, and the longest wait there 198, 349 and
# 437 s. Without guidance 30 robots in aisles did 0.37; 0.8 is worth less everywhere.
SHARE = 0.3
# Where stops have more ways out than lanes have, there is always another way round, and what is
# driven against is spread so thin that prices only send robots on detours: on an open grid of 0.7 m
# 30 robots did 0.31 of free flow with it and 0.72 without (bench/maps.py).
WAYS_OUT_MAX = 6  # lattices and aisles have 3 to 5, open grids 20 to 50


class Load(msgspec.Struct, frozen=True, kw_only=True):
    """Who drives where: every robot goes from some source to some goal, all alike."""

    sources: Sequence[int]  # places
    goals: Sequence[int]
    share: float  # robots per stop


def priced(roadmap: Roadmap, flow: _Array, share: float) -> _Array:
    """How much longer moves are to seem, in durations of a move, under this flow over them; it may
    be laid, or counted where robots really drove.
    """
    moves, places = roadmap.moves, len(roadmap.places.point)
    start, end = np.array(moves.start), np.array(moves.end)
    total = flow.sum()
    if not total:
        return np.zeros(moves.count)
    usual = flow * (moves.count / total)
    pairs, which = np.unique(start * places + end, return_inverse=True)
    of_pair = np.bincount(which, usual)
    back = np.minimum(np.searchsorted(pairs, end * places + start), len(pairs) - 1)
    against = np.where(pairs[back] == end * places + start, of_pair[back], 0.0)
    arriving = np.bincount(end, usual, minlength=places)[end]
    found: _Array = share * (AGAINST * against + ARRIVING * share * arriving)
    return found


def guided(roadmap: Roadmap, share: float = SHARE, retreats: bool = False) -> dict[int, Costs]:
    """Costs of each group on a map whose robots come and go everywhere; no guidance at share 0.
    It is laid for the first group and holds for all, for they share the lanes.
    """
    found, guidance = dict[int, Costs](), list[float]()
    for group in roadmap.groups.values():
        if share and not guidance and _is_of_lanes(roadmap):
            stops = range(roadmap.places.stops)
            plain = Costs(roadmap, group.kinematics, retreats=retreats)
            guidance = learned(plain, Load(sources=stops, goals=stops, share=share))
        found[group.id] = Costs(roadmap, group.kinematics, guidance, retreats)
    return found


def _is_of_lanes(roadmap: Roadmap) -> bool:
    return roadmap.moves.count <= WAYS_OUT_MAX * roadmap.places.stops


def learned(costs: Costs, load: Load, work_max: int = WORK_MAX) -> list[float]:
    """Seconds that each move is to seem longer, found by laying the load goal by goal."""
    graph, moves = _Graph(costs), costs.roadmap.moves
    usual_s = float(np.mean(costs.move_s)) if moves.count else 0.0
    most = min(GOALS_MAX, max(work_max // (graph.states * PASSES + 1), 1))
    goals = list(load.goals)[:: -(-len(load.goals) // most) or 1]
    # In no order: laid row by row, or by a regular stride, it is worth 3 % less (measured).
    random.Random(0).shuffle(goals)
    demand = graph.demand(load.sources)
    flow = np.zeros(moves.count)
    laid: dict[int, _Array] = {}
    for _ in range(PASSES):
        for goal in goals:
            if goal in laid:
                flow -= laid[goal]
            extra = priced(costs.roadmap, flow, load.share) * usual_s
            laid[goal] = graph.tree(goal, extra, demand)
            flow += laid[goal]
    found: list[float] = (priced(costs.roadmap, flow, load.share) * usual_s).tolist()
    return found


class _Graph:
    """The reversed graph of states, whose costs can be changed without building it anew."""

    def __init__(self, costs: Costs) -> None:
        edges = costs.edges
        nodes = costs.goal_node(0) + len(costs.roadmap.places.point)
        order = np.lexsort((edges.costs, edges.tails, edges.heads))
        key = edges.heads[order].astype(np.int64) * nodes + edges.tails[order]
        first = np.append(True, key[1:] != key[:-1])  # the cheapest of parallel ones
        self.costs, self.nodes, self.states = costs, nodes, costs.goal_node(0)
        self.place_of = np.array(costs.place_of, dtype=np.int64)
        self.key = key[first]
        kept = order[first]
        self.move = edges.move[kept].astype(np.int64)
        self.base = edges.costs[kept]
        self.tails = edges.tails[kept].astype(np.int32)
        rows = np.bincount(edges.heads[kept].astype(np.int64), minlength=nodes)
        self.indptr = np.append(0, np.cumsum(rows)).astype(np.int32)

    def demand(self, sources: Sequence[int]) -> _Array:
        """One robot for each source, shared by the headings in which it may stand there."""
        place_of = self.place_of
        many = np.bincount(place_of, minlength=len(self.costs.roadmap.places.point))
        wanted = np.zeros(len(many))
        wanted[list(sources)] = 1.0
        found: _Array = wanted[place_of] / np.maximum(many[place_of], 1)
        return found

    def tree(self, goal: int, extra: _Array, demand: _Array) -> _Array:
        """Flow over each move if all that is demanded drives to a goal."""
        prices = np.maximum(self.base + extra[self.move], 1e-9)
        matrix = csr_matrix((prices, self.tails, self.indptr), shape=(self.nodes, self.nodes))
        source = np.array([self.costs.goal_node(goal)])
        ways_s, before = dijkstra(matrix, directed=True, indices=source, return_predecessors=True)
        way_s, onward = ways_s[0], before[0].astype(np.int64)
        far_first = np.argsort(-way_s[: self.states], kind="stable")
        far_first = far_first[onward[far_first] >= 0]
        demand = np.where(self.place_of == goal, 0.0, demand)  # who is there stays
        passing = [*demand.tolist(), *[0.0] * (self.nodes - self.states)]
        for state, after in zip(far_first.tolist(), onward[far_first].tolist(), strict=True):
            passing[after] += passing[state]
        edge = np.searchsorted(self.key, onward[far_first] * self.nodes + far_first)
        load = np.array(passing)[far_first]
        found: _Array = np.bincount(self.move[edge], load, minlength=len(extra))
        return found
