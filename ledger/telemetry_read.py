"""Reads the telemetry log back: any moment, any stretch, also of the file being written just now.

Files are scanned once for where their chunks lie and what time they cover, then only for what was
appended since. Torn or damaged chunks are passed over: this log is best effort.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import zip_longest
from pathlib import Path
from threading import RLock
from typing import Generic, TypeVar

import msgspec

from ledger.ids import RobotName, SceneId
from ledger.link import Plan, Report
from ledger.telemetry_chunks import Chunk, ChunkFile, Message
from ledger.telemetry_fold import Fold, PlanFold, ReportFold
from ledger.telemetry_format import (
    LOOK_BACK_MS,
    PLANS_TOPIC,
    REPORTS_TOPIC,
    SPREAD_MS,
    WHOLE_EVERY_MS,
    Head,
    PlanBatch,
    ReportBatch,
    files,
)

CHUNKS_CACHED = 64
DIRECTORIES_CACHED = 8
STRETCH_MS_MAX = 2 * WHOLE_EVERY_MS + SPREAD_MS  # from a batch back to its whole one

Item = TypeVar("Item", Report, Plan)


class _Kind(Generic[Item]):
    """Which messages hold reports, or plans, and how to decode and follow them."""

    def __init__(
        self,
        topic: str,
        shape: type[ReportBatch] | type[PlanBatch],
        fold: Callable[[], Fold[Item]],
    ) -> None:
        self.topic = topic
        self.fold: Callable[[], Fold[Item]] = fold
        self._decoder = msgspec.json.Decoder(shape)
        self._head = msgspec.json.Decoder(Head)

    def head(self, message: Message, scene: SceneId) -> Head | None:
        """Decode the front of a message of this topic and scene; None for all others."""
        if message.topic != self.topic:
            return None
        try:
            head = self._head.decode(message.data)
        except msgspec.MsgspecError:
            return None  # written by another version
        return head if head.scene == scene else None

    def feed(self, fold: Fold[Item], message: Message, until_ms: int) -> list[RobotName]:
        """Take a message of this topic and scene into a fold; give the robots it tells of."""
        try:
            return fold.feed(self._decoder.decode(message.data), until_ms)
        except msgspec.MsgspecError:
            return []


REPORTS: _Kind[Report] = _Kind(REPORTS_TOPIC, ReportBatch, ReportFold)
PLANS: _Kind[Plan] = _Kind(PLANS_TOPIC, PlanBatch, PlanFold)


class TelemetryReader:
    """Where everything lies in one telemetry folder, as far as it was looked at. Thread-safe."""

    def __init__(self, directory: Path) -> None:
        """Take the folder; it need not exist yet."""
        self._directory = directory
        self._lock = RLock()
        self._files: dict[Path, ChunkFile] = {}
        self._messages: OrderedDict[tuple[Path, int], list[Message]] = OrderedDict()

    def at(self, kind: _Kind[Item], scene: SceneId, at_ms: int) -> dict[RobotName, Item]:
        """Give the newest of every robot at or before the moment.

        Goes backwards to the last whole batch, and no further than `LOOK_BACK_MS`; then forwards.
        """
        found: list[Message] = []
        newest_ms: int | None = None  # of the batches at or before the moment
        for message in self._backwards(at_ms):
            head = kind.head(message, scene)
            if head is None:
                continue
            if newest_ms is not None and newest_ms - head.at_ms > STRETCH_MS_MAX:
                break  # the whole batch is lost: these stand for themselves
            found.append(message)
            if head.at_ms <= at_ms:
                newest_ms = head.at_ms if newest_ms is None else newest_ms
                if head.whole:
                    break
        fold: Fold[Item] = kind.fold()
        for message in reversed(found):
            kind.feed(fold, message, at_ms)
        return fold.newest()

    def newest_ms(self) -> int | None:
        """Give when the newest message was written; None where there is none."""
        with self._lock:
            for start_ms, _ in reversed(files(self._directory)):
                scanned = self._scanned(start_ms, start_ms)
                ends = [chunk.end_ms for file in scanned for chunk in file.chunks]
                if ends:
                    return max(ends)
        return None

    def _backwards(self, at_ms: int) -> Iterator[Message]:
        for file in reversed(self._scanned(at_ms - LOOK_BACK_MS, at_ms)):
            for chunk in reversed(tuple(file.chunks)):
                if chunk.start_ms > at_ms + SPREAD_MS:
                    continue
                if chunk.end_ms < at_ms - LOOK_BACK_MS:
                    return
                for message in reversed(self._unpacked(file, chunk)):
                    if message.at_ms <= at_ms + SPREAD_MS:
                        yield message

    def between(
        self, kind: _Kind[Item], scene: SceneId, from_ms: int, to_ms: int
    ) -> Iterator[Item]:
        """Give everything from one moment up to another, both included, each item once.

        For one robot in order of time; robots are mixed, in the order of writing.
        """
        last: dict[RobotName, int] = {}
        fold: Fold[Item] = kind.fold()
        whole_ms = from_ms - STRETCH_MS_MAX  # what steps are counted from is no older
        for file in self._scanned(whole_ms, to_ms):
            for chunk in tuple(file.chunks):
                if chunk.end_ms < whole_ms or chunk.start_ms > to_ms + SPREAD_MS:
                    continue
                for message in self._unpacked(file, chunk):
                    if kind.head(message, scene) is None:
                        continue
                    for robot in kind.feed(fold, message, to_ms):
                        at_ms = fold.at_ms(robot)
                        if at_ms > last.get(robot, from_ms - 1):
                            last[robot] = at_ms
                            yield fold.item(robot)

    def _scanned(self, from_ms: int, to_ms: int) -> list[ChunkFile]:
        """Scan the files that may hold something of the stretch, oldest first."""
        with self._lock:
            known = files(self._directory)
            ends = [start_ms for start_ms, _ in known[1:]]
            wanted = [
                path
                for (start_ms, path), end_ms in zip_longest(known, ends)
                if start_ms <= to_ms + SPREAD_MS and (end_ms is None or end_ms + 1000 >= from_ms)
            ]
            self._files = {path: self._files.get(path) or ChunkFile(path) for _, path in known}
            for path in wanted:
                self._files[path].scan()
            return [self._files[path] for path in wanted]

    def _unpacked(self, file: ChunkFile, chunk: Chunk) -> list[Message]:
        key = (file.path, chunk.offset)
        with self._lock:
            messages = self._messages.get(key)
            if messages is None:
                messages = self._messages[key] = file.messages(chunk)
                if len(self._messages) > CHUNKS_CACHED:
                    self._messages.popitem(last=False)
            self._messages.move_to_end(key)
            return messages


@lru_cache(maxsize=DIRECTORIES_CACHED)
def reader(directory: Path) -> TelemetryReader:
    """Give the one reader of a folder, which remembers what it scanned."""
    return TelemetryReader(directory)


def reports_at(directory: Path, scene: SceneId, at_ms: int) -> dict[RobotName, Report]:
    """Give the newest report of each robot at or before the moment, an hour back at most."""
    return reader(directory).at(REPORTS, scene, at_ms)


def plans_at(directory: Path, scene: SceneId, at_ms: int) -> dict[RobotName, Plan]:
    """Give what traffic intended with each robot at the moment."""
    return reader(directory).at(PLANS, scene, at_ms)


def last_reports(directory: Path, scene: SceneId) -> dict[RobotName, Report]:
    """Give what robots said last before the log ends, however long ago that is."""
    at_ms = reader(directory).newest_ms()
    return {} if at_ms is None else reports_at(directory, scene, at_ms)


def last_plans(directory: Path, scene: SceneId) -> dict[RobotName, Plan]:
    """Give what traffic intended last before the log ends."""
    at_ms = reader(directory).newest_ms()
    return {} if at_ms is None else plans_at(directory, scene, at_ms)


def read_telemetry(directory: Path, scene: SceneId, from_ms: int, to_ms: int) -> Iterator[Report]:
    """Give all reports written of a stretch of time, both ends included."""
    return reader(directory).between(REPORTS, scene, from_ms, to_ms)


def read_plans(directory: Path, scene: SceneId, from_ms: int, to_ms: int) -> Iterator[Plan]:
    """Give all plans written of a stretch of time, both ends included."""
    return reader(directory).between(PLANS, scene, from_ms, to_ms)
