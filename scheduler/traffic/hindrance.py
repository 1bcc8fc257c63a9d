"""How much robots would be in each other's way on one choice of stops, without driving any."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from scheduler.traffic.moves import Moves
from scheduler.traffic.network import Network
from scheduler.traffic.stops import Places

SOURCES_MAX = 24  # stops from which ways to all others are looked at
NEED_M = 0.05  # of two ways equally long the one that needs less room is taken


def hindrance(net: Network, places: Places, moves: Moves) -> float:
    """Stops that must be empty per metre driven, as a share of all stops.

    That many of its metres a robot has somebody in its way if the others are spread evenly, times
    how many they are. On an open grid of 1.0 m it tells stops at each second point (720, 0.41 of
    free flow with 60 robots) from those at each fourth (361, 0.59).
    """
    if not places.stops or not moves.count:
        return float("inf")
    stops = (1 << places.stops) - 1
    best: dict[tuple[int, int], tuple[float, float, int]] = {}
    for start, end, paths, need in zip(
        moves.start, moves.end, moves.paths, moves.need, strict=True
    ):
        if start < places.stops and end < places.stops:
            length, room = sum(net.traces.length_m[path] for path in paths), (need & stops)
            found = (length + NEED_M * room.bit_count(), length, room.bit_count())
            best[start, end] = min(found, best.get((start, end), found))
    ends = np.array(list(best)).reshape(-1, 2)
    costs = [cost for cost, _, _ in best.values()]
    graph = csr_matrix((costs, (ends[:, 0], ends[:, 1])), shape=(places.stops, places.stops))
    sources = range(0, places.stops, max(1, places.stops // SOURCES_MAX))
    way, before = dijkstra(graph, indices=list(sources), return_predecessors=True)
    metres = needed = 0.0
    for row, source in enumerate(sources):
        along: dict[int, tuple[float, int]] = {source: (0.0, 0)}
        for stop in np.argsort(way[row], kind="stable").tolist():
            if stop != source and way[row, stop] < np.inf:
                last = int(before[row, stop])
                _, length, room = best[last, stop]
                along[stop] = along[last][0] + length, along[last][1] + room
        metres += sum(length for length, _ in along.values())
        needed += sum(room for _, room in along.values())
    return needed / metres / places.stops if metres else float("inf")
