"""The compiled map of one area: all that traffic knows before any robot moves."""

import numpy as np
import shapely

from ledger.ids import PointName
from ledger.scene import XY, Area, Group, Kinematics
from scheduler.traffic.cells import Cells
from scheduler.traffic.classes import Classes
from scheduler.traffic.geometry import placed, turn_rad
from scheduler.traffic.kinematics import drive_s, halt_s, turn_s
from scheduler.traffic.moves import Moves
from scheduler.traffic.network import Network
from scheduler.traffic.pockets import Pockets
from scheduler.traffic.stops import Places


class Roadmap:
    """Stops, moves and cells of one area for all robot groups; read only once it is made."""

    def __init__(
        self,
        digest: str,
        area: Area,
        net: Network,
        groups: list[Group],
        classes: Classes,
        cells: Cells,
        places: Places,
        moves: Moves,
        pockets: Pockets,
    ) -> None:
        """Put together what was compiled."""
        self.digest = digest
        self.area = area
        self.net = net
        self.groups = {group.id: group for group in groups}
        self.classes = classes
        self.footprints = classes.footprints  # the last is that around all of them
        self.footprint_of = {group.id: classes.of(group.id) for group in groups}
        self.cells = cells
        self.places = places
        self.moves = moves
        self.pockets = pockets
        self.place_at = {point: k for k, point in enumerate(places.point)}
        self.place: dict[PointName, int] = {
            net.points[point].name: k for point, k in self.place_at.items() if point < net.named
        }
        traces = net.traces
        self.longest_m = max(
            (sum(traces.length_m[path] for path in paths) for paths in moves.paths), default=0.0
        )
        self.heading_start = [traces.heading_start[paths[0]] for paths in moves.paths]
        self.heading_end = [traces.heading_end[paths[-1]] for paths in moves.paths]
        self.leaving: list[list[int]] = [[] for _ in places.point]
        self.arriving: list[list[int]] = [[] for _ in places.point]
        self.over: list[list[int]] = [[] for _ in net.paths]  # path -> moves
        for move, start in enumerate(moves.start):
            self.leaving[start].append(move)
            self.arriving[moves.end[move]].append(move)
            for path in moves.paths[move]:
                self.over[path].append(move)
        self.turning = [net.points[point].turning for point in places.point]
        self._layout: list[int] = cells.cell.tolist()
        self._rows: dict[int, tuple[int, ...]] = {}
        self._polygons: list[shapely.Polygon] | None = None
        self._tree: shapely.STRtree | None = None
        self._where: dict[int, tuple[set[int], set[int]]] | None = None

    # -- cells

    def conflicts(self, cell: int) -> tuple[int, ...]:
        """Cells that cannot be owned by another robot while this one is owned, itself first."""
        row = self._rows.get(cell)
        if row is None:
            first, last = self.cells.indptr[cell], self.cells.indptr[cell + 1]
            row = self._rows[cell] = (cell, *self.cells.indices[first:last].tolist())
        return row

    def path_cells(self, footprint: int, path: int) -> list[tuple[int, float]]:
        """Cells along a path, each with the distance at which the reference point leaves it."""
        first = self.net.traces.first
        base, count = footprint * self.cells.size + first[path], first[path + 1] - first[path]
        length = self.net.traces.length_m[path]
        cells = self._layout[base : base + count]
        return [(cell, length * (k + 1) / count) for k, cell in enumerate(cells)]

    def disc(self, footprint: int, point: int) -> int:
        """Cell of a turn in place on a point."""
        return self._layout[footprint * self.cells.size + self.cells.pieces + point]

    def rest(self, footprint: int, point: int) -> int:
        """Cell of a robot that rests on a point."""
        local = self.cells.pieces + self.cells.points + point
        return self._layout[footprint * self.cells.size + local]

    def ring(self, cell: int) -> tuple[XY, ...]:
        """Corners of a cell, rounded to millimetres."""
        first, last = self.cells.offsets[cell], self.cells.offsets[cell + 1]
        return tuple((round(x, 3), round(y, 3)) for x, y in self.cells.corners[first:last].tolist())

    def polygon(self, cell: int) -> shapely.Polygon:
        """A cell as a polygon."""
        return self.cells.polygon(cell)

    def meeting(self, shape: shapely.Polygon) -> list[int]:
        """Cells that a foreign shape overlaps, ascending."""
        if self._tree is None:
            self._tree = shapely.STRtree(self.cells.polygons())
        return sorted(self._tree.query(shape, predicate="intersects").tolist())

    def places_of(self, cells: list[int]) -> int:
        """Bits of the places whose resting body is one of these cells."""
        bits = 0
        for cell in cells:
            bits |= self.places.resting.get(cell, 0)
        return bits

    def users(self, cells: list[int]) -> tuple[set[int], set[int]]:
        """Moves that drive over any of these cells, and points whose turns need one of them."""
        if self._where is None:
            self._where = {}
            first = self.net.traces.first
            owner = np.repeat(np.arange(len(self.net.paths)), np.diff(first)).tolist()
            for at, cell in enumerate(self._layout):
                local = at % self.cells.size
                paths, points = self._where.setdefault(cell, (set(), set()))
                if local < self.cells.pieces:
                    paths.add(owner[local])
                elif local < self.cells.pieces + self.cells.points:
                    points.add(local - self.cells.pieces)
        moves: set[int] = set()
        turns: set[int] = set()
        for cell in cells:
            paths, points = self._where[cell]
            turns |= points
            for path in paths:
                moves.update(self.over[path])
        return moves, turns

    # -- driving

    def turn_cost_s(self, angle_rad: float, limits: Kinematics) -> float:
        """A turn in place on the way, the halt for it included."""
        return turn_s(angle_rad, limits) + halt_s(limits) if angle_rad else 0.0

    def move_s(self, move: int, limits: Kinematics) -> float:
        """Duration of a move for one group, without the turn before it."""
        net, traces = self.net, self.net.traces
        paths = self.moves.paths[move]
        total = 0.0
        for k, path in enumerate(paths):
            total += drive_s(traces.length_m[path], net.paths[path], limits)
            if k:
                angle = turn_rad(traces.heading_end[paths[k - 1]], traces.heading_start[path])
                total += self.turn_cost_s(angle, limits)
                if not angle and net.paths[paths[k - 1]].backward != net.paths[path].backward:
                    total += halt_s(limits)
        return total

    def final_turn_rad(self, place: int, heading_rad: float) -> float:
        """The turn that a goal demands of a robot that arrives with this heading."""
        point = self.net.points[self.places.point[place]]
        if point.heading_rad is None or not point.turning:
            return 0.0
        return turn_rad(heading_rad, point.heading_rad)

    def body(self, group: int, x_m: float, y_m: float, heading_rad: float) -> shapely.Polygon:
        """Widened body of a robot at any pose."""
        corners = self.footprints[self.footprint_of[group]]
        return shapely.Polygon(placed(corners, np.array([[x_m, y_m, heading_rad]]))[0])
