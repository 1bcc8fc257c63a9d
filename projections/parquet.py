"""Orders, steps and events as Parquet files by day, for DuckDB, pandas, Spark and whoever comes.

`OUT/orders/day=2026-11-22/part-0.parquet`: the hive layout. Days are whole and in UTC. An order and
its steps stand in the day in which it ended, so a day that is over never changes again; orders that
are still open are in none. Events stand in the day in which they happened.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ledger.errors import Refused
from ledger.events import AnyEvent
from ledger.ids import SceneId
from ledger.scene import Value
from ledger.snapshot import restore
from ledger.state import Fleet
from projections.projector import Projector
from projections.tables import EVENTS, ORDERS, STEPS, Column, arrow, steps_of

DAY_MS = 86_400_000
FILE = "part-0.parquet"
DRAFT = ".draft"
BATCH_EVENTS = 20_000  # in memory at once; their rows are one row group
_LEAN = tuple(c for c in ORDERS if c.name not in ("body", "done_position"))
TABLES: tuple[tuple[str, tuple[Column[Any], ...]], ...] = (
    ("orders", _LEAN),
    ("steps", STEPS),
    ("events", EVENTS),
)

Read = Callable[[int], Iterator[AnyEvent]]  # events behind a position, in order
Progress = Callable[[int, int], None]


class Exported(Value, frozen=True, kw_only=True):
    """What was written."""

    days: int = 0
    orders: int = 0
    steps: int = 0
    events: int = 0


def export_parquet(
    data: Path,
    out: Path,
    read: Read,
    *,
    scene: str | None = None,
    from_ms: int | None = None,
    to_ms: int | None = None,
    progress: Progress = lambda done, total: None,
) -> Exported:
    """Write every day that the stretch touches, each whole; raises Refused in words.

    A day's files appear when they are whole, in place of those of an earlier run: the same events
    give the same rows. The folder's server may run or not.
    """
    if from_ms is not None and to_ms is not None and from_ms > to_ms:
        raise Refused("errFieldInvalid", "'--from' lies after '--to'.")
    newest = restore(data / "ledger", data / "snapshots")
    if newest.position == 0:
        raise Refused("errNothingToExport", f"{data}: the ledger has no events yet.")
    if scene is not None and scene not in newest.scenes:
        raise Refused("errSceneNotFound", f"There is no scene '{scene}'.", scene)
    first = 0 if from_ms is None else _day_of(from_ms)
    last = _day_of(newest.at_ms if to_ms is None else to_ms)
    before = Fleet()
    if from_ms is not None:
        before = restore(data / "ledger", data / "snapshots", at_ms=first * DAY_MS - 1)
    projector = Projector(before)
    begin = before.position
    days = _Days(out, None if scene is None else SceneId(scene))
    try:
        for event in read(begin):
            day = _day_of(event.at_ms)
            if event.position > newest.position or day > last:
                break
            if day != days.day:
                days.add(projector)
                days.turn(day)
            projector.take(event)
            if len(projector.events) == BATCH_EVENTS:
                days.add(projector)
                progress(event.position - begin, newest.position - begin)
        days.add(projector)
        days.finish()
    except OSError as trouble:  # Arrow's own names no file
        raise Refused("errExportFailed", f"{out}: {trouble}", str(out)) from trouble
    finally:
        days.drop()
    return days.exported


class _Days:
    """The files of one day after the other; at most one day's are open."""

    def __init__(self, out: Path, scene: SceneId | None) -> None:
        self.day: int | None = None
        self.exported = Exported()
        self._out, self._scene = out, scene
        self._writers: dict[str, pq.ParquetWriter] = {}

    def turn(self, day: int) -> None:
        """Finish the day, and begin another one."""
        self.finish()
        self.day = day

    def add(self, projector: Projector) -> None:
        """Take what the projector has gathered, which is all of this day."""
        ended = [p for p in projector.ended if self._wanted(p.order.scene)]
        events = [e for e in projector.events if self._wanted(e.scene)]
        steps = [step for placed in ended for step in steps_of(placed)]
        projector.clear()
        some: tuple[Sequence[Any], ...] = (ended, steps, events)
        for (name, columns), rows in zip(TABLES, some, strict=True):
            if rows:
                self._write(name, _timed(arrow(columns, rows), columns))
        self.exported = Exported(
            days=self.exported.days,
            orders=self.exported.orders + len(ended),
            steps=self.exported.steps + len(steps),
            events=self.exported.events + len(events),
        )

    def _wanted(self, scene: str) -> bool:
        return self._scene is None or scene == self._scene

    def _write(self, name: str, rows: pa.Table) -> None:
        writer = self._writers.get(name)
        if writer is None:
            path = self._path(name)
            path.parent.mkdir(parents=True, exist_ok=True)
            draft = path.with_name(path.name + DRAFT)
            writer = pq.ParquetWriter(draft, rows.schema, compression="zstd")
            self._writers[name] = writer
        writer.write_table(rows)

    def _path(self, name: str) -> Path:
        assert self.day is not None
        day = datetime.fromtimestamp(self.day * DAY_MS // 1000, UTC)
        return self._out / name / f"day={day:%Y-%m-%d}" / FILE

    def finish(self) -> None:
        """Put the day's files in place; one of an earlier run goes where there are no rows now."""
        if self.day is None:
            return
        for name, _ in TABLES:
            path = self._path(name)
            writer = self._writers.get(name)
            if writer is None:
                path.unlink(missing_ok=True)
                continue
            writer.close()
            draft = path.with_name(path.name + DRAFT)
            _sync(draft)
            draft.replace(path)
            _sync(path.parent)
            del self._writers[name]
        exported = self.exported
        self.exported = Exported(
            days=exported.days + 1,
            orders=exported.orders,
            steps=exported.steps,
            events=exported.events,
        )
        self.day = None

    def drop(self) -> None:
        """Take away what is not whole."""
        for name, writer in self._writers.items():
            writer.close()
            path = self._path(name)
            path.with_name(path.name + DRAFT).unlink(missing_ok=True)
        self._writers = {}


def _day_of(at_ms: int) -> int:
    return at_ms // DAY_MS


def _timed(rows: pa.Table, columns: Sequence[Column[Any]]) -> pa.Table:
    """Make epoch milliseconds times: readers of Parquet know what these are."""
    for number, column in enumerate(columns):
        if column.type == "BIGINT" and column.name.endswith(("_on", "at_ms")):
            name = "at_on" if column.name == "at_ms" else column.name
            values = rows.column(number).cast(pa.timestamp("ms", tz="UTC"))
            rows = rows.set_column(number, name, values)
    return rows


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
