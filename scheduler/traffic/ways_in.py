"""How robots that were found between stops get to one, and who is halted for that."""

import math
from collections.abc import Iterable, Mapping, Sequence, Set
from typing import TypeAlias

from ledger.ids import RobotName
from ledger.scene import XY
from scheduler.traffic.admission import MOVED_M
from scheduler.traffic.claims import Claims
from scheduler.traffic.grants import Grants
from scheduler.traffic.placing import Entry
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.track import Track

Names: TypeAlias = set[RobotName]


def taken(tracks: Iterable[Track], but: Set[RobotName]) -> int:
    """Bits of the places of all but these."""
    bits = 0
    for track in tracks:
        if track.place is not None and track.name not in but:
            bits |= 1 << track.place
    return bits


class WaysIn:
    """Finds them; remembers who was halted for whom."""

    def __init__(
        self,
        roadmap: Roadmap,
        grants: Grants,
        reserved: Claims,
        tracks: Mapping[RobotName, Track],
    ) -> None:
        """Take the tables and robots of one area."""
        self._roadmap, self._grants, self._reserved = roadmap, grants, reserved
        self._tracks = tracks
        self._halted_for: dict[RobotName, tuple[XY, Names]] = {}  # while they stand there

    def find(self, track: Track, ways: Sequence[Entry]) -> tuple[Entry, Names] | None:
        """Of these ways the one to the nearest stop that is free, if it keeps clear of those who
        are promised the ground that the robot rests on, and of who waits for them; if there is
        none, they are to be halted for it, and if need be whoever waits for them too. One that it
        was halted for itself is only halted if the way is free at once: else each would be halted
        for the other for ever.
        """
        ways = [way for way in ways if not self._reserved.bars_entry(track, way)]
        all_, rivals = self._tracks.values(), self.counting_on(track)
        behind, before = self._behind(rivals) - {track.name}, self._all_halted_for(track)
        others = taken(all_, {track.name})
        for way in ways:
            if not way.need & others and not (rivals and self._crosses(track, way, behind)):
                return way, set()
        for halted in (rivals, behind):
            others = taken(all_, halted | {track.name})
            again = not before.isdisjoint(halted)
            for way in ways if halted else ():
                if not way.need & others and (not again or self._is_free(track, way)):
                    places = {name: self._tracks[name].place for name in halted}
                    ended = {n for n, k in places.items() if k is not None and way.need >> k & 1}
                    return way, rivals | ended
        return None

    def counting_on(self, track: Track) -> Names:
        """Who is promised the ground that a robot rests on: they counted on its leaving, but it
        never heard of that before the scheduler started anew, or people have brought it there.
        Its next move would wait for their promises, and they for it, for ever. What it only has
        not given up yet, for it is just arriving, is not meant.
        """
        promised, excluded = self._grants.promised, self._grants.excluded
        kept = [slot for slot in track.owned if slot.standing or slot is track.owned[-1]]
        names = {n for slot in kept for cell in excluded(slot.cell) for n in promised(cell)}
        return {RobotName(n) for n in names - {track.name}} & self._tracks.keys()

    def halted(self, track: Track, other: RobotName) -> None:
        """Note that it was halted for another one."""
        self._halters(track).add(other)

    # -- whom they meet

    def _behind(self, robots: Names) -> Names:
        """These, and all that wait, or will, for one of them."""
        found = set[str](robots)
        more = bool(found)
        while more:
            more = False
            for track in self._tracks.values():
                if track.name not in found and any(
                    not found.isdisjoint(self._grants.blockers(s.cell, track.name, s.commit))
                    for s in track.promised
                ):
                    found.add(track.name)
                    more = True
        return {RobotName(name) for name in found}

    def _ground(self, track: Track, way: Entry) -> Iterable[int]:
        """All that excludes it on this way."""
        rest = self._roadmap.rest(track.footprint, self._roadmap.places.point[way.place])
        return (other for cell in (*way.cells, rest) for other in self._grants.excluded(cell))

    def _crosses(self, track: Track, way: Entry, others: Names) -> bool:
        """Is ground on this way owned by one of these, or promised to it."""
        owners, promised = self._grants.owners, self._grants.promised
        ground = self._ground(track, way)
        return any(n in others for cell in ground for n in (*owners(cell), *promised(cell)))

    def _is_free(self, track: Track, way: Entry) -> bool:
        """Does nobody else own any ground of this way."""
        names = {name for cell in self._ground(track, way) for name in self._grants.owners(cell)}
        return names <= {track.name}

    # -- who was halted for whom

    def _all_halted_for(self, track: Track) -> Names:
        """For whom it has been halted where it stands, and for whom they have been."""
        found, more = {track.name}, [track.name]
        while more:
            known = self._tracks.get(more.pop())
            fresh = set() if known is None else self._halters(known) - found
            found |= fresh
            more += fresh
        return found - {track.name}

    def _halters(self, track: Track) -> Names:
        """For whom it has been halted where it stands."""
        report, none = track.report, set[RobotName]()
        here_m = track.seen_m if report is None else (report.x_m, report.y_m)
        at_m, found = self._halted_for.get(track.name, (here_m, none))
        if math.dist(at_m, here_m) > MOVED_M:
            at_m, found = here_m, none
        self._halted_for[track.name] = at_m, found
        return found
