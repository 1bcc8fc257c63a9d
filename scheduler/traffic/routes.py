"""From compiled moves to the pieces that a robot drives and the cells that it needs for them."""

from collections.abc import Sequence, Set
from operator import itemgetter

import msgspec

from ledger.ids import PathKey
from ledger.link import Mark, Piece, Space, Turn
from ledger.scene import XY
from scheduler.traffic.geometry import cut_front, turn_rad, wrap
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.track import ALONG_EPS, Slot

ENTRY = -1  # `Piece.move` of pieces on the way from where a robot was found to its first stop


class Leg(msgspec.Struct, frozen=True, kw_only=True):
    """A path to be driven, or its rest from `from_m` on."""

    path: int
    from_m: float = 0.0


def left(roadmap: Roadmap, footprint: int, leg: Leg) -> list[tuple[int, float]]:
    """Cells of what is left of a path, and where each ends. One that ends where the robot stands is
    behind it: to ask for it would be to wait for whoever stands there.
    """
    cells, from_m = roadmap.path_cells(footprint, leg.path), leg.from_m
    return [(cell, end - from_m) for cell, end in cells if end > from_m + ALONG_EPS]


class Builder:
    """Collects the pieces and slots of one commit after the other."""

    def __init__(
        self, roadmap: Roadmap, footprint: int, point: int | None, heading_rad: float, piece: int
    ) -> None:
        """The robot will stand on `point` under that heading, its next piece being `piece`."""
        self.roadmap = roadmap
        self.footprint = footprint
        self.point = point  # None = on the way along a path
        self.heading_rad = heading_rad
        self.piece = piece
        self.backward: bool | None = None
        self.pieces: list[Piece] = []
        self.slots: list[Slot] = []

    def turn(self, heading_rad: float, move: int, commit: int) -> None:
        """Turn in place, if the difference is more than is driven through."""
        angle = turn_rad(self.heading_rad, heading_rad)
        if not angle or self.point is None:
            return
        point = self.roadmap.net.points[self.point]
        self._append(
            Piece(
                number=self.piece,
                commit=commit,
                move=move,
                plan=self.roadmap.digest,
                path=None,
                area=self.roadmap.area.id,
                heading_rad=wrap(heading_rad),
                curve=((point.x_m, point.y_m),),
                length_m=angle,
            ),
            [(self.roadmap.disc(self.footprint, self.point), angle)],
        )
        self.heading_rad = heading_rad

    def drive(self, legs: Sequence[Leg], move: int, commit: int) -> None:
        """Drive paths one after another, with turns in place where they do not join smoothly."""
        net = self.roadmap.net
        for leg in legs:
            path = net.paths[leg.path]
            if not leg.from_m:
                self.turn(net.traces.heading_start[leg.path], move, commit)
            curve = net.traces.curves[leg.path]
            heading = net.traces.heading_end[leg.path]
            self._append(
                Piece(
                    number=self.piece,
                    commit=commit,
                    move=move,
                    plan=self.roadmap.digest,
                    path=path.key,
                    area=self.roadmap.area.id,
                    heading_rad=heading,
                    curve=cut_front(curve, leg.from_m) if leg.from_m else curve,
                    length_m=net.traces.length_m[leg.path] - leg.from_m,
                    inside=net.end[leg.path] >= net.named,
                    backward=path.backward,
                    speed_mps_max=path.speed_mps_max,
                    acceleration_mps2_max=path.acceleration_mps2_max,
                ),
                left(self.roadmap, self.footprint, leg),
            )
            self.point, self.heading_rad = net.end[leg.path], heading

    def rest(self) -> None:
        """End here: the ground of a robot that rests, until it is sent on."""
        assert self.point is not None
        self.slots.append(_rest(self.roadmap, self.footprint, self.point, self.pieces[-1]))

    def _append(self, piece: Piece, cells: list[tuple[int, float]]) -> None:
        self.pieces.append(piece)
        for cell, end in cells:
            self.slots.append(
                Slot(cell=cell, end=Mark(piece=piece.number, along_m=end), commit=piece.commit)
            )
        self.piece += 1


def _rest(roadmap: Roadmap, footprint: int, point: int, last: Piece) -> Slot:
    """The ground on which a robot rests behind this piece."""
    return Slot(
        cell=roadmap.rest(footprint, point),
        end=Mark(piece=last.number, along_m=last.length_m),
        commit=last.commit,
        resting=True,
    )


def adopted(roadmap: Roadmap, footprint: int, route: Sequence[Piece]) -> list[Slot] | None:
    """The cells of a route that was committed before a restart, under its old commit numbers;
    None if the route is not of this roadmap.
    """
    points = _points(roadmap)
    slots: list[Slot] = []
    point: int | None = None
    before: Piece | None = None
    for piece in route:
        if piece.plan != roadmap.digest:
            return None
        if piece.from_rest and before is not None and point is not None:
            slots.append(_rest(roadmap, footprint, point, before))
        before = piece
        if piece.path is None:
            point = points.get(piece.curve[0])
            if point is None:
                return None
            cells = [(roadmap.disc(footprint, point), piece.length_m)]
        else:
            path = _part(roadmap, piece)
            if path is None:
                return None
            point = roadmap.net.end[path]
            skipped = roadmap.net.traces.length_m[path] - piece.length_m
            cells = [
                (cell, end - skipped)
                for cell, end in roadmap.path_cells(footprint, path)
                if end - skipped > 1e-9
            ]
        for cell, end in cells:
            slots.append(
                Slot(cell=cell, end=Mark(piece=piece.number, along_m=end), commit=piece.commit)
            )
    if point is None:
        return None
    slots.append(_rest(roadmap, footprint, point, route[-1]))
    return slots


def expected(
    roadmap: Roadmap,
    footprint: int,
    ways: Sequence[tuple[PathKey, int]],
    turns: Sequence[Turn],
    held: Set[tuple[XY, ...]],
) -> list[tuple[int, int]]:
    """Cells of a route of which only paths, turns and commit numbers are known, each with its
    number; without those that the robot holds, by their corners, and what lies before these.
    """
    parts: dict[PathKey, list[int]] = {key: [] for key, _ in ways}
    for k, path in enumerate(roadmap.net.paths):
        if path.key in parts:
            parts[path.key].append(k)
    points = _points(roadmap)
    standing = [(points[turn.at_m], turn.commit) for turn in turns if turn.at_m in points]
    found = [(roadmap.disc(footprint, point), commit) for point, commit in standing]
    for key, commit in ways:
        cells: list[int] = []
        for k in parts[key]:
            cells += [cell for cell, _ in roadmap.path_cells(footprint, k)]
            cells.append(roadmap.rest(footprint, roadmap.net.end[k]))
        own = [k for k, cell in enumerate(cells) if roadmap.ring(cell) in held]
        found += [(cell, commit) for cell in cells[max(own, default=-1) + 1 :]]
    return sorted(found, key=itemgetter(1))


def granted(roadmap: Roadmap, slots: Sequence[Slot], passed: int, held: Sequence[Space]) -> int:
    """How many of these slots a robot had been granted that held this ground, in its order, and has
    `passed` so many of them. The first of it may be left behind since; before it comes nothing that
    is not, for a way to and fro has the same ground twice.
    """
    rings = [roadmap.ring(slot.cell) for slot in slots]
    corners = [space.points for space in held]
    for end in range(1, min(len(rings), passed + len(corners)) + 1):
        count = min(end, len(corners))
        if count and rings[end - count : end] == corners[-count:]:
            return end
    return 0


def end_of(roadmap: Roadmap, piece: Piece) -> int | None:
    """The place where a route with this last piece ends; None if that is none."""
    if piece.path is None:
        point = _points(roadmap).get(piece.curve[0])
    else:
        path = _part(roadmap, piece)
        point = None if path is None else roadmap.net.end[path]
    return None if point is None else roadmap.place_at.get(point)


def _points(roadmap: Roadmap) -> dict[XY, int]:
    return {(point.x_m, point.y_m): k for k, point in enumerate(roadmap.net.points)}


def _part(roadmap: Roadmap, piece: Piece) -> int | None:
    """The path, or the part of one, that a piece is driven over: it has the same end."""
    net = roadmap.net
    for k, path in enumerate(net.paths):
        same = path.key == piece.path and path.backward == piece.backward
        if same and net.traces.curves[k][-1] == piece.curve[-1]:
            return k
    return None
