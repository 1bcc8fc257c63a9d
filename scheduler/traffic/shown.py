"""What traffic intends with its robots, for those who look on."""

from collections.abc import Container
from itertools import islice

from ledger.ids import RobotName, SceneId
from ledger.link import DOOR, EXTERNAL, STUCK, Alarm, AlarmLevel, Plan, Space
from ledger.waits import Wait
from scheduler.goal import Goal
from scheduler.traffic.admission import HALTED
from scheduler.traffic.grants import Grants
from scheduler.traffic.ladder import Stuck
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.track import Track

SPACES_MAX = 32  # polygons per plan


class Shown:
    """Makes plans; changes nothing."""

    def __init__(self, scene: SceneId, roadmap: Roadmap, grants: Grants) -> None:
        self._scene = scene
        self._roadmap = roadmap
        self._grants = grants
        self._spaces: dict[int, Space] = {}  # of compiled cells

    def plan(
        self,
        track: Track,
        goal: Goal | None,
        robots: Container[str],
        doors: tuple[str, ...],
        wait: Wait | None,
        stuck: Stuck | None,
        now_ms: int,
    ) -> Plan:
        """Say what is intended with one robot; who is in its way and none of `robots` is an owner
        of reserved ground. `doors` are those that it waits for, named as in a plan.
        """
        known = self._spaces
        cells = [slot.cell for slot in islice(track.owned, SPACES_MAX)]
        spaces = [known[cell] if cell in known else self._space(cell) for cell in cells]
        blockers = {*doors}
        for name in track.barred:
            blockers.add(name if name.startswith(DOOR) else f"{EXTERNAL}{name}")
        names = [*track.crowded_by]
        if track.promised:
            slot = track.promised[0]
            names += self._grants.blockers(slot.cell, track.name, slot.commit)
        for name in names:
            blockers.add(name if name in robots else f"{EXTERNAL}{name}")
        halted = track.trouble in HALTED
        ways = [] if halted else track.untravelled()
        return Plan(
            scene=self._scene,
            robot=track.name,
            at_ms=now_ms,
            ready=track.placed and track.trouble is None and not track.lost,
            target=None if goal is None else goal.point,
            untravelled=tuple(path for path, _ in ways),
            commits=tuple(commit for _, commit in ways),
            turns=() if halted else track.turns(),
            spaces=tuple(spaces),
            blocked_by=tuple(RobotName(name) for name in sorted(blockers)),
            commit=track.commit,
            moving=not track.driven,
            wait=wait,
            alarm=None if stuck is None else _alarm(stuck),
        )

    def _space(self, cell: int) -> Space:
        if self._grants.is_shape(cell):  # made for one robot and one moment
            ring = self._grants.ring(cell)
            return Space(points=tuple((round(x, 3), round(y, 3)) for x, y in ring))
        space = self._spaces.get(cell)
        if space is None:
            space = self._spaces[cell] = Space(points=self._roadmap.ring(cell))
        return space


def _alarm(stuck: Stuck) -> Alarm:
    return Alarm(
        level=AlarmLevel.ERROR, code=STUCK, message=stuck.text, times=1, at_ms=stuck.since_ms
    )
