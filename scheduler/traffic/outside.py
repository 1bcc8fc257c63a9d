"""Robots found between stops for which no way to one comes free: a person is told of them.

They are no agents of the planner, so the ladder, which looks after those, does not see them.
"""

from collections.abc import Iterable, Mapping, Set

from ledger.ids import RobotName
from ledger.scene import XY
from scheduler.traffic.admission import OLD_ROUTE, Admission
from scheduler.traffic.grants import Grants
from scheduler.traffic.ladder import NAMED_MAX, WORKING_MS, Stuck
from scheduler.traffic.placing import Entry
from scheduler.traffic.track import Track


class Outside:
    """Remembers since when each of them has stood where it stands."""

    def __init__(self, grants: Grants, admission: Admission) -> None:
        """Take the tables of one area."""
        self._grants, self._admission = grants, admission
        self._since_ms: dict[RobotName, tuple[XY, int]] = {}

    def look(self, tracks: Iterable[Track], fixed: Set[RobotName], now_ms: int) -> None:
        """Take in who stands there now. Those that are to stand still, and those that do not
        answer, are somebody else's.
        """
        before, self._since_ms = self._since_ms, {}
        for track in tracks:
            if track.placed and track.place is None and not track.lost and track.name not in fixed:
                at_m, since_ms = before.get(track.name, (track.seen_m, now_ms))
                moved = at_m != track.seen_m
                self._since_ms[track.name] = track.seen_m, now_ms if moved else since_ms

    def stuck(self, tracks: Mapping[RobotName, Track], now_ms: int) -> dict[RobotName, Stuck]:
        """Those that have stood there for too long."""
        return {
            name: self._told(tracks[name], tracks, since_ms)
            for name, (_, since_ms) in self._since_ms.items()
            if now_ms - since_ms >= WORKING_MS and name in tracks
        }

    def _told(self, track: Track, tracks: Mapping[RobotName, Track], since_ms: int) -> Stuck:
        ways = self._admission.entries.get(track.name, [])
        names = {name for way in ways for name in self._in_way(way, tracks)} - {track.name}
        robots = tuple(sorted(names & tracks.keys()))[:NAMED_MAX]
        if track.trouble == OLD_ROUTE:
            why = "does not come to the end of the route that it had"
        elif not ways:
            why = "stands where no way to a stop begins"
        elif robots:
            why = f"stands between stops, and on every way to one there is {', '.join(robots)}"
        else:
            why = "stands between stops, and the ways to them are kept by others"
        claims = tuple(sorted(names - tracks.keys()))[:NAMED_MAX]
        text = f"{track.name} {why}"
        return Stuck(robot=track.name, since_ms=since_ms, text=text, robots=robots, claims=claims)

    def _in_way(self, way: Entry, tracks: Mapping[RobotName, Track]) -> set[RobotName]:
        owners = self._grants.owners
        cells = {other for cell in way.cells for other in self._grants.excluded(cell)}
        found = {RobotName(name) for cell in cells for name in owners(cell)}
        return found | {
            other.name
            for other in tracks.values()
            if other.place is not None and way.need >> other.place & 1
        }
