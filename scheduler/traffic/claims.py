"""Ground that somebody outside reserves: kept free of all robots but the owner's own.

A claim is *pending* until no robot holds or is promised a piece of it, and *owned* from then on
until it is dropped. From its first moment nobody commits a move over it, so what was committed
before drives on to its end, what stands there is sent out, and no robot ever waits for a claim in
the middle of its way: a pending claim queues behind all commits, an owned one is in nobody's way.
"""

from collections.abc import Iterable, Sequence, Set
from heapq import nsmallest
from typing import TypeAlias

import msgspec
import shapely

from ledger.ids import RobotName
from ledger.scene import XY
from scheduler.traffic.admission import NEVER
from scheduler.traffic.closures import Closures, lay_over, together
from scheduler.traffic.costs import INFINITE, WAYS_MAX, Costs
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.grants import Grants
from scheduler.traffic.placing import Entry
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.routes import ENTRY, Builder
from scheduler.traffic.track import Track
from scheduler.traffic.world import Closure, World

CLOSURES_MAX = 64  # kept: one for all strangers, and one for each robot that owns or leaves ground
NEAR_MAX = 8  # stops looked at for a robot that has to leave
FAR_S = 1_000.0  # there is no way on from such a stop, but it is one
WAY_MAX = 1_000  # moves looked at for the claim that is in a robot's way

Ids: TypeAlias = frozenset[str]
NONE: Ids = frozenset()


class Claim(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One reservation and what of the map it closes."""

    id: str
    owner: str
    shapes: tuple[int, ...]  # numbers in the grant table
    closed: Closure


class Summary(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All claims at once, for what is asked of every robot."""

    ids: Ids
    owners: frozenset[str]
    pending: Closure
    pending_shapes: frozenset[int]


class Claims:
    """The reservations of one area, and who may not go where for them."""

    def __init__(self, roadmap: Roadmap, grants: Grants, costs: dict[int, Costs]) -> None:
        """`costs` are those of the open map, by group."""
        self._open = roadmap
        self._roadmap: Roadmap | None = roadmap  # None = to be made anew
        self._grants = grants
        self._costs = costs
        self._claims: dict[str, Claim] = {}
        self._pending: set[str] = set()
        self._shapes: set[int] = set()  # of all claims
        self._heeded = True  # robots know of the last change
        self._summary: Summary | None = None  # None = to be made anew
        self._finder = Closures(roadmap)
        self._closures: dict[Ids, Closure] = {}
        self._held: dict[tuple[int, ...], Closure] = {}  # by the cells that a robot holds
        self._in_way: dict[tuple[int, int, float, int, Ids], tuple[str, ...]] = {}
        self._closed_costs: dict[tuple[int, Ids], Costs] = {}

    def __bool__(self) -> bool:
        """Is there anything that robots must heed, or need not heed any more."""
        return bool(self._claims) or not self._heeded

    # -- claims come and go

    def add(self, id_: str, owner: str, rings: Sequence[tuple[XY, ...]], *, owned: bool) -> None:
        """Reserve these polygons; `owned`: it was granted before, by a scheduler that is gone."""
        foreign = self._grants.shapes().items()
        bodies = {n: shapely.Polygon(body) for n, body in foreign if n not in self._shapes}
        shapes: list[int] = []
        cells: set[int] = set()
        for ring in rings:
            polygon = shapely.Polygon(ring)
            over = self._open.meeting(polygon)
            cells.update(over)
            met = [n for n, body in bodies.items() if body.intersects(polygon)]
            shape = self._grants.add_shape(ring, (*over, *met))
            self._grants.promise(shape, owner, NEVER)
            shapes.append(shape)
        closed = self._finder.over(cells)
        self._claims[id_] = Claim(id=id_, owner=owner, shapes=tuple(shapes), closed=closed)
        self._shapes.update(shapes)
        self._pending.add(id_)
        if owned:
            self._own(self._claims[id_])
        self._changed()

    def drop(self, id_: str) -> None:
        """Give the ground back."""
        claim = self._claims.pop(id_, None)
        if claim is None:
            return
        for shape in claim.shapes:
            if id_ in self._pending:
                self._grants.withdraw(shape, claim.owner, NEVER)
            else:
                self._grants.release(shape, claim.owner)
        self._shapes.difference_update(claim.shapes)
        self._pending.discard(id_)
        self._changed()

    def owned(self, id_: str) -> bool:
        """Is the ground free of robots, and will it stay so."""
        return id_ in self._claims and id_ not in self._pending

    def acquire(self) -> None:
        """Own what has come free, whole claims only."""
        for id_ in sorted(self._pending):
            claim = self._claims[id_]
            if all(self._grants.free(shape, claim.owner, NEVER) for shape in claim.shapes):
                self._own(claim)

    def _own(self, claim: Claim) -> None:
        for shape in claim.shapes:
            self._grants.fulfil(shape, claim.owner, NEVER)
        self._pending.discard(claim.id)
        self._summary = None

    def _changed(self) -> None:
        self._closures.clear()
        self._closed_costs.clear()
        self._in_way.clear()
        self._roadmap = None
        self._heeded = False
        self._summary = None

    def _all(self) -> "Summary":
        if self._summary is None:
            pending = [self._claims[id_] for id_ in self._pending]
            self._summary = Summary(
                ids=frozenset(self._claims),
                owners=frozenset(claim.owner for claim in self._claims.values()),
                pending=together(claim.closed for claim in pending),
                pending_shapes=frozenset(shape for claim in pending for shape in claim.shapes),
            )
        return self._summary

    @property
    def roadmap(self) -> Roadmap:
        """The map with the dead ends that the claims make: a lane reserved in its middle is two.
        Made when it is asked for, as claims come by the hundred.
        """
        if self._roadmap is None:
            self._roadmap = self._finder.with_dead_ends(self.closure(self._all().ids))
        return self._roadmap

    def ways_changed(self) -> None:
        """The costs of the open map are others now."""
        self._closed_costs.clear()
        self._in_way.clear()

    # -- what they close, and for whom

    def closure(self, ids: Ids) -> Closure:
        """Give what these claims close."""
        found = self._closures.get(ids)
        if found is None:
            found = together(self._claims[id_].closed for id_ in ids)
            if len(self._closures) >= CLOSURES_MAX:
                self._closures.clear()
            self._closures[ids] = found
        return found

    def barring(self, track: Track) -> Ids:
        """Claims that this robot must keep off: not its own, and not one that it has to leave."""
        leaving = self._left_by(track)
        if not leaving and track.name not in self._all().owners:
            return self._all().ids
        return frozenset(
            claim.id
            for claim in self._claims.values()
            if claim.owner != track.name and claim.id not in leaving
        )

    def _left_by(self, track: Track) -> Ids:
        """Pending claims on whose ground it rests."""
        rests = track.driven and not track.promised
        on = self._all().pending.holds(track.place)
        if not self._pending or not (on or rests):
            return NONE
        cells: set[int] = set()
        if rests:
            cells.update(c for slot in track.owned for c in self._grants.excluded(slot.cell))
        if not on and cells.isdisjoint(self._all().pending_shapes):
            return NONE
        claims = [self._claims[id_] for id_ in self._pending]
        return frozenset(
            claim.id
            for claim in claims
            if claim.closed.holds(track.place) or not cells.isdisjoint(claim.shapes)
        )

    def bars(self, track: Track, cells: Iterable[int]) -> bool:
        """Would the robot be on reserved ground if it had these cells."""
        return not self.closure(self.barring(track)).cells.isdisjoint(cells)

    def bars_entry(self, track: Track, entry: Entry) -> bool:
        """May this not be the way of a robot to its first stop: it may lead off pending ground, but
        never end on any.
        """
        if not self._claims:
            return False
        others = frozenset(c.id for c in self._claims.values() if c.owner != track.name)
        heading = track.report.heading_rad if track.report is not None else 0.0
        build = Builder(self._open, track.footprint, entry.point, heading, track.piece_next)
        build.drive(entry.legs, ENTRY, 0)
        build.rest()
        within = bool(self.closure(others).places >> entry.place & 1)
        return within or self.bars(track, (slot.cell for slot in build.slots))

    def _costs_of(self, track: Track, ids: Ids) -> Costs:
        closure = self.closure(ids)
        if not closure.moves and not closure.turns:
            return self._costs[track.group]
        found = self._closed_costs.get((track.group, ids))
        if found is None:
            found = self._costs[track.group].closed(closure.moves, closure.turns)
            if len(self._closed_costs) >= CLOSURES_MAX:
                self._closed_costs.clear()
            self._closed_costs[track.group, ids] = found
        return found

    # -- ground that robots hold otherwise than the map foresees

    def lay_over(self, world: World, tracks: Iterable[Track]) -> None:
        """Close to the planner what lost robots hold, for good; and what others hold off their
        points, until they have left their places.
        """
        held: list[tuple[str, int | None, Closure]] = []
        for track in tracks:
            slots = (*track.owned, *track.promised) if track.lost else track.owned
            cells = tuple(s.cell for s in slots if track.lost or self._grants.is_shape(s.cell))
            if cells:
                place = None if track.lost else track.place
                held.append((track.name, place, self._under(cells)))
        lay_over(world, held)

    def _under(self, cells: tuple[int, ...]) -> Closure:
        """What is closed while a robot holds these cells: shapes are dropped, but never changed."""
        found = self._held.get(cells)
        if found is None:
            over = {c for cell in cells for c in self._grants.excluded(cell)}
            found = self._finder.over(c for c in over if not self._grants.is_shape(c))
            if len(self._held) >= CLOSURES_MAX:
                self._held.clear()
            self._held[cells] = found
        return found

    # -- what becomes of the robots

    def heed(self, tracks: Iterable[Track]) -> None:
        """Direct robots anew if claims have come or gone; they come by the hundred."""
        if not self._heeded:
            self.direct(tracks)

    def direct(self, tracks: Iterable[Track]) -> None:
        """Give every robot the map that is open to it, and note whose goal is not to be had."""
        self._heeded = True
        for track in tracks:
            ids = self.barring(track)
            track.costs = self._costs_of(track, ids)
            track.barred = ()
            if track.place is not None and track.goal is not None and ids:
                track.barred = self.in_way(track, track.goal)

    def in_way(self, track: Track, goal: int) -> tuple[str, ...]:
        """Owners whose claims alone keep a robot from this place; empty = it can get there, or
        could not anyway.
        """
        if not self._claims or track.place is None:
            return ()
        place, heading = track.place, track.heading_rad
        open_costs = self._costs[track.group]
        if track.costs is open_costs or track.costs.cost_s(place, heading, goal) < INFINITE:
            return ()
        ids = self.barring(track)
        key = track.group, place, heading, goal, ids
        found = self._in_way.get(key)
        if found is None:
            found = self._first_in_way(open_costs, place, heading, goal, ids)
            if len(self._in_way) >= WAYS_MAX:
                self._in_way.clear()
            self._in_way[key] = found
        return found

    def _first_in_way(
        self, costs: Costs, place: int, heading: float, goal: int, ids: Ids
    ) -> tuple[str, ...]:
        """Follow the way over the open map to the first claim on it."""
        if costs.cost_s(place, heading, goal) == INFINITE:
            return ()
        barring = [self._claims[id_] for id_ in sorted(ids)]
        for _ in range(WAY_MAX):
            ways = [] if place == goal else costs.ways(place, heading, goal)
            if not ways:
                break
            _, move = min(ways)
            turn = turn_rad(heading, self._open.heading_start[move])
            point = self._open.places.point[place]
            found = {
                c.owner
                for c in barring
                if move in c.closed.moves or (turn and point in c.closed.turns)
            }
            if found:
                return tuple(sorted(found))
            place, heading = self._open.moves.end[move], self._open.heading_end[move]
        return tuple(sorted({claim.owner for claim in barring}))

    def send_out(self, tracks: Sequence[Track], fixed: Set[RobotName]) -> None:
        """Send robots that rest on pending ground to a free stop off it, whatever else they want:
        somebody waits for the ground. Who is about to work where it stands may first do that.

        A robot keeps to the stop that it was sent to, for as long as that is free: from stop to
        stop the nearest one changes, and one was seen to drive to and fro on the ground for ever.
        """
        for track in tracks:
            track.leaving = False
        if not self._pending:
            for track in tracks:
                track.exit = None
            return
        closed = self.closure(self._all().ids).places
        wanted = (place for t in tracks for place in (t.place, t.goal, t.relocation))
        taken = {place for place in wanted if place is not None}
        for track in tracks:
            here, exit_, track.exit = track.place, track.exit, None
            if here is None or here == track.goal or track.name in fixed:
                continue
            if not any(self._claims[c].owner != track.name for c in self._left_by(track)):
                continue
            if exit_ is not None and self._still_leads_out(track, exit_, closed, tracks):
                track.leaving, track.relocation, track.exit = True, exit_, exit_
                continue
            free = (
                (cost, place)
                for place in range(self._open.places.stops)
                if place not in taken
                and not closed >> place & 1
                and (cost := track.costs.cost_s(here, track.heading_rad, place)) < INFINITE
            )
            near = [(self._price(track, *stop), stop[1]) for stop in nsmallest(NEAR_MAX, free)]
            if near:
                found = min(near)[1]
                track.leaving, track.relocation, track.exit = True, found, found
                taken.add(found)

    def _still_leads_out(
        self, track: Track, place: int, closed: int, tracks: Sequence[Track]
    ) -> bool:
        if closed >> place & 1 or track.place is None:
            return False
        if track.costs.cost_s(track.place, track.heading_rad, place) == INFINITE:
            return False
        others = (other for other in tracks if other is not track)
        return all(place not in (o.place, o.goal, o.relocation) for o in others)

    def _price(self, track: Track, cost_s: float, place: int) -> tuple[bool, float]:
        """Dead ends last; and rather on its way than back."""
        onward_s = 0.0
        if track.goal is not None and not track.barred:
            onward_s = track.costs.cost_s(place, track.heading_rad, track.goal)
        return self.roadmap.pockets.pocket[place] >= 0, cost_s + min(onward_s, FAR_S)
