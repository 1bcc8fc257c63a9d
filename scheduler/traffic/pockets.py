"""Pockets: dead-end parts of the stop graph, where robots cannot pass each other."""

import heapq

import msgspec

from scheduler.traffic.moves import Moves
from scheduler.traffic.stops import Places

DEEPER_M = 1.2  # a goal counts as deeper in the pocket from this difference on


class Pockets(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Each pruned tree of the stop graph is one pocket; -1 = in none."""

    pocket: list[int]  # per place
    depth_m: list[float]  # per place: driving distance from the pocket's mouth


def find(places: Places, moves: Moves, lengths_m: list[float]) -> Pockets:
    """Prune leaves until none is left; a goal-only stop belongs to the pocket around it."""
    count = len(places.point)
    near: list[dict[int, float]] = [{} for _ in range(count)]
    for start, end, length in zip(moves.start, moves.end, lengths_m, strict=True):
        near[start][end] = min(length, near[start].get(end, length))
        near[end][start] = min(length, near[end].get(start, length))
    stops = range(places.stops)
    links = [{k for k in near[stop] if k < places.stops} for stop in stops]
    alive = _core(links)
    if len(alive) <= 1:  # a tree: its widest branching is the mouth of all; a line has no pockets
        widest = max(stops, key=lambda k: (len(links[k]), -k), default=0)
        alive = {widest} if links and len(links[widest]) > 2 else set(stops)
    pocket, depth = [-1] * count, [0.0] * count
    for stop in stops:
        if stop not in alive and pocket[stop] < 0:
            _flood(stop, near, alive, places.stops, pocket, depth)
    for place in range(places.stops, count):
        around = sorted(k for k in near[place] if k < places.stops)
        inside = {pocket[k] for k in around if pocket[k] >= 0}
        mouths = {m for k in around if pocket[k] >= 0 for m in near[k] if m in alive}
        if len(inside) == 1 and all(pocket[k] >= 0 or k in mouths for k in around):
            pocket[place] = inside.pop()
            depth[place] = min(depth[k] + near[place][k] for k in around)
    return Pockets(pocket=pocket, depth_m=depth)


def _core(links: list[set[int]]) -> set[int]:
    """Stops that are left when leaves are pruned until there are none."""
    alive = set(range(len(links)))
    degree = [len(others) for others in links]
    leaves = [stop for stop in range(len(links)) if degree[stop] <= 1]
    while leaves:
        leaf = leaves.pop()
        if leaf in alive:
            alive.discard(leaf)
            for other in sorted(links[leaf] & alive):
                degree[other] -= 1
                if degree[other] <= 1:
                    leaves.append(other)
    return alive


def _flood(
    stop: int,
    near: list[dict[int, float]],
    alive: set[int],
    stops: int,
    pocket: list[int],
    depth: list[float],
) -> None:
    """Mark the whole tree around a pruned stop, and measure it from its mouth."""
    number = max(pocket, default=-1) + 1
    tree, todo = {stop}, [stop]
    while todo:
        for other in near[todo.pop()]:
            if other < stops and other not in alive and other not in tree:
                tree.add(other)
                todo.append(other)
    heap = [
        (length, k) for k in sorted(tree) for other, length in near[k].items() if other in alive
    ]
    if not heap:  # a tree without a mouth: measured from the stop it was found by
        heap = [(0.0, stop)]
    heapq.heapify(heap)
    while heap:
        way, k = heapq.heappop(heap)
        if pocket[k] == number:
            continue
        pocket[k], depth[k] = number, way
        for other, length in near[k].items():
            if other in tree and pocket[other] != number:
                heapq.heappush(heap, (way + length, other))
