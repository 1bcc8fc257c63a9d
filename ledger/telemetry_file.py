"""One telemetry file being written: the stock MCAP writer, and the channels we fill."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import IO, TypeAlias

import msgspec
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from ledger.ids import SceneId
from ledger.telemetry_drawing import GRANTS, POSES
from ledger.telemetry_format import (
    NS_PER_MS,
    PLANS_TOPIC,
    REPORTS_TOPIC,
    PlanBatch,
    ReportBatch,
    file_name,
)

Opened: TypeAlias = Callable[[Path], IO[bytes]]  # raises FileExistsError, and OSError
Drawing: TypeAlias = type[FrameTransforms] | type[SceneUpdate]


class TelemetryFile:
    """One open file and its stock writer."""

    def __init__(self, directory: Path, at_ms: int, opened: Opened) -> None:
        """Create the file; the channels of reports and plans are in its first chunk."""
        directory.mkdir(parents=True, exist_ok=True)
        self.path, self._stream = create(directory, at_ms, opened)
        self.start_ms = self.chunk_ms = at_ms
        self.whole_ms: int | None = None
        self._writer = Writer(self._stream, enable_data_crcs=True)
        self._writer.start(profile="", library="fleetledger")
        self._reports = self._json_channel(REPORTS_TOPIC, ReportBatch)
        self._plans = self._json_channel(PLANS_TOPIC, PlanBatch)
        self._drawings = {kind: self._drawn_schema(kind) for kind in (POSES, GRANTS)}
        self._drawn: dict[tuple[SceneId, Drawing], int] = {}

    def _drawn_schema(self, kind: Drawing) -> int:
        number: int = self._writer.register_schema(
            name=kind.DESCRIPTOR.full_name,
            encoding=SchemaEncoding.Protobuf,
            data=build_file_descriptor_set(kind).SerializeToString(),
        )
        return number

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

    def draw(self, scene: SceneId, kind: Drawing, at_ms: int, data: bytes) -> None:
        """Add what Foxglove and Rerun draw: one message of many robots."""
        channel = self._drawn.get((scene, kind))
        if channel is None:
            topic = f"/scenes/{scene}/{'robots' if kind is POSES else 'grants'}"
            channel = self._drawn[scene, kind] = self._writer.register_channel(
                topic, MessageEncoding.Protobuf, self._drawings[kind]
            )
        self._writer.add_message(channel, at_ms * NS_PER_MS, data, at_ms * NS_PER_MS)

    def flush(self, now_ms: int) -> None:
        """Close the chunk and hand it to the system; no sync, for this is best effort."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self.chunk_ms = now_ms

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


def create(directory: Path, at_ms: int, opened: Opened) -> tuple[Path, IO[bytes]]:
    """Create a file that did not exist: a telemetry file is never opened for writing again."""
    again = 0
    while True:
        path = directory / file_name(at_ms, again)
        try:
            return path, opened(path)
        except FileExistsError:
            again += 1
