"""Moves: ways from one place to the next along one or more paths, with turns in place between.

A turn before departure is no part of a move: it depends on how the robot stands, and is added when
the move is committed.
"""

import heapq
from collections import Counter
from typing import TypeAlias

import msgspec
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from ledger.scene import Kinematics
from scheduler.traffic.cells import Cells
from scheduler.traffic.geometry import SMOOTH_RAD, turn_rad
from scheduler.traffic.kinematics import drive_s, halt_s, turn_s
from scheduler.traffic.network import Network
from scheduler.traffic.stops import Places

# A way is cut once it passes so near to more stops than this that they must be empty. Without it
# an open grid of 0.5 m gave 408 000 moves in 97 s; with it 5 545 in 0.5 s (measured).
THIRD_PARTIES_MAX = 2
THIRD_PARTIES_MAX_APART = 6  # where parts of the map would else be out of reach
DETOUR_MAX = 3.0  # times the cheapest move to the same end
EXPANDED_MAX = 5_000  # paths looked at from one start on


_Key: TypeAlias = tuple[int, int, int]  # end, and the bins of first and last heading
_Way: TypeAlias = tuple[float, tuple[int, ...], int]  # cost in s, paths, places its sweep meets


class Moves(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All compiled moves, as parallel lists."""

    start: list[int]  # places
    end: list[int]
    paths: list[tuple[int, ...]]
    need: list[int]  # bits of the places that must be empty, its end among them
    retreats: frozenset[int] = frozenset()  # in reverse out of dead ends; the others stand first

    @property
    def count(self) -> int:
        """How many."""
        return len(self.start)


class Finder:
    """Searches ways over paths; turn costs make it a search over paths rather than points."""

    def __init__(
        self, net: Network, cells: Cells, places: Places, footprint: int, limits: Kinematics
    ) -> None:
        """`footprint` is the widest, which stands for all; `limits` price the ways."""
        self.net = net
        self.places = places
        self.place = {point: k for k, point in enumerate(places.point)}
        self.stops = (1 << places.stops) - 1
        self.limits = limits
        self.drive = [
            drive_s(length, path, limits)
            for length, path in zip(net.traces.length_m, net.paths, strict=True)
        ]
        layout = cells.cell[footprint * cells.size : (footprint + 1) * cells.size].tolist()
        rows = _RestRows(cells, places.resting)
        first = net.traces.first
        self.met = [rows.bits(layout[first[k] : first[k + 1]]) for k in range(len(net.paths))]
        self.disc = [rows.bits([layout[cells.pieces + k]]) for k in range(len(net.points))]

    def all(self) -> Moves:
        """Every move from every place."""
        found = Moves(start=[], end=[], paths=[], need=[])
        for start in range(len(self.places.point)):
            self._add(found, start, self._best(start, THIRD_PARTIES_MAX))
        part = self._parts(found)
        reached = set(found.end)
        if any(part) or len(reached) < len(part):
            # Cut too early somewhere: join what is apart by ways that pass near more stops.
            for start in range(len(self.places.point)):
                wider = self._best(start, THIRD_PARTIES_MAX_APART)
                missing = {
                    key: way
                    for key, way in wider.items()
                    if part[key[0]] != part[start] or key[0] not in reached
                }
                self._add(found, start, missing)
        count = found.count
        for start in range(len(self.places.point)):
            self._add(found, start, self._best(start, THIRD_PARTIES_MAX, retreat=True))
        return msgspec.structs.replace(found, retreats=frozenset(range(count, found.count)))

    def _best(self, start: int, limit: int, retreat: bool = False) -> dict[_Key, _Way]:
        best: dict[_Key, _Way] = {}
        for first in self.net.out[self.places.point[start]]:
            if self.net.retreat[first] == retreat:
                self._from(start, first, limit, best)
        return best

    def _add(self, found: Moves, start: int, best: dict[_Key, _Way]) -> None:
        cheapest: dict[int, float] = {}
        for (end, _, _), (cost, _, _) in best.items():
            cheapest[end] = min(cost, cheapest.get(end, cost))
        for (end, _, _), (cost, paths, met) in best.items():
            if cost <= DETOUR_MAX * cheapest[end]:
                found.start.append(start)
                found.end.append(end)
                found.paths.append(paths)
                need = met | 1 << end | self.places.conflict[end]
                found.need.append(need & ~(1 << start))

    def _parts(self, found: Moves) -> list[int]:
        """Numbers the parts of the map whose places all lead to each other, the largest 0; a
        goal-only stop, which leads nowhere else, is of the part of its neighbours if it is of one.
        """
        count = len(self.places.point)
        graph = csr_matrix((np.ones(found.count), (found.start, found.end)), shape=(count, count))
        _, labels = connected_components(graph, directed=True, connection="strong")
        order = [label for label, _ in Counter(labels.tolist()).most_common()]
        rank = {label: k for k, label in enumerate(order)}
        return [rank[label] for label in labels.tolist()]

    def _from(self, start: int, first: int, limit: int, best: dict[_Key, _Way]) -> None:
        """Ways that begin with one path, cut at stops, running through goal-only stops."""
        net, own = self.net, 1 << start
        setting_out = heading_bin(net.traces.heading_start[first])
        heap: list[tuple[float, tuple[int, ...], int]] = [
            (self.drive[first], (first,), self.met[first])
        ]
        done: set[int] = set()
        while heap and len(done) < EXPANDED_MAX:
            cost, paths, met = heapq.heappop(heap)
            path = paths[-1]
            if path in done:
                continue
            done.add(path)
            place = self.place.get(net.end[path])
            if place == start:
                continue
            third = met & self.stops & ~own
            if place is not None and (third & ~(1 << place)).bit_count() <= limit:
                key = (place, setting_out, heading_bin(net.traces.heading_end[path]))
                if key not in best or (cost, paths) < best[key][:2]:
                    best[key] = (cost, paths, met)
            if third.bit_count() > limit + 1 or (place is not None and place < self.places.stops):
                continue
            for after, dearer, more in self.onward(path):
                if after not in done:
                    heapq.heappush(heap, (cost + dearer, (*paths, after), met | more))

    def onward(self, path: int) -> list[tuple[int, float, int]]:
        """Paths that may follow: (path, cost in s, places met), a turn in between included."""
        net = self.net
        point = net.end[path]
        found = []
        for after in net.out[point]:
            if net.end[after] == net.start[path]:
                continue  # there and back again leads nowhere new
            if net.retreat[after] and not net.retreat[path]:
                continue
            angle = turn_rad(net.traces.heading_end[path], net.traces.heading_start[after])
            cost, met = self.drive[after], self.met[after]
            if angle:
                if not net.points[point].turning:
                    continue
                cost += turn_s(angle, self.limits) + halt_s(self.limits)
                met |= self.disc[point]
            elif net.paths[path].backward != net.paths[after].backward:
                cost += halt_s(self.limits)
            found.append((after, cost, met))
        return found


class _RestRows:
    """Which places' resting bodies cells meet: a restriction of the conflict table."""

    def __init__(self, cells: Cells, resting: dict[int, int]) -> None:
        wanted = np.zeros(cells.count, dtype=bool)
        wanted[list(resting)] = True
        owner = np.repeat(np.arange(cells.count), np.diff(cells.indptr))
        hit = wanted[cells.indices]
        self._bits = dict(resting)
        for cell, other in zip(owner[hit].tolist(), cells.indices[hit].tolist(), strict=True):
            self._bits[cell] = self._bits.get(cell, 0) | resting[other]

    def bits(self, cells: list[int]) -> int:
        found = 0
        for cell in cells:
            found |= self._bits.get(cell, 0)
        return found


def heading_bin(heading_rad: float) -> int:
    """Headings of one bin count as one state: within SMOOTH_RAD of each other, or nearly."""
    return round(heading_rad / SMOOTH_RAD) % round(2 * np.pi / SMOOTH_RAD)
