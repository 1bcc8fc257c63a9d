"""The execution layer under every planner: moves are committed, and their ground is granted.

Planners only propose an order of moves. A move is committed when no other robot's committed moves
end where it needs room, and from then on its ground is granted cell by cell, in commit order.
"""

from collections.abc import Iterable

from ledger.ids import RobotName
from scheduler.traffic.admission import Admission
from scheduler.traffic.claims import Claims
from scheduler.traffic.grants import Grants
from scheduler.traffic.guard import Guard
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.routes import Builder, Leg
from scheduler.traffic.safe import Safe
from scheduler.traffic.track import Shut, Track
from scheduler.traffic.waits import Outcome
from scheduler.traffic.ways_in import WaysIn, taken
from scheduler.traffic.world import World, room, turning_room


class Execution:
    """Numbers commits and gives out ground; the robots it knows are those of `tracks`."""

    def __init__(
        self, roadmap: Roadmap, grants: Grants, admission: Admission, reserved: Claims
    ) -> None:
        """Take the tables of one area."""
        self._roadmap, self._grants = roadmap, grants
        self._admission, self._reserved = admission, reserved
        self.guard = Guard(roadmap, grants)
        self._last = 0
        self._sent: set[RobotName] = set()  # by us, not by a scheduler before
        self.tracks: dict[RobotName, Track] = {}  # by name, ascending
        self.touched: set[RobotName] = set()  # there is something to tell them
        self.freed = False  # ground, since the last `acquire`
        self.turns_ahead = False
        self._ways_in = WaysIn(roadmap, grants, reserved, self.tracks)

    def add(self, track: Track) -> None:
        """One robot more."""
        robots = sorted([*self.tracks.items(), (track.name, track)])
        self.tracks.clear()
        self.tracks.update(robots)

    def adopt_numbers(self, track: Track) -> None:
        """Go on behind the numbers that a robot has brought along from before our start."""
        numbers = [slot.commit for slot in (*track.owned, *track.promised)]
        self._last = max([self._last, track.commit, *numbers])

    def fit_in(self, track: Track) -> None:
        """Reconcile a route from before our start with what has been done before it was heard of.
        If somebody has been sent over it since, it is driven no further than is granted: its low
        numbers would go before theirs, on ground that they have already. Whoever only stands where
        it ends, or too near to that, has to go elsewhere: two robots at one place do not see each
        other.
        """
        if track.place is None or not track.pieces:
            return
        wanted = {cell for slot in track.promised for cell in self._grants.excluded(slot.cell)}
        for other in self.tracks.values():
            if other is track or other.name not in self._sent:
                continue
            if any(slot.cell in wanted for slot in (*other.owned, *other.promised)):
                self._admission.halt(track)
                return
        excluded = self._roadmap.places.conflict[track.place] | 1 << track.place
        for other in self.tracks.values():
            if other is track or other.place is None or other.pieces or other.report is None:
                continue
            if excluded >> other.place & 1:
                self._admission.put_anew(other, other.report, self.taken(other))
                self.touched.add(other.name)
                self.freed = True

    def taken(self, track: Track) -> int:
        """Bits of the places of all others."""
        return taken(self.tracks.values(), {track.name})

    def reshape(self) -> None:
        """Give those at rest whose class has changed the ground of the new one, if it is free."""
        for track in self.tracks.values():
            if track.reshaping and self._admission.reshape(track, self.taken(track)):
                self.freed = True

    def look(self, now_ms: int) -> None:
        """Have the guard look, and keep the ground under robots that are not on their own."""
        if self.guard.look(self.tracks.values(), now_ms):
            for track in self.tracks.values():
                strays = track.name in self.guard.strays
                if strays or track.stray is not None:
                    self._admission.follow(track, strays=strays)
                    self.freed = True

    def acquire(self, shut: Shut) -> None:
        """Grant ground in commit order, until nothing more comes free by it."""
        self.freed = False
        held = self.guard.held
        known = [track for track in self.tracks.values() if track.placed and not track.lost]
        waiting = [track for track in known if track.promised and track.name not in held]
        waiting.sort(key=lambda track: (track.promised[0].commit, track.name))
        again = True
        while again:
            again = False
            for track in waiting:
                if track.acquire(self._grants, shut):
                    self.touched.add(track.name)
                    again = track.release(self._grants) or again
        self._reserved.acquire()

    def enter(self, still: Iterable[RobotName]) -> None:
        """Send robots that were found between stops to the nearest stop that is free; not those
        that are to stand still.
        """
        fixed = frozenset(still)
        for name in sorted(self._admission.entries):
            track = self.tracks[RobotName(name)]
            if track.lost or name in fixed:
                continue
            found = self._ways_in.find(track, self._admission.entries[track.name])
            if found is not None:
                entry, in_way = found
                self._halt(in_way, track)
                self._last += 1
                self._admission.enter(track, entry, self._last)
                self._sent.add(track.name)
                self.touched.add(track.name)

    def _halt(self, names: Iterable[RobotName], track: Track) -> None:
        """Halt these, for this one."""
        for name in sorted(names):
            self._ways_in.halted(self.tracks[name], track.name)
            self._admission.halt(self.tracks[name])
            self.freed = True

    def admit(
        self,
        world: World,
        proposed: Iterable[tuple[str, tuple[int, ...]]],
        safe: Safe | None = None,
    ) -> list[Outcome]:
        """Commit what can be now of what a planner has proposed for this world, in its order, and
        if asked for, what is safe.
        """
        outcomes: list[Outcome] = []
        positions = 0
        for track in self.tracks.values():
            if track.place is not None:
                positions |= 1 << track.place
        for name, moves in proposed:
            track = self.tracks[RobotName(name)]
            if track.place is None:  # halted just now, for another one
                continue
            here = 1 << track.place
            goal = track.aim
            need = room(world, track.place, track.heading_rad, moves, goal) & ~here
            before = track.place, track.heading_rad, track.commit
            if track.near and not need & positions and (safe is None or safe.take(name, moves)):
                if track.driven:
                    self._halt(self._ways_in.counting_on(track), track)
                ahead = self._ahead(world, track, moves, goal, positions & ~here)
                self._commit(track, moves, goal, ahead)
                positions = positions & ~here | 1 << track.place
            outcomes.append(
                Outcome(
                    robot=track.name,
                    place=before[0],
                    heading_rad=before[1],
                    need=need,
                    committed=track.commit != before[2],
                    unsafe_with=() if safe is None else safe.rings.get(name, ()),
                )
            )
        return outcomes

    def _ahead(
        self, world: World, track: Track, moves: tuple[int, ...], goal: int | None, others: int
    ) -> float | None:
        """The heading to turn to where the moves end, for the move that will be the best from
        there; None = none, or there is no room. Ground asked for in advance is not reserved ground.
        """
        if not (self.turns_ahead and moves and goal is not None) or self._reserved:
            return None
        place = self._roadmap.moves.end[moves[-1]]
        heading = self._roadmap.heading_end[moves[-1]]
        ways = [] if place == goal else track.costs.ways(place, heading, goal)
        point = self._roadmap.places.point[place]
        if not ways or point in world.closed_turns or turning_room(world, place) & others:
            return None
        move = min(ways)[1]
        if not room(world, place, heading, (move,), goal) & ~(1 << place) & others:
            return None  # it goes on at once, and by then perhaps another way
        return self._roadmap.heading_start[move]

    def _commit(
        self, track: Track, moves: tuple[int, ...], goal: int | None, ahead: float | None
    ) -> None:
        """Append moves to a route, each under the next number; () is the turn that a goal asks."""
        assert track.place is not None
        roadmap, place = self._roadmap, track.place
        point = roadmap.places.point[place]
        build = Builder(roadmap, track.footprint, point, track.heading_rad, track.piece_next)
        for move in moves:
            self._last += 1
            build.drive([Leg(path=k) for k in roadmap.moves.paths[move]], move, self._last)
            place = roadmap.moves.end[move]
        demanded = roadmap.net.points[roadmap.places.point[place]].heading_rad
        if place == goal and roadmap.turning[place] and demanded is not None:
            if not moves:
                self._last += 1
            build.turn(demanded, moves[-1] if moves else -1, self._last)
        if ahead is not None and build.pieces:
            build.turn(ahead, moves[-1], self._last)
        if not build.pieces:
            return
        build.rest()
        if self._reserved and self._reserved.bars(track, (slot.cell for slot in build.slots)):
            return  # the planner does not propose it; what is reserved must not hang on that
        track.place = place
        track.extend(build.pieces, build.slots, self._grants)
        self._sent.add(track.name)
        track.heading_rad, track.state = build.heading_rad, (track.near, False)
        track.arrived_ms = None
        self.touched.add(track.name)
