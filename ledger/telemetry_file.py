"""One telemetry file being written: the stock MCAP writer, and the channels we fill."""

import contextlib
import math
from pathlib import Path
from typing import IO

import msgspec
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from ledger.ids import RobotKey, robot_key
from ledger.link import Report
from ledger.telemetry_format import (
    NS_PER_MS,
    PLANS_TOPIC,
    REPORTS_TOPIC,
    PlanBatch,
    ReportBatch,
    file_name,
)


class TelemetryFile:
    """One open file and its stock writer."""

    def __init__(self, directory: Path, at_ms: int) -> None:
        """Create the file; the channels of reports and plans are in its first chunk."""
        directory.mkdir(parents=True, exist_ok=True)
        self.path, self._stream = create(directory, at_ms)
        self.start_ms = self.chunk_ms = at_ms
        self.whole_ms: int | None = None
        self.index_entries = 0
        self._writer = Writer(self._stream)
        self._writer.start(profile="", library="fleetledger")
        self._poses: dict[RobotKey, int] = {}
        self._reports = self._json_channel(REPORTS_TOPIC, ReportBatch)
        self._plans = self._json_channel(PLANS_TOPIC, PlanBatch)
        self._pose_schema = self._writer.register_schema(
            name=PoseInFrame.DESCRIPTOR.full_name,
            encoding=SchemaEncoding.Protobuf,
            data=build_file_descriptor_set(PoseInFrame).SerializeToString(),
        )

    def _json_channel(self, topic: str, shape: type[ReportBatch] | type[PlanBatch]) -> int:
        schema = self._writer.register_schema(
            name=f"fleetledger.{shape.__name__}",
            encoding=SchemaEncoding.JSONSchema,
            data=msgspec.json.encode(msgspec.json.schema(shape)),
        )
        return self._writer.register_channel(topic, MessageEncoding.JSON, schema)

    def add(self, batch: ReportBatch | PlanBatch) -> None:
        """Add one message of ours."""
        channel = self._reports if isinstance(batch, ReportBatch) else self._plans
        at_ns = batch.at_ms * NS_PER_MS
        self._writer.add_message(channel, at_ns, msgspec.json.encode(batch), at_ns)

    def add_pose(self, report: Report, now_ms: int) -> None:
        """Add what Foxglove and Rerun draw; the frame is the scene's area."""
        key = robot_key(report.scene, report.robot)
        if key not in self._poses:
            topic = f"/scenes/{report.scene}/robots/{report.robot}/pose"
            self._poses[key] = self._writer.register_channel(
                topic, MessageEncoding.Protobuf, self._pose_schema
            )
        message = PoseInFrame(frame_id=f"{report.scene}/{report.area}")
        message.timestamp.FromMilliseconds(report.at_ms)
        message.pose.position.x = report.x_m
        message.pose.position.y = report.y_m
        message.pose.orientation.z = math.sin(report.heading_rad / 2)
        message.pose.orientation.w = math.cos(report.heading_rad / 2)
        self._writer.add_message(
            self._poses[key],
            now_ms * NS_PER_MS,
            message.SerializeToString(),
            report.at_ms * NS_PER_MS,
        )

    def flush(self, now_ms: int) -> None:
        """Close the chunk and hand it to the system; no sync, for this is best effort."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self.chunk_ms = now_ms
        self.index_entries += len(self._poses) + 2

    @property
    def length(self) -> int:
        """Bytes so far."""
        return self._stream.tell()

    def close(self) -> None:
        """Write the index and footer."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._stream.close()

    def abandon(self) -> None:
        """Let go of a file that cannot be written; it stays readable as far as it got."""
        with contextlib.suppress(OSError):
            self._stream.close()


def create(directory: Path, at_ms: int) -> tuple[Path, IO[bytes]]:
    """Create a file that did not exist: a telemetry file is never opened for writing again."""
    again = 0
    while True:
        path = directory / file_name(at_ms, again)
        try:
            return path, path.open("xb")
        except FileExistsError:
            again += 1
