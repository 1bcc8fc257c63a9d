"""The control against which traffic is measured: robots that pass through each other, unguided.

Same robots, delays and service as on a `Floor`; what is lost between the two is traffic's.
"""

import math
from collections.abc import Mapping, Sequence, Set

from ledger.ids import PointName, RobotName
from ledger.link import Drive, Report
from ledger.scene import Area, Group
from scheduler.goal import Goal
from scheduler.traffic.compile import compile_area
from scheduler.traffic.costs import INFINITE, Costs
from scheduler.traffic.routes import Builder, Leg


class FreeFlow:
    """Stands in for `Traffic`: the cheapest way to the goal, all of it granted at once."""

    def __init__(
        self,
        area: Area,
        groups: Sequence[Group],
        starts: Mapping[str, tuple[str, float]],
        group_of: Mapping[str, int],
    ) -> None:
        self.roadmap = compile_area(area, groups, None)
        made = {g.id: Costs(self.roadmap, g.kinematics) for g in self.roadmap.groups.values()}
        self.group_of = group_of
        self.costs = {name: made[group_of[name]] for name in starts}
        self.place = {name: self.roadmap.place[PointName(at)] for name, (at, _) in starts.items()}
        self.heading = {name: heading for name, (_, heading) in starts.items()}
        self.next = dict.fromkeys(starts, 1)  # piece
        self.sent: dict[str, Goal] = {}
        self.reported: dict[str, Report] = {}

    def observe(self, report: Report) -> None:
        self.reported[report.robot] = report

    def cost_s(self, robot: RobotName, point: PointName) -> float:
        place = self.roadmap.place.get(point)
        if place is None:
            return INFINITE
        return self.costs[robot].cost_s(self.place[robot], self.heading[robot], place)

    def stands_at(self, robot: RobotName, point: PointName) -> bool:
        if self.roadmap.place.get(point) != self.place[robot]:
            return False
        report = self.reported[robot]
        return report.progress == report.authority and not report.speed_mps

    def step(
        self, now_ms: int, goals: Mapping[RobotName, Goal], busy: Set[RobotName]
    ) -> list[Drive]:
        told = []
        for name, goal in goals.items():
            if name in busy or self.sent.get(name) == goal:
                continue
            self.sent[name] = goal
            message = self._route(name, self.roadmap.place[goal.point])
            if message is not None:
                told.append(message)
        return told

    def _route(self, name: RobotName, goal: int) -> Drive | None:
        roadmap, place, heading = self.roadmap, self.place[name], self.heading[name]
        footprint = roadmap.footprint_of[self.group_of[name]]
        build = Builder(roadmap, footprint, roadmap.places.point[place], heading, self.next[name])
        number = build.piece
        while place != goal:
            _, move = min(self.costs[name].ways(place, build.heading_rad, goal))
            number += 1
            build.drive([Leg(path=k) for k in roadmap.moves.paths[move]], move, number)
            place = roadmap.moves.end[move]
        turn = roadmap.final_turn_rad(place, build.heading_rad)
        if turn and not math.isinf(turn):
            demanded = roadmap.net.points[roadmap.places.point[place]].heading_rad
            assert demanded is not None
            build.turn(demanded, -1, number + 1)
        if not build.pieces:
            return None
        build.rest()
        self.place[name], self.heading[name], self.next[name] = (
            place,
            build.heading_rad,
            build.piece,
        )
        end = build.slots[-1].end
        assert end is not None
        return Drive(robot=name, session="free", authority=end, pieces=tuple(build.pieces))
