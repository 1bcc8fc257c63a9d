"""History as Parquet by day: whole days, the same rows again, readable by others."""

from datetime import date, timedelta
from functools import partial
from pathlib import Path

import duckdb
import msgspec
import pyarrow.parquet as pq
import pytest

from ledger.errors import Refused
from ledger.events import AnyEvent
from ledger.evolve import evolve
from ledger.ids import OrderId
from ledger.scan import read_folder
from ledger.snapshot import save
from ledger.state import Fleet, Order
from ledger.store import FileLedger
from projections import parquet
from projections.parquet import DAY_MS, Exported, export_parquet
from tests.projections.past import Log, all_orders, long_log

SLOWER = 600  # the events of minutes are drawn out over days


def _drawn_out(log: Log) -> Log:
    start_ms = log.events[0].at_ms
    replace = msgspec.structs.replace
    return Log([replace(e, at_ms=start_ms + (e.at_ms - start_ms) * SLOWER) for e in log.events])


LOG = _drawn_out(long_log(1_200))
FIRST, LAST = LOG.events[0].at_ms // DAY_MS, LOG.events[-1].at_ms // DAY_MS


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a snapshot in the middle."""
    folder = tmp_path_factory.mktemp("data")
    ledger = FileLedger.open(folder / "ledger")
    for start in range(0, len(LOG.events), 100):
        ledger.append(LOG.events[start : start + 100], start)
    ledger.close()
    save(folder / "snapshots", LOG.fleet_at(500))
    return folder


def export(data: Path, out: Path, **more: object) -> Exported:
    read = partial(read_folder, data / "ledger")
    return export_parquet(data, out, read, **more)  # type: ignore[arg-type]


def contents(out: Path) -> dict[str, list[dict[str, object]]]:
    files = sorted(out.rglob("*.*"))
    assert all(path.name == parquet.FILE for path in files)
    return {str(path.relative_to(out)): pq.ParquetFile(path).read().to_pylist() for path in files}


def day_name(day: int) -> str:
    return (date(1970, 1, 1) + timedelta(days=day)).isoformat()


def test_the_history_is_long_enough() -> None:
    assert LAST - FIRST >= 2


def test_others_read_every_ended_order_step_and_event(data: Path, tmp_path: Path) -> None:
    wrote = export(data, tmp_path)
    ended = {id_: order for id_, order in all_orders(LOG).items() if order.terminal}
    rows = duckdb.execute(
        f"SELECT id, status, epoch_ms(done_on), day::VARCHAR FROM '{tmp_path}/orders/*/*.parquet'"
    ).fetchall()
    assert {row[0]: row[1:] for row in rows} == {
        id_: (order.status.value, order.done_ms, day_name((order.done_ms or 0) // DAY_MS))
        for id_, order in ended.items()
    }
    assert len(rows) == wrote.orders
    steps = pq.read_table(tmp_path / "steps")
    assert steps.num_rows == wrote.steps == sum(len(o.steps) for o in ended.values())
    events = pq.read_table(tmp_path / "events").sort_by("position")
    assert events.column("position").to_pylist() == list(range(1, len(LOG.events) + 1))
    assert str(events.schema.field("at_on").type) == "timestamp[ms, tz=UTC]"
    assert [str(day) for day in events.column("day").to_pylist()] == [
        day_name(event.at_ms // DAY_MS) for event in LOG.events
    ]
    assert wrote.days == len({event.at_ms // DAY_MS for event in LOG.events})


def test_a_rerun_gives_the_same_rows_and_mends_what_was_broken(data: Path, tmp_path: Path) -> None:
    export(data, tmp_path)
    before = contents(tmp_path)
    broken = next(tmp_path.rglob(parquet.FILE))
    broken.write_bytes(b"not whole")
    export(data, tmp_path)
    assert contents(tmp_path) == before


def test_batches_do_not_show(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    export(data, tmp_path / "whole")
    monkeypatch.setattr(parquet, "BATCH_EVENTS", 37)
    export(data, tmp_path / "pieces")
    assert contents(tmp_path / "pieces") == contents(tmp_path / "whole")


def test_a_stretch_is_its_days_whole(data: Path, tmp_path: Path) -> None:
    """Also orders that were made before it, and a beginning behind a snapshot."""
    export(data, tmp_path / "all")
    everything = contents(tmp_path / "all")
    for day in range(FIRST, LAST + 1):
        out = tmp_path / str(day)
        noon_ms = day * DAY_MS + DAY_MS // 2
        export(data, out, from_ms=noon_ms, to_ms=noon_ms)
        expected = {name: rows for name, rows in everything.items() if day_name(day) in name}
        assert contents(out) == expected


def test_days_after_days_are_the_whole(data: Path, tmp_path: Path) -> None:
    export(data, tmp_path / "all")
    for day in range(FIRST, LAST + 1):
        export(data, tmp_path / "days", from_ms=day * DAY_MS, to_ms=day * DAY_MS)
    assert contents(tmp_path / "days") == contents(tmp_path / "all")


def test_a_break_leaves_whole_files_only(data: Path, tmp_path: Path) -> None:
    def breaks(after: int) -> object:
        for event in read_folder(data / "ledger", after):
            if event.position == 900:
                raise OSError(28, "No space left on device")
            yield event

    with pytest.raises(Refused, match="No space left"):
        export_parquet(data, tmp_path, breaks)  # type: ignore[arg-type]
    kept = contents(tmp_path)
    export(data, tmp_path / "all")
    everything = contents(tmp_path / "all")
    assert kept
    assert all(rows == everything[name] for name, rows in kept.items())


def test_one_scene_may_be_chosen(data: Path, tmp_path: Path) -> None:
    scene = LOG.events[0].scene
    assert export(data, tmp_path, scene=scene).events == sum(e.scene == scene for e in LOG.events)
    with pytest.raises(Refused, match="no scene 'x'"):
        export(data, tmp_path, scene="x")


def test_what_cannot_be_is_refused_in_words(data: Path, tmp_path: Path) -> None:
    with pytest.raises(Refused, match="after '--to'"):
        export(data, tmp_path, from_ms=2, to_ms=1)
    FileLedger.open(tmp_path / "ledger").close()
    with pytest.raises(Refused, match="no events"):
        export(tmp_path, tmp_path / "out")


def test_orders_are_as_they_ended(data: Path, tmp_path: Path) -> None:
    """Row by row against a fold of our own over each order's last version."""
    export(data, tmp_path)
    fleet, last = Fleet(), dict[OrderId, Order]()
    for event in LOG.events:
        _keep(last, fleet, event)
    rows = pq.read_table(tmp_path / "orders").to_pylist()
    for row in rows:
        order = last[row["id"]]
        assert row["actual_robot_name"] == order.robot
        assert row["step_num"] == len(order.steps)
        assert row["priority"] == order.priority


def _keep(last: dict[OrderId, Order], fleet: Fleet, event: AnyEvent) -> None:
    """Remember each order as it was before its last event, which changes none of these."""
    id_ = getattr(event, "order", None)
    if id_ is not None and id_ in fleet.orders:
        last[id_] = fleet.orders[id_]
    evolve(fleet, event)
