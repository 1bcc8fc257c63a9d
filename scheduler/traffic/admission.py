"""From a robot's first report to its place in the plan: adopted, placed, or kept as an obstacle."""

import math
from collections.abc import Sequence

import numpy as np
import shapely

from ledger.ids import SceneId
from ledger.link import Mark, Piece, Plan, Report
from scheduler.traffic.classes import corners
from scheduler.traffic.geometry import MARGIN_M, body_at, discs, placed, poses_along, widened, wrap
from scheduler.traffic.grants import Grants
from scheduler.traffic.placing import Entry, Locator, entries
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.routes import Builder, adopted, end_of, expected, granted
from scheduler.traffic.track import ARRIVED_M, START, Slot, Track

NEVER = 1 << 62  # a commit number behind all others
MOVED_M = 0.05  # an obstacle that has moved this far is looked at again

OFF_MAP = "RobotOffMap"
NOT_AT_STOP = "RobotNotAtStop"
ROUTE_UNKNOWN = "RobotRouteUnknown"
OLD_ROUTE = "RobotOnOldRoute"
LOAD_CHANGED = "RobotLoadChanged"  # on its way; what was granted to it empty is all it gets
HALTED = OLD_ROUTE, LOAD_CHANGED  # driving no further than is granted, to be placed anew there


class Admission:
    """Places robots; holds the ways to stops of those that stand elsewhere."""

    def __init__(self, scene: SceneId, roadmap: Roadmap, grants: Grants, within_m: float) -> None:
        """`within_m`: how far from a point or path a robot still counts as being on it."""
        self.scene = scene
        self.roadmap = roadmap
        self.grants = grants
        self.within_m = within_m  # of a point …
        self.path_m = within_m  # … and of a path
        self.entries: dict[str, list[Entry]] = {}
        self._locator = Locator(roadmap)
        self._shapes: dict[int, shapely.Polygon] = {}  # as last seen: a number never has another
        self._sessions: dict[str, int] = {}  # robot -> newest number

    def receive(self, track: Track, report: Report, taken: int) -> None:
        """Place a robot that has no place yet. `taken`: bits of the places of all others."""
        own = self._own(track, report)
        if own and report.route is None:
            track.asking, track.trouble = True, ROUTE_UNKNOWN
            return
        route = _outstanding(report) if own else []
        if route and _was_halted(track, route):
            self._begin(track, report, keep_session=True)
            _placed_by(track, report, OLD_ROUTE)
            return
        remembered = len(track.owned), len(track.promised)
        if route:
            self._adopt(track, report, route)
        else:
            self.put(track, report, taken, keep_session=own)
        track.forget(*remembered, self.grants)

    def wait_on_old_route(self, track: Track, report: Report, taken: int) -> None:
        """A route of another map version, or of another load, is driven to its authority; then the
        robot is placed.
        """
        there = report.authority
        at = report.progress
        near = at.piece == there.piece and at.along_m >= there.along_m - ARRIVED_M
        heard = there >= track.sent_authority
        if report.session != track.session:  # it has forgotten the route, or not heard of it yet
            heard = track.confirmed or report.session != track.session_before
        if near and track.standing and (heard or track.sent_authority == START):
            track.let_go(self.grants)
            self.put(track, report, taken, keep_session=False)

    def has_moved(self, track: Track, report: Report) -> bool:
        """Tell whether it stands somewhere else than when it was last placed."""
        off = math.hypot(report.x_m - track.seen_m[0], report.y_m - track.seen_m[1])
        return off > MOVED_M or abs(wrap(report.heading_rad - track.seen_rad)) > MOVED_M

    def put_anew(self, track: Track, report: Report, taken: int) -> None:
        """Place it where it stands now, whatever it had."""
        track.let_go(self.grants)
        # In a session that it was to leave it has pieces still that are not to be driven.
        self.put(track, report, taken, keep_session=report.session == track.session)

    def put(self, track: Track, report: Report, taken: int, keep_session: bool) -> None:
        """Claim the ground under a robot that has no route, and find its place or way to one."""
        self.entries.pop(track.name, None)
        self._begin(track, report, keep_session)
        _placed_by(track, report)
        track.place = None
        net = self.roadmap.net
        point = self._locator.nearest_point(report, self.within_m)
        legs = self._locator.on_paths(report, self.path_m)
        if point is not None:
            x, y = net.points[point].x_m, net.points[point].y_m
            if legs and math.hypot(report.x_m - x, report.y_m - y) > MARGIN_M:
                point = None  # it is on its way: what is left of the path is driven
        place = None if point is None else self.roadmap.place_at.get(point)
        if place is not None and not taken & (self.roadmap.places.conflict[place] | 1 << place):
            track.place, track.heading_rad = place, report.heading_rad
            self._claim(track, report, point)
            return
        self._claim(track, report, None)
        found = entries(self.roadmap, track.footprint, point, report.heading_rad, legs)
        track.trouble = NOT_AT_STOP if found else OFF_MAP
        if found:
            self.entries[track.name] = found

    def stand(self, track: Track, last: Plan) -> None:
        """Have a robot that has not been placed keep what it held by the last plan with it. Where
        it was to go on is promised to it, so that nobody is sent over it, nor drives there before
        it.
        """
        held = {space.points for space in last.spaces}
        for space in last.spaces:
            self._take(track, self._shape(shapely.Polygon(space.points)), None)
        track.last, track.commit = last, last.commit
        ways, turns = track.untravelled(), track.turns()
        for cell, commit in expected(self.roadmap, track.footprint, ways, turns, held):
            track.promised.append(Slot(cell=cell, end=None, commit=commit))
            self.grants.promise(cell, track.name, commit)

    def enter(self, track: Track, entry: Entry, commit: int) -> None:
        """Commit the way to a stop."""
        heading = track.report.heading_rad if track.report is not None else 0.0
        build = Builder(self.roadmap, track.footprint, entry.point, heading, track.piece_next)
        build.drive(entry.legs, -1, commit)
        build.rest()
        track.extend(build.pieces, build.slots, self.grants)
        track.place, track.heading_rad, track.trouble = entry.place, build.heading_rad, None
        del self.entries[track.name]

    def halt(self, track: Track) -> None:
        """Drive no further than is granted, and be placed anew there."""
        track.cut_back(self.grants)
        track.place, track.trouble = None, OLD_ROUTE

    # -- its class changes (see `classes`)

    def change_class(self, track: Track, loaded: bool) -> None:
        """From here on moves are made for the other class. Those that were committed for an empty
        robot are not driven on with a load: it stops where its authority ends, and is placed anew.
        """
        track.footprint = self.roadmap.classes.of(track.group, loaded=loaded)
        track.reshaping = track.placed
        if loaded and track.placed and not track.driven and track.trouble is None:
            track.cut_back(self.grants)
            track.place, track.trouble = None, LOAD_CHANGED
            for piece, _ in track.pieces:
                if track.progress.piece <= piece.number <= track.sent_authority.piece:
                    self._take(track, self._shape(self._swept(track, piece)), START)

    def reshape(self, track: Track, taken: int) -> bool:
        """Take the ground of its class where it rests, if nobody is in the way; only then it gives
        back what it had. Tells whether that is done.
        """
        report = track.report
        if report is None or not (track.driven and track.standing) or track.promised:
            return False
        track.reshaping, track.crowded_by = False, ()
        if track.place is None:
            if track.trouble in (NOT_AT_STOP, OFF_MAP):
                self.put_anew(track, report, taken)
            return True
        cell = self._rest(track, report, self.roadmap.places.point[track.place])
        slot = Slot(cell=cell, end=track.end, commit=0)
        if self.grants.is_shape(cell):
            slot = Slot(cell=cell, end=None, commit=0, standing=True)
        blockers = self.grants.blockers(cell, track.name, track.commit)
        if blockers:
            track.reshaping, track.crowded_by = True, tuple(sorted(set(blockers)))
            self.grants.discard(cell)
            return False
        self.grants.take(cell, track.name)
        for before in track.owned:
            self.grants.release(before.cell, track.name)
        track.owned.clear()
        track.owned.append(slot)
        track.stray = None
        return True

    def follow(self, track: Track, *, strays: bool) -> None:
        """Keep the ground under a body that is not where its route says: somebody drives it by
        hand, say. Nobody is granted that ground, and it gives up none until it is back on its own.
        """
        if track.stray is not None and track.owned[0] is track.stray:
            self.grants.release(track.owned.popleft().cell, track.name)
        track.stray = None
        if strays and track.report is not None:
            cell = self._shape(self._body(track, track.report))
            self.grants.take(cell, track.name)
            track.stray = Slot(cell=cell, end=None, commit=0, standing=True)
            track.owned.appendleft(track.stray)

    # -- inside

    def _own(self, track: Track, report: Report) -> bool:
        return report.session.startswith(f"{self.scene}/{track.name}/")

    def _begin(self, track: Track, report: Report, keep_session: bool) -> None:
        """Where the route goes on: in the robot's own session, or with piece 1 of a new one."""
        if keep_session:
            known = max(report.progress.piece, report.authority.piece)
            track.session, track.confirmed = report.session, True
            track.piece_next = max(known + 1, track.piece_next)
            track.progress = track.end = report.progress
            track.sent_piece, track.sent_authority = track.piece_next - 1, report.authority
            return
        number = self._sessions.get(track.name, 0)
        if self._own(track, report):
            last = report.session.rsplit("/", 1)[1]
            number = max(number, int(last) if last.isdigit() else 0)
        # Above all that a scheduler before this one has used: robots do not go back to a session
        # that they have left, and we may not know of it.
        number = max(number, report.at_ms) + 1
        self._sessions[track.name] = number
        track.session_before, track.confirmed = report.session, False
        track.session = f"{self.scene}/{track.name}/{number}"
        track.piece_next, track.sent_piece = 1, 0
        track.progress = track.end = track.sent_authority = START

    def _claim(self, track: Track, report: Report, point: int | None) -> None:
        """The rest cell if the robot stands as the map foresees, else its own body as a shape."""
        cell = None if point is None else self._rest(track, report, point)
        if cell is not None and not self.grants.is_shape(cell):
            if self.grants.free(cell, track.name, NEVER):
                self.grants.take(cell, track.name)
                track.owned.append(Slot(cell=cell, end=START, commit=0))
                return
            cell = None
        self._take(track, self._shape(self._body(track, report)) if cell is None else cell, None)

    def _rest(self, track: Track, report: Report, point: int) -> int:
        """The rest cell of a point if the body is on it, else a new shape of the body; untaken."""
        kind = self.roadmap.groups[track.group]
        loaded = track.footprint != self.roadmap.footprint_of[track.group]
        near = widened(corners(kind, loaded=loaded), MARGIN_M / 2)
        body = body_at(near, report.x_m, report.y_m, report.heading_rad)
        cell = self.roadmap.rest(track.footprint, point)
        if self.roadmap.polygon(cell).covers(body):
            return cell
        return self._shape(self._body(track, report))

    def _body(self, track: Track, report: Report) -> shapely.Polygon:
        widest = self.roadmap.footprints[track.footprint]
        return body_at(widest, report.x_m, report.y_m, report.heading_rad)

    def _shape(self, shape: shapely.Polygon) -> int:
        """Make a cell of a shape; untaken."""
        known, rings = self._shapes, sorted(self.grants.shapes().items())
        self._shapes = {n: known[n] if n in known else shapely.Polygon(ring) for n, ring in rings}
        met = shapely.intersects(shape, np.array([*self._shapes.values()], dtype=object))
        others = [number for number, is_met in zip(self._shapes, met, strict=True) if is_met]
        ring = tuple((x, y) for x, y in shapely.get_coordinates(shape)[:-1].tolist())
        return self.grants.add_shape(ring, (*self.roadmap.meeting(shape), *others))

    def _take(self, track: Track, shape: int, end: Mark | None) -> None:
        self.grants.take(shape, track.name)
        track.owned.append(Slot(cell=shape, end=end, commit=0, standing=True))

    def _adopt(self, track: Track, report: Report, route: list[Piece]) -> None:
        """Take a committed route over as it was: the same commit numbers, owned up to the reported
        authority, or to where it was granted by the last plan, promised beyond it.
        """
        track.session, track.confirmed = report.session, True
        _placed_by(track, report)
        slots = adopted(self.roadmap, track.footprint, route)
        place = end_of(self.roadmap, route[-1])
        if slots is None or place is None:
            track.trouble = OLD_ROUTE
            for piece in route:
                if piece.number <= report.authority.piece:
                    self._take(track, self._shape(self._swept(track, piece)), START)
            self._claim(track, report, None)
            return
        track.progress = report.progress
        track.end = Mark(piece=route[-1].number, along_m=route[-1].length_m)
        for piece in route:
            track.pieces.append((piece, track.way_m))
            track.way_m += piece.length_m if piece.path is not None else 0.0
        known = sum(_is_granted(slot, report.authority) for slot in slots[:-1])
        passed = sum(slot.is_behind(report.progress) for slot in slots[:-1])
        if track.last is not None:
            known = max(known, granted(self.roadmap, slots, passed, track.last.spaces))
        if not known:  # it has not set out: it owns the ground under it, and may go no further
            self._claim(track, report, None)
            track.owned[-1].end = slots[0].end
        for slot in slots[min(passed, max(known - 1, 0)) : known]:
            self.grants.take(slot.cell, track.name)
            track.owned.append(slot)
        for slot in slots[known:]:
            self.grants.promise(slot.cell, track.name, slot.commit)
            track.promised.append(slot)
        track.place, track.heading_rad = place, route[-1].heading_rad
        track.commit = route[-1].commit
        track.piece_next = route[-1].number + 1
        track.sent_piece, track.sent_authority = route[-1].number, report.authority

    def _swept(self, track: Track, piece: Piece) -> shapely.Polygon:
        corners = self.roadmap.footprints[track.footprint]
        if piece.path is None:
            return discs(corners, np.array([piece.curve[0]]))[0]
        samples = max(2, math.ceil(piece.length_m / 0.1))
        _, poses = poses_along(piece.curve, samples, piece.backward)
        return shapely.convex_hull(shapely.multipoints(placed(corners, poses).reshape(-1, 2)))


def _placed_by(track: Track, report: Report, trouble: str | None = None) -> None:
    track.placed, track.asking, track.trouble = True, False, trouble
    track.seen_m, track.seen_rad = (report.x_m, report.y_m), report.heading_rad


def _is_granted(slot: Slot, authority: Mark) -> bool:
    """Does leave to drive so far mean that the robot owns it; of a rest at the end it does not."""
    if slot.end is None or slot.end == authority:
        return slot.end is not None and not slot.resting
    return slot.end < authority


def _was_halted(track: Track, route: Sequence[Piece]) -> bool:
    """Had the scheduler before us taken back what is left of this route, others have perhaps been
    sent over it since: it knew of the route's last commit, and does not name it in its last plan.
    The same holds while that commit has nothing but a turn left, if it does not move: no harm.
    """
    last, newest = track.last, route[-1].commit
    if last is None or not track.owned or newest > last.commit or newest in last.commits:
        return False
    return newest < last.commit or not (last.moving and last.ready)


def _outstanding(report: Report) -> list[Piece]:
    """Reported pieces that are not driven to their end."""
    left = []
    for piece in sorted(report.route or (), key=lambda piece: piece.number):
        done = report.progress.along_m if piece.number == report.progress.piece else 0.0
        if piece.number >= report.progress.piece and done < piece.length_m - ARRIVED_M:
            left.append(piece)
    return left
