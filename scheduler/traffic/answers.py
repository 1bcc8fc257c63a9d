"""The questions that dispatch asks of traffic (`scheduler.roads.Roads`): they change nothing."""

from collections.abc import Mapping

from ledger.ids import PointName, RobotName
from scheduler.traffic.claims import Claims
from scheduler.traffic.costs import INFINITE
from scheduler.traffic.execution import Execution
from scheduler.traffic.ladder import Ladder, Stuck
from scheduler.traffic.outside import Outside
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.track import Track
from scheduler.traffic.waits import Waits

HEADING_OK_RAD = 0.1  # a heading demanded on arrival counts as met within this


class Answers:
    """What can be said of one area; `Traffic` is one that also moves its robots."""

    roadmap: Roadmap
    _execution: Execution
    _reserved: Claims
    _ladder: Ladder
    _outside: Outside
    _waits: Waits

    @property
    def _tracks(self) -> dict[RobotName, Track]:
        return self._execution.tracks

    @property
    def ready(self) -> bool:
        """Has every robot that is not lost been placed."""
        return all(track.placed or track.lost for track in self._tracks.values())

    def trouble(self, robot: RobotName) -> str | None:
        """Code of the reason why a robot cannot be moved; None if it can."""
        track = self._tracks.get(robot)
        return None if track is None else track.trouble

    def stands_at(self, robot: RobotName, point: PointName) -> bool:
        """Does it rest there with nothing committed beyond: a state, not an event."""
        track = self._tracks.get(robot)
        place = self.roadmap.place.get(point)
        if track is None or place is None or track.place != place or track.trouble is not None:
            return False
        if not track.arrived or not track.standing or track.report is None:
            return False
        return abs(self.roadmap.final_turn_rad(place, track.report.heading_rad)) <= HEADING_OK_RAD

    def has_room(self, robot: RobotName) -> bool:
        """Does it own the ground of a loaded robot where it rests."""
        track = self._tracks.get(robot)
        if track is None or track.trouble is not None:
            return False
        loaded = self.roadmap.classes.of(track.group, loaded=True)
        return track.footprint == loaded and not track.reshaping

    def cost_s(self, robot: RobotName, point: PointName) -> float:
        """Seconds of driving from where its committed moves end; infinite = no way."""
        self._reserved.heed(self._tracks.values())
        track = self._tracks.get(robot)
        place = self.roadmap.place.get(point)
        if track is None or place is None or track.place is None:
            return INFINITE
        return track.costs.cost_s(track.place, track.heading_rad, place)

    def reserved(self, robot: RobotName, point: PointName) -> tuple[str, ...]:
        """Owners whose reserved ground alone keeps the robot from there; empty = none does."""
        self._reserved.heed(self._tracks.values())
        track = self._tracks.get(robot)
        place = self.roadmap.place.get(point)
        return () if track is None or place is None else self._reserved.in_way(track, place)

    @property
    def breaches_so_far(self) -> int:
        """How often the guard has found what must not be."""
        return self._execution.guard.count

    def stuck(self, now_ms: int) -> Mapping[RobotName, Stuck]:
        """Robots that a person has to help, and what is in their way."""
        tracks = self._tracks
        return {**self._ladder.stuck(tracks, now_ms), **self._outside.stuck(tracks, now_ms)}

    @property
    def ladder(self) -> Mapping[str, int]:
        """How often a way was searched and found for who was stuck, and a person told."""
        return self._ladder.counted.words()

    @property
    def pushes(self) -> int:
        """How many robots have been sent out of the way of others."""
        return self._waits.pushes

    @property
    def plannings(self) -> Mapping[str, int]:
        """How often it was planned, by what made it due."""
        return self._waits.plannings
