"""What of the robots is already in the telemetry file, and so what need not be written again."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Generic, TypeVar

import msgspec
import numpy as np

from ledger.ids import PointName, RobotKey, SceneId, robot_key
from ledger.link import Plan, Report, Space
from ledger.telemetry_format import SILENT_MS_MAX, Moved, PlanBatch, ReportBatch
from ledger.telemetry_motion import HAPPENS, grown, is_exact, steady, table

Item = TypeVar("Item", Report, Plan)


class _Series(Generic[Item]):
    """The newest of every robot, and how many batches each scene has had since its whole one."""

    def __init__(self) -> None:
        self.newest: dict[RobotKey, Item] = {}
        self.scenes: set[SceneId] = set()
        self._since: dict[SceneId, tuple[int, int]] = {}  # when it was whole, batches since

    def seed(self, scene: SceneId, items: Iterable[Item]) -> None:
        """Begin with what an earlier run knew of a scene."""
        self.scenes.add(scene)
        for item in items:
            self.newest.setdefault(robot_key(scene, item.robot), item)

    def _taken(self, items: Sequence[Item]) -> Iterator[tuple[RobotKey, Item]]:
        """Take items in; pass over those that were overtaken on the way."""
        for item in items:
            key = robot_key(item.scene, item.robot)
            known = self.newest.get(key)
            if known is None or item.at_ms >= known.at_ms:
                self.newest[key] = item
                yield key, item

    def _next(self, scene: SceneId) -> tuple[int, int]:
        whole_ms, since = self._since[scene]
        self._since[scene] = whole_ms, since + 1
        return self._since[scene]

    def _of(self, scene: SceneId, now_ms: int) -> list[Item]:
        """Begin to count batches of a scene anew, with the newest of its robots."""
        self._since[scene] = now_ms, 0
        return [item for item in self.newest.values() if item.scene == scene]

    def _all(self, now_ms: int) -> list[SceneId]:
        """Forget robots silent for too long; give the scenes of the others."""
        self._since.clear()
        for key, item in tuple(self.newest.items()):
            if now_ms - item.at_ms > SILENT_MS_MAX:
                del self.newest[key]
        return list(dict.fromkeys(item.scene for item in self.newest.values()))


class _Written:
    """What is written of one robot; its motion is a row of the series' table."""

    __slots__ = ("at_ms", "point", "row", "steady")

    def __init__(self, row: int) -> None:
        self.row = row
        self.at_ms = 0
        self.point: PointName | None = None
        self.steady: tuple[object, ...] | None = None  # None: the next is stated whole

    def state(self, report: Report, said: tuple[object, ...], *, exact: bool) -> None:
        self.at_ms, self.point = report.at_ms, report.point
        self.steady = said if exact else None


class ReportSeries(_Series[Report]):
    """What robots said of themselves."""

    def __init__(self) -> None:
        """Begin with nobody."""
        super().__init__()
        self._written: dict[RobotKey, _Written] = {}
        self._motion = table(())

    def changed(
        self, reports: Sequence[Report], now_ms: int, sample_ms: int
    ) -> Iterator[ReportBatch]:
        """Take reports in; give those worth writing: changed, and not too soon after the last."""
        by_scene: dict[SceneId, list[tuple[_Written, Report]]] = {}
        for key, report in self._taken(reports):
            last = self._written.get(key)
            if last is None:
                last = self._written[key] = _Written(len(self._written))
            elif report.at_ms - last.at_ms < sample_ms:
                continue
            by_scene.setdefault(report.scene, []).append((last, report))
        self._motion = grown(self._motion, len(self._written))
        for scene, due in by_scene.items():
            batch = self._batch(scene, now_ms, due)
            if scene not in self._since:
                yield self._stated(scene, now_ms)
            elif batch is not None:
                yield batch

    def _batch(
        self, scene: SceneId, now_ms: int, due: Sequence[tuple[_Written, Report]]
    ) -> ReportBatch | None:
        rows = [last.row for last, _ in due]
        new = table([report for _, report in due])
        steps = new - self._motion[rows]
        happened: list[bool] = np.asarray(steps[:, HAPPENS:].any(axis=1)).tolist()
        exact = is_exact(new).tolist()
        items, places = [], []
        for place, (last, report) in enumerate(due):
            said = steady(report)
            if said != last.steady or not exact[place]:
                items.append(report)
            elif happened[place] or report.point != last.point:
                places.append(place)
            else:
                rows[place] = -1  # it stands
                continue
            last.state(report, said, exact=exact[place])
        wrote = [place for place, row in enumerate(rows) if row >= 0]
        self._motion[[rows[place] for place in wrote]] = new[wrote]
        if not wrote:
            return None
        moved = Moved(
            robots=tuple(due[place][1].robot for place in places),
            steps=tuple(map(tuple, steps[places].astype("int64").T.tolist())),
            points=tuple(due[place][1].point for place in places),
        )
        whole_ms, since = self._next(scene) if scene in self._since else (0, 0)
        return ReportBatch(
            scene=scene,
            at_ms=now_ms,
            whole=False,
            whole_ms=whole_ms,
            since=since,
            items=tuple(items),
            moved=moved if places else None,
        )

    def whole(self, now_ms: int) -> Iterator[ReportBatch]:
        """Give the newest of every robot, one batch a scene."""
        self._written.clear()
        for scene in self._all(now_ms):
            yield self._stated(scene, now_ms)

    def _stated(self, scene: SceneId, now_ms: int) -> ReportBatch:
        reports = self._of(scene, now_ms)
        new = table(reports)
        for report, row, exact in zip(reports, new, is_exact(new).tolist(), strict=True):
            key = robot_key(scene, report.robot)
            last = self._written.setdefault(key, _Written(len(self._written)))
            last.state(report, steady(report), exact=exact)
            self._motion = grown(self._motion, len(self._written))
            self._motion[last.row] = row
        items = tuple(reports)
        return ReportBatch(scene=scene, at_ms=now_ms, whole=True, whole_ms=now_ms, items=items)


class PlanSeries(_Series[Plan]):
    """What traffic intended with robots."""

    def __init__(self) -> None:
        """Begin with nobody."""
        super().__init__()
        self._written: dict[RobotKey, Plan] = {}
        self._spaces: dict[SceneId, dict[Space, int]] = {}

    def changed(self, plans: Sequence[Plan], now_ms: int, sample_ms: int) -> Iterator[PlanBatch]:
        """Take plans in; give those worth writing: changed, and not too soon after the last."""
        by_scene: dict[SceneId, list[Plan]] = {}
        for key, plan in self._taken(plans):
            last = self._written.get(key)
            if last is not None:
                same = msgspec.structs.replace(last, at_ms=plan.at_ms) == plan
                if same or plan.at_ms - last.at_ms < sample_ms:
                    continue
            self._written[key] = plan
            by_scene.setdefault(plan.scene, []).append(plan)
        for scene, fresh in by_scene.items():
            yield self._batch(scene, now_ms, fresh if scene in self._since else None)

    def whole(self, now_ms: int) -> Iterator[PlanBatch]:
        """Give the newest of every robot, one batch a scene."""
        self._written.clear()
        for scene in self._all(now_ms):
            yield self._batch(scene, now_ms)

    def _batch(self, scene: SceneId, now_ms: int, fresh: Sequence[Plan] | None = None) -> PlanBatch:
        """State what is fresh, or the newest of every robot."""
        if fresh is None:
            plans: Sequence[Plan] = self._of(scene, now_ms)
            self._written.update((robot_key(scene, plan.robot), plan) for plan in plans)
            self._spaces[scene] = {}
            whole_ms, since = now_ms, 0
        else:
            plans, (whole_ms, since) = fresh, self._next(scene)
        known = self._spaces[scene]
        first = len(known)
        held = tuple(
            tuple(known.setdefault(space, len(known)) for space in plan.spaces) for plan in plans
        )
        return PlanBatch(
            scene=scene,
            at_ms=now_ms,
            whole=fresh is None,
            whole_ms=whole_ms,
            since=since,
            items=tuple(msgspec.structs.replace(plan, spaces=()) for plan in plans),
            held=held,
            first_space=first,
            spaces=tuple(islice(known, first, None)),
        )
