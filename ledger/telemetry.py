"""The telemetry log: what robots reported and what traffic intended, best effort, kept for days.

`DIR/telemetry/<UTC time>.mcap` holds our own batches (`telemetry_format`), from which any moment is
read back (`telemetry_read`), and beside them robots and grants as Foxglove's messages
(`telemetry_drawing`), which viewers draw as they are. A restart learns from it where robots that do
not answer were last; without it their ground counts as free until they report.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from threading import Lock
from typing import TypeAlias

import structlog

from ledger.ids import RobotKey, SceneId, robot_key
from ledger.link import Plan, Report
from ledger.telemetry_drawing import GRANTS, POSES, grants, poses
from ledger.telemetry_file import Opened, TelemetryFile
from ledger.telemetry_format import WHOLE_EVERY_MS, PlanBatch, ReportBatch, files
from ledger.telemetry_read import (
    last_plans,
    last_reports,
    plans_at,
    read_plans,
    read_telemetry,
    reports_at,
)
from ledger.telemetry_series import PlanSeries, ReportSeries

__all__ = ["TelemetryLog", "plans_at", "read_plans", "read_telemetry", "reports_at"]

SAMPLE_MS = 200  # a robot is written at most so often
POSE_MS = 500  # and drawn for viewers at most so often
GRANT_MS = 1_000  # what it was granted, too
CHUNK_MS = 1_000  # so much is lost by kill -9 at most
FILE_MS_MAX = 3_600_000
FILE_BYTES_MAX = 64 * 1024 * 1024
DAY_MS = 24 * 3_600_000
KEEP_MS = 7 * DAY_MS
KEEP_BYTES_MAX = 2 * 1024**3
RETRY_MS = 60_000  # after a failed write (disk full), before a new file is tried

log = structlog.get_logger()
Action: TypeAlias = Callable[[TelemetryFile], None]


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
        opened: Opened = lambda path: path.open("xb"),
    ) -> None:
        """Take the folder; the first file is made by the first write, by `opened`."""
        self._directory = directory
        self._sample_ms, self._pose_ms, self._chunk_ms = sample_ms, pose_ms, chunk_ms
        self._file_ms_max, self._file_bytes_max = file_ms_max, file_bytes_max
        self._keep_ms, self._keep_bytes_max = keep_ms, keep_bytes_max
        self._opened = opened
        self._lock = Lock()
        self._reports = ReportSeries()
        self._plans = PlanSeries()
        self._drawn: dict[RobotKey, Report] = {}  # where viewers have seen a robot last
        self._granted_ms: dict[RobotKey, int] = {}  # and what it was granted
        self._file: TelemetryFile | None = None
        self._now_ms = 0
        self._broken_ms: int | None = None

    def write(self, reports: Sequence[Report], now_ms: int | None = None) -> None:
        """Take in what robots reported; `now_ms` defaults to the newest report's time."""
        with self._lock:
            self._advance(now_ms, [r.at_ms for r in reports])
            for scene in {r.scene for r in reports} - self._reports.scenes:
                known = last_reports(self._directory, scene)
                self._reports.seed(scene, known.values())
            batches = list(self._reports.changed(reports, self._now_ms, self._sample_ms))
            self._put(batches, lambda file: self._draw(file, reports))

    def write_plans(self, plans: Sequence[Plan], now_ms: int | None = None) -> None:
        """Take in what traffic intends."""
        with self._lock:
            self._advance(now_ms, [p.at_ms for p in plans])
            for scene in {p.scene for p in plans} - self._plans.scenes:
                known = last_plans(self._directory, scene)
                self._plans.seed(scene, known.values())
            batches = list(self._plans.changed(plans, self._now_ms, self._sample_ms))
            self._put(batches, lambda file: self._draw_grants(file, plans))

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

    def _put(self, batches: Sequence[ReportBatch | PlanBatch], draw: Action) -> None:
        if self._broken_ms is not None and self._now_ms - self._broken_ms < RETRY_MS:
            return
        if self._file is None and not batches:
            return
        self._guarded(lambda file: self._fill(file, batches, draw))

    def _fill(
        self, file: TelemetryFile, batches: Sequence[ReportBatch | PlanBatch], draw: Action
    ) -> None:
        now_ms = self._now_ms
        if file.whole_ms is None or now_ms - file.whole_ms >= WHOLE_EVERY_MS:
            file.flush(now_ms)  # whole batches begin a chunk
            file.whole_ms = now_ms
            self._drawn.clear()
            self._granted_ms.clear()
            for reports in self._reports.whole(now_ms):
                file.add(reports)
            for plans in self._plans.whole(now_ms):
                file.add(plans)
            self._draw(file, self._reports.newest.values())
            self._draw_grants(file, self._plans.newest.values())
        else:
            for batch in batches:
                file.add(batch)
            draw(file)
        if now_ms - file.chunk_ms >= self._chunk_ms:
            file.flush(now_ms)

    def _draw(self, file: TelemetryFile, reports: Iterable[Report]) -> None:
        by_scene: dict[SceneId, list[Report]] = {}
        for report in reports:
            key = robot_key(report.scene, report.robot)
            last = self._drawn.get(key)
            if last is None or (
                report.at_ms - last.at_ms >= self._pose_ms and _pose(report) != _pose(last)
            ):
                by_scene.setdefault(report.scene, []).append(report)
                self._drawn[key] = report
        for scene, drawn in by_scene.items():
            file.draw(scene, POSES, self._now_ms, poses(drawn))

    def _draw_grants(self, file: TelemetryFile, plans: Iterable[Plan]) -> None:
        by_scene: dict[SceneId, list[tuple[Plan, Report]]] = {}
        for plan in plans:
            key = robot_key(plan.scene, plan.robot)
            report = self._reports.newest.get(key)
            seen_ms = self._granted_ms.get(key)
            if report is not None and (seen_ms is None or plan.at_ms - seen_ms >= GRANT_MS):
                by_scene.setdefault(plan.scene, []).append((plan, report))
                self._granted_ms[key] = plan.at_ms
        for scene, drawn in by_scene.items():
            file.draw(scene, GRANTS, self._now_ms, grants(drawn))

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
            self._now_ms - file.start_ms >= self._file_ms_max or file.length >= self._file_bytes_max
        ):
            file.close()
            file = None
        if file is None:
            file = TelemetryFile(self._directory, self._now_ms, self._opened)
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
