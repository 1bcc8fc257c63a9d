"""When a move is where, and so how long after one departure another may not be.

Two moves that share ground exclude each other for an interval of differences between their
departures (as continuous-time conflict-based search has it: Andreychuk et al., IJCAI 2019). Times
are those of a robot that rolls at constant speed; braking and reports are a gap between the two.
"""

from typing import TypeAlias

from ledger.scene import Kinematics
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.kinematics import drive_s, halt_s, turn_s
from scheduler.traffic.roadmap import Roadmap

# A robot needs ground as long before it is there as braking takes it (1 s at 1.2 m/s), and what it
# has left is known to be free by its next report (0.4 s later).
GAP_S = 1.4

Kind: TypeAlias = tuple[int, Kinematics]  # of robots: footprint, limits
Span: TypeAlias = tuple[int, float, float]  # cell, from, to: in seconds after the departure
Clash: TypeAlias = tuple[int, float, float]  # move, and departures after ours that it may not have


class _Table:
    """The moves of one kind of robot."""

    def __init__(self, roadmap: Roadmap, kind: Kind) -> None:
        self.spans = [_spans(roadmap, kind, move) for move in range(roadmap.moves.count)]
        self.lasts_s = [roadmap.move_s(move, kind[1]) for move in range(roadmap.moves.count)]
        self.over: dict[int, list[Span]] = {}  # cell -> move, from, to
        for move, spans in enumerate(self.spans):
            for cell, first, last in spans:
                self.over.setdefault(cell, []).append((move, first, last))


class Timetable:
    """All moves of a map for the kinds of robots that have been asked for."""

    def __init__(self, roadmap: Roadmap) -> None:
        """Nothing is worked out before it is asked for."""
        self._roadmap = roadmap
        self._tables: dict[Kind, _Table] = {}
        self._clashes: dict[tuple[Kind, Kind], dict[int, list[Clash]]] = {}
        self._ground: dict[tuple[Kind, int], list[tuple[int, float]]] = {}

    def _of(self, kind: Kind) -> _Table:
        found = self._tables.get(kind)
        if found is None:
            found = self._tables[kind] = _Table(self._roadmap, kind)
        return found

    def lasts_s(self, kind: Kind) -> list[float]:
        """How long each move takes, without the turn before it; `Costs` may have guidance in it."""
        return self._of(kind).lasts_s

    def clashes(self, kind: Kind, move: int, other: Kind) -> list[Clash]:
        """Moves of another robot that share ground with this one."""
        known = self._clashes.setdefault((kind, other), {})
        found = known.get(move)
        if found is None:
            over, between = self._of(other).over, dict[int, tuple[float, float]]()
            for cell, first, last in self._of(kind).spans[move]:
                for shared in self._roadmap.conflicts(cell):
                    for second, start, end in over.get(shared, ()):
                        low, high = first - end - GAP_S, last - start + GAP_S
                        before = between.get(second)
                        if before is not None:
                            low, high = min(low, before[0]), max(high, before[1])
                        between[second] = low, high
            found = known[move] = [(m, low, high) for m, (low, high) in sorted(between.items())]
        return found

    def over(self, cell: int, other: Kind) -> list[tuple[int, float]]:
        """Moves over ground that is held for a while, and when after its end they may depart."""
        found = self._ground.get((other, cell))
        if found is None:
            first: dict[int, float] = {}
            over = self._of(other).over
            for shared in self._roadmap.conflicts(cell):
                for move, start, _ in over.get(shared, ()):
                    first[move] = min(start, first.get(move, start))
            found = [(move, GAP_S - start) for move, start in sorted(first.items())]
            self._ground[other, cell] = found
        return found


def _spans(roadmap: Roadmap, kind: Kind, move: int) -> list[Span]:
    footprint, limits = kind
    net, paths = roadmap.net, roadmap.moves.paths[move]
    found: list[Span] = []
    now = 0.0
    for k, path in enumerate(paths):
        if k:
            heading = net.traces.heading_end[paths[k - 1]]
            angle = turn_rad(heading, net.traces.heading_start[path])
            if angle:
                lasts = turn_s(angle, limits) + halt_s(limits)
                found.append((roadmap.disc(footprint, net.start[path]), now, now + lasts))
                now += lasts
        length = net.traces.length_m[path]
        begun, lasts = now, drive_s(length, net.paths[path], limits)
        for cell, end_m in roadmap.path_cells(footprint, path):
            left = begun + lasts * end_m / length if length else begun
            found.append((cell, now, left))
            now = left
    return found
