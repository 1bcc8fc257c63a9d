"""Doors of one area: the ground behind them, who may enter it, and for whom they must open.

Ground of a door is the swept ground of its paths, with the points between two of them; or all
ground on which a body meets one that rests on a point of the door. A robot acquires it only while
the door lets it in, and the door is wanted as long as a robot is in it or about to be. Ways through
a door that does not work are closed for planning, so that only who had them before waits there.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from itertools import pairwise

import msgspec
import numpy as np
import shapely

from ledger.ids import RobotName
from ledger.link import DOOR
from ledger.scene import Door, Value
from scheduler.traffic.costs import INFINITE, Costs
from scheduler.traffic.geometry import Floats, discs, turn_rad
from scheduler.traffic.grants import Grants
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.track import Shut, Track

WAY_MAX = 1_000  # moves looked at for the door that is in a robot's way


class DoorNow(Value, frozen=True, kw_only=True):
    """What may be done at a door just now; as long as nothing is known, nothing."""

    enter: bool = False  # it is open, and stays open for whoever wants it
    leave: bool = False  # it is open: who is in it may go on
    works: bool = True  # it can be expected to open; else ways through it are avoided


class _Ground(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    door: Door
    cells: frozenset[int]
    inside: shapely.Geometry  # where no body is that stands before or behind the door
    moves: frozenset[int]  # that lead into it


class Doors:
    """The doors of one area, whose ground the grant table knows as cells like all other."""

    def __init__(
        self, roadmap: Roadmap, grants: Grants, costs: dict[int, Costs], doors: Sequence[Door] = ()
    ) -> None:
        """`costs` by group: while a door does not work, those without the ways through it."""
        self._roadmap = roadmap
        self._grants = grants
        self._costs = costs
        self._open_costs = dict(costs)  # as if all doors worked
        here = [door for door in doors if door.area == roadmap.area.id]
        self._grounds = [_ground(roadmap, door) for door in sorted(here, key=lambda d: d.id)]
        self._now: dict[int, DoorNow] = {}
        self.shut: Shut = {}
        self.closed_moves: frozenset[int] = frozenset()
        self._refresh()

    def follow(self, now: Mapping[int, DoorNow]) -> tuple[bool, bool]:
        """Take in how the doors are: did who may enter change, and did the open ways."""
        now = {g.door.id: now.get(g.door.id, DoorNow()) for g in self._grounds}
        if now == self._now:
            return False, False
        self._now, closed = now, self.closed_moves
        self._refresh()
        if closed == self.closed_moves:
            return True, False
        self._shut_ways()
        return True, True

    def reprice(self) -> None:
        """Take in that the costs of the open map are others now."""
        self._open_costs = dict(self._costs)
        self._shut_ways()

    def _shut_ways(self) -> None:
        for group, costs in self._open_costs.items():
            shut = costs.closed(self.closed_moves, frozenset()) if self.closed_moves else costs
            self._costs[group] = shut

    def _refresh(self) -> None:
        shut: dict[int, tuple[frozenset[int], ...]] = {}
        closed: set[int] = set()
        for ground in self._grounds:
            now = self._of(ground)
            if not now.enter:
                from_within = ground.cells if now.leave else frozenset()
                for cell in ground.cells:
                    shut[cell] = (*shut.get(cell, ()), from_within)
            if not now.works:
                closed |= ground.moves
        self.shut, self.closed_moves = shut, frozenset(closed)

    def wanted(self, tracks: Mapping[RobotName, Track]) -> dict[int, tuple[RobotName, ...]]:
        """By door, the robots that are in it, and those whose promised way leads into it within
        its `open_ahead_m`; a door out of service opens only to let robots out.
        """
        found: dict[int, tuple[RobotName, ...]] = {}
        for ground in self._grounds:
            robots = {name for cell in ground.cells for name in self._grants.owners(cell)}
            if not ground.door.disabled:
                coming = {name for cell in ground.cells for name in self._grants.promised(cell)}
                for name in coming - robots:
                    track = tracks.get(RobotName(name))
                    if track is not None and _ahead_m(track, ground) <= ground.door.open_ahead_m:
                        robots.add(name)
            if self._grants.shapes():
                robots |= self._found_within(ground, tracks)
            if robots:
                found[ground.door.id] = tuple(RobotName(name) for name in sorted(robots))
        return found

    def _found_within(self, ground: _Ground, tracks: Container[str]) -> set[str]:
        """Robots that stand in the door otherwise than the map foresees."""
        found: set[str] = set()
        for shape, ring in self._grants.shapes().items():
            # ground that somebody outside reserves is a shape too
            holders = {name for name in self._grants.owners(shape) if name in tracks}
            if holders and shapely.Polygon(ring).intersects(ground.inside):
                found.update(holders)
        return found

    def before(self, track: Track) -> tuple[str, ...]:
        """Names of the shut doors that keep a robot from the next cell of its way."""
        if not track.promised or track.may_enter(track.promised[0].cell, self.shut):
            return ()
        cell = track.promised[0].cell
        shut = (g for g in self._grounds if cell in g.cells and not self._of(g).enter)
        return tuple(f"{DOOR}{ground.door.name}" for ground in shut)

    def bar(self, tracks: Iterable[Track]) -> None:
        """Note whose goal is not to be had for a door that does not work."""
        for track in tracks if self.closed_moves else ():
            if track.goal is not None and not track.barred:
                track.barred = self._in_way(track, track.goal)

    def _in_way(self, track: Track, goal: int) -> tuple[str, ...]:
        """Names of the doors that alone keep a robot from this place; empty = it can get there, or
        could not anyway.
        """
        if track.place is None:
            return ()
        place, heading = track.place, track.heading_rad
        costs = self._open_costs[track.group]
        if track.costs.cost_s(place, heading, goal) < INFINITE:
            return ()
        if costs.cost_s(place, heading, goal) == INFINITE:
            return ()
        for _ in range(WAY_MAX):
            ways = [] if place == goal else costs.ways(place, heading, goal)
            if not ways:
                break
            _, move = min(ways)
            if move in self.closed_moves:
                broken = (g for g in self._grounds if not self._of(g).works)
                return tuple(f"{DOOR}{g.door.name}" for g in broken if move in g.moves)
            place = self._roadmap.moves.end[move]
            heading = self._roadmap.heading_end[move]
        return ()

    def _of(self, ground: _Ground) -> DoorNow:
        return self._now.get(ground.door.id, DoorNow())

    def holds(self, cell: int) -> bool:
        """Is the cell ground of a door."""
        return any(cell in ground.cells for ground in self._grounds)


def _ahead_m(track: Track, ground: _Ground) -> float:
    """The way from where the robot is to the first promised cell of the door."""
    begins = track.owned[-1].end if track.owned and track.owned[-1].end is not None else None
    for slot in track.promised:
        if slot.cell in ground.cells:
            here = track.way_to_m(track.progress)
            return max(0.0, (here if begins is None else track.way_to_m(begins)) - here)
        begins = slot.end
    return INFINITE


def _ground(roadmap: Roadmap, door: Door) -> _Ground:
    net = roadmap.net
    footprints = range(len(roadmap.footprints))
    widest = roadmap.footprints[-1]
    paths = [k for k, path in enumerate(net.paths) if path.key in set(door.paths)]
    cells = {cell for f in footprints for k in paths for cell, _ in roadmap.path_cells(f, k)}
    far: dict[int, set[int]] = {}
    for k in paths:
        far.setdefault(net.start[k], set()).add(net.end[k])
        far.setdefault(net.end[k], set()).add(net.start[k])
    between = [point for point, others in far.items() if len(others) > 1]
    cells |= {roadmap.rest(f, p) for f in footprints for p in between}
    cells |= {roadmap.disc(f, p) for f in footprints for p in between}
    rests = {roadmap.rest(f, net.number[p]) for f in footprints for p in door.points}
    for rest in rests:
        cells.update(roadmap.conflicts(rest))
    if door.points:
        inside: shapely.Geometry = shapely.union_all([roadmap.polygon(c) for c in rests])
    else:
        ends = [net.points[p] for p, others in far.items() if len(others) == 1]
        around = [discs(widest, _xy(point.x_m, point.y_m))[0] for point in ends]
        swept = shapely.union_all([roadmap.polygon(c) for c in cells])
        inside = shapely.difference(swept, shapely.union_all(around))
        inside = swept if inside.is_empty else inside
    return _Ground(
        door=door,
        cells=frozenset(cells),
        inside=inside,
        moves=frozenset(_leading_into(roadmap, cells)),
    )


def _xy(x_m: float, y_m: float) -> Floats:
    return np.array([[x_m, y_m]])


def _leading_into(roadmap: Roadmap, cells: set[int]) -> set[int]:
    """Moves over this ground, but those of robots that rest on it: they may always leave."""
    net, moves = roadmap.net, roadmap.moves
    over, turning = roadmap.users(sorted(cells))
    within = roadmap.places_of(sorted(cells))
    over |= {move for move in range(moves.count) if within >> moves.end[move] & 1}
    if turning:
        for move, paths in enumerate(moves.paths):
            for a, b in pairwise(paths):
                angle = net.traces.heading_end[a], net.traces.heading_start[b]
                if net.end[a] in turning and turn_rad(*angle):
                    over.add(move)
    return {move for move in over if not within >> moves.start[move] & 1}
