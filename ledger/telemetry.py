"""The telemetry log: what robots reported and what traffic intended, best effort, kept for days.

`DIR/telemetry/<UTC time>.mcap` holds our own exact batches (`telemetry_format`), from which any
moment is read back (`telemetry_read`), and beside them `foxglove.PoseInFrame` for each robot, which
Foxglove and Rerun draw as they are. None of it is needed to go on after a restart.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from threading import Lock
from typing import Generic, TypeAlias, TypeVar

import msgspec
import structlog

from ledger.ids import RobotKey, SceneId, robot_key
from ledger.link import Plan, Report
from ledger.telemetry_file import TelemetryFile
from ledger.telemetry_format import (
    LOOK_BACK_MS,
    WHOLE_EVERY_MS,
    PlanBatch,
    ReportBatch,
    files,
)
from ledger.telemetry_read import plans_at, read_plans, read_telemetry, reports_at

__all__ = ["TelemetryLog", "plans_at", "read_plans", "read_telemetry", "reports_at"]

SAMPLE_MS = 200  # a robot is written at most so often
POSE_MS = 500  # and drawn for Foxglove and Rerun at most so often
CHUNK_MS = 1_000  # so much is lost by kill -9 at most
FILE_MS_MAX = 3_600_000
FILE_BYTES_MAX = 64 * 1024 * 1024
# The stock Writer keeps an entry for each channel of each chunk until the file is finished:
# 250 k entries are about 25 MB.
INDEX_ENTRIES_MAX = 250_000
KEEP_MS = 7 * 24 * 3_600_000
KEEP_BYTES_MAX = 2 * 1024**3
RETRY_MS = 60_000  # after a failed write (disk full), before a new file is tried

log = structlog.get_logger()
Item = TypeVar("Item", Report, Plan)
Action: TypeAlias = Callable[[TelemetryFile], None]


class _Series(Generic[Item]):
    """The newest of every robot, and what of it is already in the file."""

    def __init__(self, ignored: dict[str, int]) -> None:
        self.newest: dict[RobotKey, Item] = {}
        self.written: dict[RobotKey, Item] = {}
        self.scenes: set[SceneId] = set()
        self._ignored = ignored  # fields that change without anything having happened

    def seed(self, scene: SceneId, items: Iterable[Item]) -> None:
        """Begin with what an earlier run knew of a scene."""
        self.scenes.add(scene)
        for item in items:
            self.newest.setdefault(robot_key(scene, item.robot), item)

    def changed(self, items: Sequence[Item], sample_ms: int) -> dict[SceneId, list[Item]]:
        """Take items in; give those worth writing: changed, and not too soon after the last."""
        fresh: dict[RobotKey, Item] = {}
        for item in items:
            key = robot_key(item.scene, item.robot)
            known = self.newest.get(key)
            if known is not None and item.at_ms < known.at_ms:
                continue  # overtaken on the way
            self.newest[key] = item
            last = self.written.get(key)
            if last is None or (item.at_ms - last.at_ms >= sample_ms and self._differ(item, last)):
                fresh[key] = item
        self.written.update(fresh)
        by_scene: dict[SceneId, list[Item]] = {}
        for item in fresh.values():
            by_scene.setdefault(item.scene, []).append(item)
        return by_scene

    def _differ(self, item: Item, last: Item) -> bool:
        replace = msgspec.structs.replace
        return replace(item, **self._ignored) != replace(last, **self._ignored)

    def whole(self, now_ms: int) -> dict[SceneId, list[Item]]:
        """Give the newest of every robot, by scene; forget those silent for too long."""
        by_scene: dict[SceneId, list[Item]] = {}
        for key, item in tuple(self.newest.items()):
            if now_ms - item.at_ms > LOOK_BACK_MS:
                del self.newest[key]
                self.written.pop(key, None)
            else:
                self.written[key] = item
                by_scene.setdefault(item.scene, []).append(item)
        return by_scene


class TelemetryLog:
    """Writes reports and plans; a failure costs telemetry, never the caller.

    Times are the caller's (scaled) ones, so at a speed of 10 give a `chunk_ms` of 10 s to lose one
    real second at most. Calls may come from several threads.
    """

    def __init__(
        self,
        directory: Path,
        *,
        sample_ms: int = SAMPLE_MS,
        pose_ms: int = POSE_MS,
        chunk_ms: int = CHUNK_MS,
        file_ms_max: int = FILE_MS_MAX,
        file_bytes_max: int = FILE_BYTES_MAX,
        keep_ms: int = KEEP_MS,
        keep_bytes_max: int = KEEP_BYTES_MAX,
    ) -> None:
        """Take the folder; the first file is made by the first write."""
        self._directory = directory
        self._sample_ms, self._pose_ms, self._chunk_ms = sample_ms, pose_ms, chunk_ms
        self._file_ms_max, self._file_bytes_max = file_ms_max, file_bytes_max
        self._keep_ms, self._keep_bytes_max = keep_ms, keep_bytes_max
        self._lock = Lock()
        self._reports: _Series[Report] = _Series({"number": 0, "at_ms": 0})
        self._plans: _Series[Plan] = _Series({"at_ms": 0})
        self._drawn: dict[RobotKey, Report] = {}  # as last written for Foxglove and Rerun
        self._file: TelemetryFile | None = None
        self._now_ms = 0
        self._broken_ms: int | None = None

    def write(self, reports: Sequence[Report], now_ms: int | None = None) -> None:
        """Take in what robots reported; `now_ms` defaults to the newest report's time."""
        with self._lock:
            self._advance(now_ms, [r.at_ms for r in reports])
            for scene in {r.scene for r in reports} - self._reports.scenes:
                known = reports_at(self._directory, scene, self._now_ms)
                self._reports.seed(scene, known.values())
            fresh = self._reports.changed(reports, self._sample_ms)
            self._put(
                ReportBatch(scene=s, at_ms=self._now_ms, whole=False, items=tuple(items))
                for s, items in fresh.items()
            )

    def write_plans(self, plans: Sequence[Plan], now_ms: int | None = None) -> None:
        """Take in what traffic intends."""
        with self._lock:
            self._advance(now_ms, [p.at_ms for p in plans])
            for scene in {p.scene for p in plans} - self._plans.scenes:
                known = plans_at(self._directory, scene, self._now_ms)
                self._plans.seed(scene, known.values())
            fresh = self._plans.changed(plans, self._sample_ms)
            self._put(
                PlanBatch(scene=s, at_ms=self._now_ms, whole=False, items=tuple(items))
                for s, items in fresh.items()
            )

    def flush(self) -> None:
        """Make everything so far readable for others."""
        with self._lock:
            if self._file is not None:
                self._guarded(lambda file: file.flush(self._now_ms))

    def close(self) -> None:
        """Finish the file with its index."""
        with self._lock:
            file, self._file = self._file, None
            if file is not None:
                with suppress(OSError):  # what was flushed is there all the same
                    file.close()

    def _advance(self, now_ms: int | None, times: list[int]) -> None:
        newest = now_ms if now_ms is not None else max(times, default=self._now_ms)
        self._now_ms = max(self._now_ms, newest)

    def _put(self, made: Iterable[ReportBatch | PlanBatch]) -> None:
        batches = list(made)
        if self._broken_ms is not None and self._now_ms - self._broken_ms < RETRY_MS:
            return
        if self._file is None and not batches:
            return
        self._guarded(lambda file: self._fill(file, batches))

    def _fill(self, file: TelemetryFile, batches: Sequence[ReportBatch | PlanBatch]) -> None:
        now_ms = self._now_ms
        if file.whole_ms is None or now_ms - file.whole_ms >= WHOLE_EVERY_MS:
            file.flush(now_ms)  # a whole batch begins a chunk
            file.whole_ms = now_ms
            for scene, reports in self._reports.whole(now_ms).items():
                file.add(ReportBatch(scene=scene, at_ms=now_ms, whole=True, items=tuple(reports)))
                self._draw(file, reports)
            for scene, plans in self._plans.whole(now_ms).items():
                file.add(PlanBatch(scene=scene, at_ms=now_ms, whole=True, items=tuple(plans)))
        else:
            for batch in batches:
                file.add(batch)
                if isinstance(batch, ReportBatch):
                    self._draw(file, batch.items)
        if now_ms - file.chunk_ms >= self._chunk_ms:
            file.flush(now_ms)

    def _draw(self, file: TelemetryFile, reports: Iterable[Report]) -> None:
        for report in reports:
            key = robot_key(report.scene, report.robot)
            last = self._drawn.get(key)
            if last is None or (
                report.at_ms - last.at_ms >= self._pose_ms and _pose(report) != _pose(last)
            ):
                file.add_pose(report, self._now_ms)
                self._drawn[key] = report

    def _guarded(self, action: Action) -> None:
        """Run on the open file, or a new one; on trouble drop the file and try again later."""
        try:
            action(self._open())
            self._broken_ms = None
        except OSError as error:
            log.warning("telemetry is not written", reason=str(error), retry_ms=RETRY_MS)
            file, self._file = self._file, None
            if file is not None:
                file.abandon()
            self._broken_ms = self._now_ms

    def _open(self) -> TelemetryFile:
        file = self._file
        if file is not None and (
            self._now_ms - file.start_ms >= self._file_ms_max
            or file.length >= self._file_bytes_max
            or file.index_entries >= INDEX_ENTRIES_MAX
        ):
            file.close()
            file = None
        if file is None:
            file = TelemetryFile(self._directory, self._now_ms)
            self._drawn.clear()
            _prune(self._directory, self._now_ms - self._keep_ms, self._keep_bytes_max)
        self._file = file
        return file


def _pose(report: Report) -> tuple[int, float, float, float]:
    return report.area, report.x_m, report.y_m, report.heading_rad


def _prune(directory: Path, oldest_ms: int, bytes_max: int) -> None:
    """Delete what is too old or too much, oldest first; never the newest file."""
    known = files(directory)
    total = sum(path.stat().st_size for _, path in known)
    for (_, path), (next_ms, _) in pairwise(known):
        if next_ms >= oldest_ms and total <= bytes_max:
            return
        total -= path.stat().st_size
        path.unlink(missing_ok=True)
