"""Traffic of one area: who may be where, and who moves next.

Reports release ground, `step` commits moves and grants ground, and a robot drives only over ground
that it owns. The planner only proposes; every proposal is checked against the grants of the moment.
"""

from collections.abc import Mapping, Sequence, Set
from pathlib import Path as FilePath

from ledger.ids import RobotName, SceneId
from ledger.link import Drive, Plan, Report, TellRoute
from ledger.scene import XY, Area, Door, Group
from ledger.scene_config import SceneConfig
from scheduler.goal import Goal
from scheduler.traffic.admission import HALTED, MOVED_M, Admission
from scheduler.traffic.ahead import ahead
from scheduler.traffic.answers import Answers
from scheduler.traffic.claims import Claims
from scheduler.traffic.compile import compile_area
from scheduler.traffic.costs import INFINITE
from scheduler.traffic.doors import DoorNow, Doors
from scheduler.traffic.execution import Execution
from scheduler.traffic.geometry import turn_rad
from scheduler.traffic.grants import Grants
from scheduler.traffic.guard import Breach
from scheduler.traffic.guidance import SHARE, guided
from scheduler.traffic.ladder import Ladder
from scheduler.traffic.methods import planner_of
from scheduler.traffic.outside import Outside
from scheduler.traffic.planner import Distributed, Planner
from scheduler.traffic.safe import Safe
from scheduler.traffic.shown import Shown
from scheduler.traffic.track import Track
from scheduler.traffic.venus import Think, at_once
from scheduler.traffic.waits import Due, Floor, Wait, Waits
from scheduler.traffic.wishes import agents, relocate
from scheduler.traffic.world import World

ASK_MS = 1_000  # a question for the route is repeated after this time
REPLAN_MS = 500  # while somebody waits; else planning follows events


class Traffic(Answers):
    """One per scene and area. Deterministic: the same calls give the same answers."""

    def __init__(
        self,
        scene: SceneId,
        area: Area,
        groups: Sequence[Group],
        cache: FilePath | None = None,
        point_distance_m: float = 0.3,
        think: Think = at_once,
        guidance: float = SHARE,
    ) -> None:
        """Compile the area for these groups, or load it from the folder `cache`; `think` does what
        a planner takes long for.
        """
        self.scene = scene
        self.area = area
        self.roadmap = compile_area(area, groups, cache)
        self.grants = Grants(self.roadmap.conflicts, self.roadmap.cells.count)
        self._admission = Admission(scene, self.roadmap, self.grants, point_distance_m)
        self._retreats = False  # out of dead ends in reverse, too
        self._guidance = guidance  # robots per stop that it is for; 0 = none
        self._costs = guided(self.roadmap, guidance)
        self._reserved = Claims(self.roadmap, self.grants, self._costs)
        self._doors = Doors(self.roadmap, self.grants, self._costs)
        self._execution = Execution(self.roadmap, self.grants, self._admission, self._reserved)
        self._planner: Planner = Distributed()
        self._think = think
        self._ladder = Ladder()
        self._outside = Outside(self.grants, self._admission)
        self._prevents = SceneConfig().deadlock_prevention
        self._push_m = SceneConfig().push_distance_m_min, SceneConfig().push_distance_m_max
        self._goals: Mapping[RobotName, Goal] = {}
        self._fixed: frozenset[RobotName] = frozenset()
        self._dirty: Due | None = Due.ROBOTS  # why planning is due
        self._plan_ms = 0
        self._quiet_ms = 10 * REPLAN_MS  # the longest time between two plannings
        self._resend_ms = 0
        self._shown = Shown(scene, self.roadmap, self.grants)
        self._world = World(roadmap=self.roadmap, agents=[])  # as last planned on
        self._waits = Waits(self.roadmap)

    def tune(self, config: SceneConfig) -> None:
        """Take settings of the scene: how far from a point or a path a robot is still on it, the
        longest time between two plannings when nothing happens, and who plans.
        """
        self._admission.within_m = config.point_distance_m
        self._admission.path_m = self._execution.guard.off_m = config.path_distance_m
        self._quiet_ms = config.traffic_plan_interval_ms
        self._planner = planner_of(config, self._think, self._planner)
        self._prevents = config.deadlock_prevention
        self._execution.turns_ahead = config.turn_ahead
        self._push_m = config.push_distance_m_min, config.push_distance_m_max
        if config.reverse_out_of_deadlock != self._retreats:
            self._retreats = config.reverse_out_of_deadlock
            self._price()
        self._plan_ms = 0  # what is due by the new interval is done at once

    def _price(self) -> None:
        """What driving costs, anew."""
        self._costs.update(guided(self.roadmap, self._guidance, self._retreats))
        self._doors.reprice()
        self._reserved.ways_changed()
        self._reserved.direct(self._tracks.values())
        self._dirty = Due.GOALS

    # -- robots come, report, and go

    def add(self, robot: RobotName, group: int) -> None:
        """A robot of this area; nobody is given new moves before it has reported or is lost."""
        if robot in self._tracks:
            return
        self._execution.add(
            Track(
                name=robot,
                group=group,
                footprint=self.roadmap.footprint_of[group],
                limits=self.roadmap.groups[group].kinematics,
                costs=self._costs[group],
            )
        )
        self._dirty = Due.ROBOTS

    def remove(self, robot: RobotName) -> None:
        """It is not on the floor any more: its ground is free."""
        track = self._tracks.pop(robot, None)
        if track is not None:
            track.let_go(self.grants)
            self._admission.entries.pop(robot, None)
            self._dirty, self._execution.freed = Due.ROBOTS, True

    def lost(self, robot: RobotName) -> None:
        """It does not answer: it keeps all ground it has, and cannot be pushed."""
        track = self._tracks.get(robot)
        if track is not None and not track.lost:
            track.lost = True
            self._dirty = Due.LOST

    def remember(self, plan: Plan) -> None:
        """It has not been heard since our start: until it is, it keeps the ground that it held
        when somebody last knew of it, and is promised the rest of the route that it had.
        """
        track = self._tracks.get(plan.robot)
        if track is not None and not track.placed and not track.owned:
            self._admission.stand(track, plan)
            self._execution.adopt_numbers(track)
            self._dirty = Due.ROBOTS

    def load(self, robot: RobotName, *, loaded: bool) -> None:
        """It has something on it, or is about to; or nothing any more (see `classes`)."""
        track = self._tracks.get(robot)
        if track is None:
            return
        if track.footprint != self.roadmap.classes.of(track.group, loaded=loaded):
            self._admission.change_class(track, loaded)
            self._dirty = Due.ROBOTS

    def observe(self, report: Report) -> None:
        """Take in a report. Older ones than known, and ones from other areas, change nothing."""
        track = self._tracks.get(report.robot)
        if track is None or report.area != self.area.id or track.is_old(report):
            return
        if track.lost:
            track.lost, self._dirty = False, Due.LOST
        track.report = report
        if not track.placed:
            self._admission.receive(track, report, self._execution.taken(track))
            self._news(track)
            self._execution.fit_in(track)
        elif track.trouble in HALTED:
            self._admission.wait_on_old_route(track, report, self._execution.taken(track))
            self._dirty = Due.ROBOTS
        elif report.session == track.session:
            self._progress(track, report)
        elif track.confirmed or report.session != track.session_before:
            # It has forgotten its route: it started anew, and stands where it reports to be.
            track.let_go(self.grants)
            self._admission.put(track, report, self._execution.taken(track), keep_session=False)
            self._news(track)
        else:
            self._drift(track, report)
        if track.stray is not None:
            self._admission.follow(track, strays=True)
            self._execution.freed = True

    def _news(self, track: Track) -> None:
        """A robot has been placed anew; numbers go on behind those it brought along."""
        self._execution.adopt_numbers(track)
        self._dirty, self._execution.freed = Due.ROBOTS, True
        self._execution.touched.add(track.name)

    def _progress(self, track: Track, report: Report) -> None:
        track.advance(report)
        if track.release(self.grants):
            self._execution.freed = True
        state = track.near, track.driven and track.standing
        if state != track.state:
            track.state = state
            self._dirty = Due.PROGRESS
        self._drift(track, report)

    def _drift(self, track: Track, report: Report) -> None:
        """Look again at a robot that stands somewhere else than its route has led it, and at one
        that has no route of ours wherever it goes: people may drive it.
        """
        if not track.driven or (track.confirmed and not track.standing):
            return
        turned = 0.0
        if track.place is not None and not track.owned[-1].standing:
            point = self.roadmap.net.points[self.roadmap.places.point[track.place]]
            off = max(abs(point.x_m - report.x_m), abs(point.y_m - report.y_m))
            turned = turn_rad(track.heading_rad, report.heading_rad)
            if off <= MOVED_M and not turned:  # what it rests on is no wider
                return
        if turned or self._admission.has_moved(track, report):
            self._admission.put_anew(track, report, self._execution.taken(track))
            self._news(track)

    # -- the judge

    def look(self, now_ms: int) -> list[Breach]:
        """Give what must not be by the robots' newest reports (see `guard`)."""
        held = self._execution.guard.held
        self._execution.look(now_ms)
        if held != self._execution.guard.held:
            self._dirty = Due.ROBOTS
            self._execution.freed = True
        return self._execution.guard.breaches

    def excuse(self, robot: RobotName) -> None:
        """An operator lets it go on in spite of a breach."""
        self._execution.guard.excuse(robot)

    # -- ground reserved by others

    def claim(
        self, id_: str, owner: str, rings: Sequence[tuple[XY, ...]], *, owned: bool = False
    ) -> None:
        """Keep all robots but the owner's own off these polygons; `owned`: they are off already,
        for it was granted before we started.
        """
        self._reserved.add(id_, owner, rings, owned=owned)
        self._dirty, self._execution.freed = Due.GROUND, True

    def unclaim(self, id_: str) -> None:
        """Let robots go there again."""
        self._reserved.drop(id_)
        self._dirty, self._execution.freed = Due.GROUND, True

    def claimed(self, id_: str) -> bool:
        """Is the ground free of robots, and will it stay so until it is given back."""
        return self._reserved.owned(id_)

    # -- doors

    def lay_doors(self, doors: Sequence[Door]) -> None:
        """Let nobody pass these doors until they are known to be open; called once, at first."""
        self._doors = Doors(self.roadmap, self.grants, self._costs, doors)

    def follow_doors(self, now: Mapping[int, DoorNow]) -> None:
        """Take in how the doors are: who may pass, and which ways are to be avoided."""
        changed, ways = self._doors.follow(now)
        self._execution.freed = self._execution.freed or changed
        if ways:
            self._dirty = Due.DOORS
            self._reserved.ways_changed()
            self._reserved.direct(self._tracks.values())

    def wanted_doors(self) -> Mapping[int, tuple[RobotName, ...]]:
        """By door, for whom it must be open, or open now."""
        return self._doors.wanted(self._tracks)

    # -- one step

    def step(
        self, now_ms: int, goals: Mapping[RobotName, Goal], busy: Set[RobotName]
    ) -> list[Drive | TellRoute]:
        """Commit and grant what can be now, and say it; nothing for robots with no news."""
        messages: list[Drive | TellRoute] = []
        for track in self._tracks.values():
            if track.asking and (track.asked_ms is None or now_ms - track.asked_ms >= ASK_MS):
                track.asked_ms = now_ms
                messages.append(TellRoute(robot=track.name))
        if not self.ready:
            return messages
        self._wish(now_ms, goals, busy)
        self._execution.reshape()
        if self._execution.freed:
            self._execution.acquire(self._doors.shut)
        if self._dirty or now_ms >= self._plan_ms:
            self._waits.planned(self._dirty or Due.PACE)
            self._dirty = None
            self._plan(now_ms)
            self._execution.acquire(self._doors.shut)
        return messages + self._tell(now_ms)

    def _wish(self, now_ms: int, goals: Mapping[RobotName, Goal], busy: Set[RobotName]) -> None:
        fixed = frozenset(busy) | {track.name for track in self._tracks.values() if track.lost}
        fixed |= self._execution.guard.held
        if goals == self._goals and fixed == self._fixed and not self._dirty:
            return
        self._dirty = self._dirty or Due.GOALS
        self._fixed, self._goals = fixed, dict(goals)
        for track in self._tracks.values():
            wanted = goals.get(track.name)
            goal = None if wanted is None else self.roadmap.place.get(wanted.point)
            if goal != track.goal:
                track.goal, track.arrived_ms = goal, None
                track.best_s, track.best_ms = INFINITE, now_ms
            if goal is None or goal != track.place or not track.driven:
                track.arrived_ms = None
            elif track.arrived_ms is None:
                track.arrived_ms = now_ms

    def _plan(self, now_ms: int) -> None:
        self._execution.enter(self._fixed)
        tracks = list(self._tracks.values())
        self._outside.look(tracks, self._fixed, now_ms)
        if self._reserved or self._doors.closed_moves:
            self._reserved.direct(tracks)
            self._doors.bar(tracks)
        roadmap = self._reserved.roadmap
        relocate(roadmap, tracks, self._fixed)
        self._reserved.send_out(tracks, self._fixed)
        ranks = {name: goal.rank for name, goal in self._goals.items()}
        world = World(
            roadmap=roadmap,
            agents=agents(roadmap, tracks, ranks, self._fixed, now_ms),
            push_m_min=self._push_m[0],
            push_m_max=self._push_m[1],
            now_ms=now_ms,
            ahead=ahead(tracks) if self._planner.looks_ahead else {},
        )
        self._reserved.lay_over(world, tracks)
        self._world = world
        proposed = self._ladder.propose(
            world, self._tracks, self._held_up_by, self._planner, now_ms
        )
        safe = Safe(world, self._ladder.excused) if self._prevents else None
        outcomes = self._execution.admit(world, proposed, safe)
        self._ladder.note((o.robot for o in outcomes if o.committed), now_ms)
        self._waits.note(outcomes, self._tracks, now_ms)
        waits = any((t.goal, t.relocation) not in ((t.place, None), (None, None)) for t in tracks)
        waits = waits or bool(self._admission.entries)
        self._plan_ms = now_ms + (min(REPLAN_MS, self._quiet_ms) if waits else self._quiet_ms)

    def _held_up_by(self, track: Track) -> list[str]:
        if not track.promised:
            return []
        slot = track.promised[0]
        doors = self._doors.before(track)
        return [*doors, *self.grants.blockers(slot.cell, track.name, slot.commit)]

    def _tell(self, now_ms: int) -> list[Drive | TellRoute]:
        names: Set[RobotName] = self._execution.touched
        if now_ms >= self._resend_ms:
            self._resend_ms = now_ms + REPLAN_MS
            names = self._tracks.keys()
        told = []
        for name in sorted(names):
            track = self._tracks.get(name)
            message = track.drive(now_ms) if track is not None and not track.lost else None
            if message is not None:
                told.append(message)
        self._execution.touched.clear()
        return list(told)

    def plans(self, now_ms: int) -> list[Plan]:
        """What is intended with each robot just now."""
        shown, robots, doors = self._shown, self._tracks.keys(), self._doors.before
        waits, stuck = self.waits(now_ms), self.stuck(now_ms)
        return [
            shown.plan(
                track,
                self._goals.get(track.name),
                robots,
                doors(track),
                waits.get(track.name),
                stuck.get(track.name),
                now_ms,
            )
            for track in self._tracks.values()
        ]

    def waits(self, now_ms: int) -> Mapping[RobotName, Wait]:
        """Who waits just now, for whom and why."""
        floor = Floor(
            grants=self.grants,
            tracks=self._tracks,
            fixed=self._fixed,
            doors=self._doors.before,
            world=self._world,
            refused=self._waits.refused,
        )
        return self._waits.look(floor, now_ms)
