from pathlib import Path

from ledger.events import AnyEvent
from ledger.events.orders import OfOrder
from ledger.evolve import fold
from ledger.ids import OrderId
from ledger.state import Fleet
from ledger.store import MemoryLedger
from projections.history import History
from projections.live import Live
from projections.story import Stories
from tests.histories import history as some_history


def test_a_story_is_whole_whether_duckdb_has_all_of_it_or_only_its_beginning(
    tmp_path: Path,
) -> None:
    events = some_history(3, 300)
    half = len(events) // 2
    # DuckDB gets the first half; the second is only in memory and in the ledger
    live = Live(fold(Fleet(), events[:half]))
    history = History(tmp_path / "history.duckdb", live)
    history.start(MemoryLedger(events[:half]).read, lambda position: Fleet())
    live.apply(events[half:])
    stories = Stories(history, live, MemoryLedger(events).read)

    orders = {e.order for e in events if isinstance(e, OfOrder)}
    assert orders
    for order in orders:
        assert stories.story(order) == _of(events, order)
    history.close()


def test_ended_orders_come_from_both_places_newest_created_first(tmp_path: Path) -> None:
    events = some_history(5, 400)
    half = len(events) // 2
    live = Live(fold(Fleet(), events[:half]))
    history = History(tmp_path / "history.duckdb", live)
    history.start(MemoryLedger(events[:half]).read, lambda position: Fleet())
    live.apply(events[half:])
    stories = Stories(history, live, MemoryLedger(events).read)
    scene = next(iter(live.fleet.scenes))

    found = stories.finished(scene, events[-1].position, 1000)

    known = {e.order for e in events if isinstance(e, OfOrder) and e.scene == scene}
    assert {o.id for o in found} == known - set(live.fleet.orders)
    assert [o.created_ms for o in found] == sorted((o.created_ms for o in found), reverse=True)
    assert all(o.terminal for o in found)
    history.close()


def _of(events: list[AnyEvent], order: OrderId) -> list[AnyEvent]:
    return [e for e in events if isinstance(e, OfOrder) and e.order == order]
