"""One robot as traffic follows it: its route in cells, and what it has been told of it."""

from collections import deque
from collections.abc import Iterator, Mapping
from typing import TypeAlias

import msgspec

from ledger.ids import PathKey, RobotName
from ledger.link import Drive, Mark, Piece, Plan, Report, Turn
from ledger.scene import XY, Kinematics
from scheduler.traffic.costs import Costs
from scheduler.traffic.grants import Grants
from scheduler.traffic.kinematics import braking_m

LATENCY_S = 0.3  # from a report to the answer on board
REPORT_S = 0.1  # from one report to the next
SLACK_M = 0.6
ARRIVED_M = 0.02  # this near to its end a route counts as driven
ALONG_EPS = 1e-3  # metres or radians: reports are rounded
RESEND_MS = 1_000  # a Drive that shows no effect for so long is sent again
START = Mark()

# Ground of shut doors: for each of them the cells from which one may still go on.
Shut: TypeAlias = Mapping[int, tuple[frozenset[int], ...]]


class Slot(msgspec.Struct, kw_only=True):
    """One cell of a route, left behind when progress reaches `end`."""

    cell: int
    end: Mark | None  # None = only when the first cell of the next route is left
    commit: int
    standing: bool = False  # ground it was found on: it may stay there, which is no leave to drive
    resting: bool = False  # the place at the end of a commit; dropped if the route goes on in time

    def is_behind(self, progress: Mark) -> bool:
        """Has the reference point left it."""
        if self.end is None:
            return False
        if self.end.piece != progress.piece:
            return self.end.piece < progress.piece
        return self.end.along_m <= progress.along_m + ALONG_EPS


class Track(msgspec.Struct, kw_only=True):
    """What is known of one robot. `owned` is never empty once the robot is placed."""

    name: RobotName
    group: int
    footprint: int
    limits: Kinematics
    costs: Costs
    placed: bool = False  # its ground is claimed; without a place it is an obstacle
    last: Plan | None = None  # until then: what the scheduler before us intended with it
    trouble: str | None = "RobotNotHeard"  # why it cannot be moved
    place: int | None = None  # where its committed moves end
    heading_rad: float = 0.0  # there
    lost: bool = False
    session: str = ""
    session_before: str = ""  # reported until the robot has got the first message of the new one
    confirmed: bool = False  # the robot has reported the session
    piece_next: int = 1
    owned: deque[Slot] = msgspec.field(default_factory=deque)
    promised: deque[Slot] = msgspec.field(default_factory=deque)
    pieces: deque[tuple[Piece, float]] = msgspec.field(default_factory=deque)  # and way before it
    way_m: float = 0.0  # of all pieces ever
    progress: Mark = START
    end: Mark = START  # of the route
    sent_piece: int = 0
    sent_authority: Mark = START
    sent_ms: int = 0
    asked_ms: int | None = None  # TellRoute
    asking: bool = False
    report: Report | None = None
    seen_m: XY = (0.0, 0.0)  # where it was when it was placed
    seen_rad: float = 0.0
    goal: int | None = None  # place
    best_s: float = 0.0  # nearest to the goal so far
    best_ms: int = 0
    arrived_ms: int | None = None
    relocation: int | None = None  # place to make way to
    exit: int | None = None  # place that it leaves reserved ground for, until it is off it
    leaving: bool = False  # it rests on ground that somebody waits for
    barred: tuple[str, ...] = ()  # owners of reserved ground, or doors, that keep it from its goal
    commit: int = 0
    reshaping: bool = False  # it has not the ground of its class yet where it rests
    crowded_by: tuple[str, ...] = ()  # who is in the way of that
    stray: Slot | None = None  # its body, first of `owned`, where its other ground does not hold it
    state: tuple[bool, bool] = (True, True)  # near its end, resting there: when last looked at

    @property
    def aim(self) -> int | None:
        """Where it is to go now: while its goal is not to be had, only out of the way."""
        if self.goal is None or self.leaving or (self.barred and self.goal != self.place):
            return self.relocation
        return self.goal

    # -- the route

    @property
    def authority(self) -> Mark:
        """How far it may drive: to the end of the last cell that it owns."""
        for slot in reversed(self.owned):
            if not slot.standing and slot.end is not None:
                return slot.end
        return START

    @property
    def driven(self) -> bool:
        """Is nothing left of its route."""
        if not self.pieces:
            return True
        last, progress = self.pieces[-1][0], self.progress
        if last.number != progress.piece:
            return last.number < progress.piece
        return progress.along_m >= last.length_m - ARRIVED_M

    @property
    def arrived(self) -> bool:
        """Is it at the end itself. One that was stopped just before it is as good as driven for
        those who plan, but drives on once it may, and would refuse to act.
        """
        end, here = self.end, self.progress
        return self.driven and here >= Mark(piece=end.piece, along_m=end.along_m - ALONG_EPS)

    def way_to_m(self, mark: Mark) -> float:
        """Metres from the beginning of its route to a mark that is not behind it."""
        for piece, before in self.pieces:
            if piece.number >= mark.piece:
                driven = piece.number == mark.piece and piece.path is not None
                return before + (min(mark.along_m, piece.length_m) if driven else 0.0)
        return self.way_m

    def left_m(self) -> float:
        """What is left of its route in metres; turns count nothing."""
        for piece, before in self.pieces:
            if piece.number >= self.progress.piece:
                done = before
                if piece.number == self.progress.piece and piece.path is not None:
                    done += min(self.progress.along_m, piece.length_m)
                return self.way_m - done
        return 0.0

    @property
    def near(self) -> bool:
        """Is it so near to the end of its route that the next move must be committed: at the speed
        it has, not the one it may have. What is committed cannot be planned otherwise any more, so
        who has not set out is not near (30 robots on a fine lattice: 0.73 of free flow, not 0.65).
        """
        left_m = self.left_m()
        if left_m <= SLACK_M:
            return True
        speed = 0.0 if self.report is None else abs(self.report.speed_mps)
        speed += self.limits.acceleration_mps2_max * (LATENCY_S + REPORT_S)
        speed = min(speed, self.limits.speed_mps_max)
        return left_m <= braking_m(self.limits, speed) + speed * LATENCY_S + SLACK_M

    @property
    def standing(self) -> bool:
        """Does it not move, by its own report."""
        report = self.report
        return report is not None and abs(report.speed_mps) < 0.01 and abs(report.turn_radps) < 0.01

    def untravelled(self) -> list[tuple[PathKey, int]]:
        """Paths still to be driven, the one it is on included, and under which commit numbers;
        parts of one count once.
        """
        if not self.placed:
            last = self.last
            return [] if last is None else [*zip(last.untravelled, last.commits, strict=False)]
        left: list[tuple[PathKey, int]] = []
        for piece in self._left():
            if piece.path is not None and not (left and left[-1][0] == piece.path):
                left.append((piece.path, piece.commit))
        return left

    def turns(self) -> tuple[Turn, ...]:
        """Turns in place still to be made."""
        if not self.placed:
            return () if self.last is None else self.last.turns
        left = (piece for piece in self._left() if piece.path is None)
        return tuple(Turn(at_m=piece.curve[0], commit=piece.commit) for piece in left)

    def _left(self) -> Iterator[Piece]:
        """Pieces that are not driven to their end."""
        at = self.progress
        for piece, _ in self.pieces:
            if piece.number > at.piece or (
                piece.number == at.piece and at.along_m < piece.length_m - ARRIVED_M
            ):
                yield piece

    def extend(self, pieces: list[Piece], slots: list[Slot], grants: Grants) -> None:
        """Append a committed move: its pieces to the route, its cells as promises."""
        rest = self.promised[-1] if self.promised else self.owned[-1]
        if rest.resting and self.promised and not self._counted_on(grants):
            self.promised.pop()
            grants.withdraw(rest.cell, self.name, rest.commit)
        elif rest.resting:
            pieces[0] = msgspec.structs.replace(pieces[0], from_rest=True)
        first = next((piece for piece in pieces if piece.path is not None), pieces[0])
        left = next(slot.end for slot in slots if slot.end and slot.end.piece == first.number)
        for slot in self.owned:
            if slot.end is None:
                slot.end = left
        for piece in pieces:
            self.pieces.append((piece, self.way_m))
            self.way_m += piece.length_m if piece.path is not None else 0.0
        for slot in slots:
            self.promised.append(slot)
            grants.promise(slot.cell, self.name, slot.commit)
        self.piece_next = pieces[-1].number + 1
        self.end = Mark(piece=pieces[-1].number, along_m=pieces[-1].length_m)
        self.commit = pieces[-1].commit

    def _counted_on(self, grants: Grants) -> bool:
        """Has somebody else been promised ground since that it only gives up when it rests. Without
        that rest it would wait for them on the end of its way there, and they for it.
        """
        rest = self.promised[-1]
        before = self.promised[-2] if len(self.promised) > 1 else self.owned[-1]
        return grants.awaited(before.cell, self.name, rest.commit)

    def acquire(self, grants: Grants, shut: Shut) -> bool:
        """Own as many of the next cells as are free and not behind a shut door."""
        any_taken = False
        while self.promised:
            slot = self.promised[0]
            if not grants.free(slot.cell, self.name, slot.commit):
                break
            if shut and not self.may_enter(slot.cell, shut):
                break
            self.promised.popleft()
            grants.fulfil(slot.cell, self.name, slot.commit)
            self.owned.append(slot)
            any_taken = True
        return any_taken

    def may_enter(self, cell: int, shut: Shut) -> bool:
        """Does no shut door keep it from this cell; one that it is in already may not."""
        return all(any(slot.cell in within for slot in self.owned) for within in shut.get(cell, ()))

    def release(self, grants: Grants) -> bool:
        """Give up the cells that the reference point has left; the last owned one is kept."""
        any_left = False
        while len(self.owned) > 1 and self.owned[0].is_behind(self.progress):
            grants.release(self.owned.popleft().cell, self.name)
            any_left = True
        while len(self.pieces) > 1 and self.pieces[0][0].number < self.progress.piece:
            self.pieces.popleft()
        return any_left

    def cut_back(self, grants: Grants) -> None:
        """Keep the ground that it owns, and no more of its route than reaches to its end."""
        for slot in self.promised:
            grants.withdraw(slot.cell, self.name, slot.commit)
        self.promised.clear()
        while self.pieces and self.pieces[-1][0].number > self.sent_piece:
            self.pieces.pop()

    def let_go(self, grants: Grants) -> None:
        """Give up everything: the robot is gone, or stands somewhere else."""
        for slot in self.owned:
            grants.release(slot.cell, self.name)
        for slot in self.promised:
            grants.withdraw(slot.cell, self.name, slot.commit)
        self.owned.clear()
        self.stray = None
        self.promised.clear()
        self.pieces.clear()
        self.end = self.progress

    def forget(self, owned: int, promised: int, grants: Grants) -> None:
        """Give up the first so many of what it owns, and of what it is promised."""
        for _ in range(owned):
            grants.release(self.owned.popleft().cell, self.name)
        for _ in range(promised):
            slot = self.promised.popleft()
            grants.withdraw(slot.cell, self.name, slot.commit)

    # -- messages

    def is_old(self, report: Report) -> bool:
        """Not newer than what is known; a robot that started anew counts from the beginning."""
        known = self.report
        if known is None or report.number > known.number:
            return False
        return report.session == known.session or report.at_ms <= known.at_ms

    def advance(self, report: Report) -> None:
        """Progress only grows, and never beyond what was committed."""
        self.confirmed = True
        self.progress = min(max(self.progress, report.progress), self.end)

    def drive(self, now_ms: int) -> Drive | None:
        """What the robot has not been told yet, or shows no sign of having heard."""
        authority = self.authority
        fresh = tuple(piece for piece, _ in self.pieces if piece.number > self.sent_piece)
        if not fresh and authority <= self.sent_authority:
            if not self._unheard(now_ms):
                return None
            fresh = tuple(p for p, _ in self.pieces if p.number >= self.progress.piece)
        self.sent_authority = max(authority, self.sent_authority)
        self.sent_ms = now_ms
        if fresh:
            self.sent_piece = max(self.sent_piece, fresh[-1].number)
        return Drive(
            robot=self.name, session=self.session, authority=self.sent_authority, pieces=fresh
        )

    def _unheard(self, now_ms: int) -> bool:
        """Sent long ago, and not in the newest report."""
        if self.report is None or now_ms - self.sent_ms < RESEND_MS or not self.pieces:
            return False
        known = self.report.authority if self.report.session == self.session else START
        return known < self.sent_authority
