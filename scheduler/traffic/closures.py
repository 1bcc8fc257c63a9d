"""What of a map is closed where ground is held otherwise than the map foresees: reserved, under a
robot that does not answer, or under one that is off its points; and which dead ends that makes.
"""

import copy
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.moves import Moves
from scheduler.traffic.pockets import find
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.world import Closure, World


class Closures:
    """Finds what pieces of ground close on one map."""

    def __init__(self, roadmap: Roadmap) -> None:
        self._roadmap = roadmap
        self._inner_turns: dict[int, set[int]] | None = None  # point -> moves that turn on it
        self._arriving: dict[int, list[int]] = {}  # place -> moves that end there
        for move, end in enumerate(roadmap.moves.end):
            self._arriving.setdefault(end, []).append(move)

    def over(self, cells: Iterable[int]) -> Closure:
        """Give what ground over these compiled cells closes."""
        ground = sorted(cells)
        moves, turns = self._roadmap.users(ground)
        places = self._roadmap.places_of(ground)
        for place in _bits(places):
            moves.update(self._arriving.get(place, ()))
        for point in turns:
            moves |= self._turning_on(point)
        return Closure(
            cells=frozenset(ground), moves=frozenset(moves), turns=frozenset(turns), places=places
        )

    def _turning_on(self, point: int) -> set[int]:
        """Moves with a turn in place on this point, between two of their paths."""
        if self._inner_turns is None:
            self._inner_turns = {}
            net = self._roadmap.net
            for move, paths in enumerate(self._roadmap.moves.paths):
                for path, after in pairwise(paths):
                    angle = net.traces.heading_end[path], net.traces.heading_start[after]
                    if turn_rad(*angle):
                        self._inner_turns.setdefault(net.end[path], set()).add(move)
        return self._inner_turns.get(point, set())

    def with_dead_ends(self, closed: Closure) -> Roadmap:
        """Give the map with the dead ends that a closure makes: a lane cut in its middle is two."""
        if not closed.moves:
            return self._roadmap
        moves, net = self._roadmap.moves, self._roadmap.net
        kept = [m for m in range(moves.count) if m not in closed.moves]
        starts, ends = [moves.start[m] for m in kept], [moves.end[m] for m in kept]
        left = Moves(start=starts, end=ends, paths=[], need=[])
        lengths = [sum(net.traces.length_m[path] for path in moves.paths[m]) for m in kept]
        found, known = find(self._roadmap.places, left, lengths), self._roadmap.pockets
        for place in _bits(closed.places):  # its owner, and who leaves it, goes by the whole map
            found.pocket[place], found.depth_m[place] = -1, known.depth_m[place]
        made = copy.copy(self._roadmap)
        made.pockets = found
        return made


def lay_over(world: World, held: Sequence[tuple[str, int | None, Closure]]) -> None:
    """Take in what robots close: for good, or until the place that one rests on is empty."""
    world.closed_by = {name: closure for name, place, closure in held if place is None}
    gone = together(world.closed_by.values())
    world.closed_moves, world.closed_turns = gone.moves, gone.turns
    world.closed_places |= gone.places
    for _, place, closure in held:
        if place is not None:
            for move in closure.moves:
                world.more_need[move] = world.more_need.get(move, 0) | 1 << place
            for point in closure.turns:
                world.more_turning[point] = world.more_turning.get(point, 0) | 1 << place


def together(closures: Iterable[Closure]) -> Closure:
    """Give what several close."""
    cells: set[int] = set()
    moves: set[int] = set()
    turns: set[int] = set()
    places = 0
    for closure in closures:
        cells |= closure.cells
        moves |= closure.moves
        turns |= closure.turns
        places |= closure.places
    return Closure(
        cells=frozenset(cells), moves=frozenset(moves), turns=frozenset(turns), places=places
    )


def _bits(places: int) -> Iterator[int]:
    while places:
        low = places & -places
        yield low.bit_length() - 1
        places ^= low
