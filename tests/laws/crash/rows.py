"""The projector's rows over many lives of the core, committed when the simulation says so."""

from collections.abc import Sequence

from ledger.events import AnyEvent
from ledger.evolve import fold
from ledger.state import Fleet
from ledger.store import Ledger
from projections.archive import Archive
from projections.live import Live
from projections.projector import Projector
from tests.laws.crash.witness import Witness


class Rows:
    """DuckDB keeps what it committed; what was only taken in is gone with the core."""

    def __init__(self) -> None:
        self._archive = Archive.open(None)
        self._projector = Projector(Fleet())
        self._live: Live | None = None

    def go_on(self, ledger: Ledger, live: Live) -> None:
        """Begin a life of the core as `projections.history` does."""
        position = self._archive.position
        assert position <= ledger.durable, f"rows up to {position}, events up to {ledger.durable}"
        assert self._archive.belongs_to(ledger.read), "rows of another history"
        self._live = live
        self._projector = Projector(fold(Fleet(), ledger.read(0, position)))
        self._archive.catch_up(self._projector, ledger.read, stop=lambda: False)
        live.forget(self._archive.position)

    def follow(self, events: Sequence[AnyEvent]) -> None:
        """Take in durable events."""
        for event in events:
            self._projector.take(event)

    def commit(self) -> None:
        """Put into the file what has been taken in."""
        self._archive.commit(self._projector)
        if self._live is not None:
            self._live.forget(self._archive.position)

    def begin_anew(self) -> None:
        """Lose the file."""
        self._archive.close()
        self._archive = Archive.open(None)

    def check(self, witness: Witness) -> None:
        """Every ended order is one row, and so is each event of an order."""
        cursor = self._archive.cursor()
        events = cursor.execute("SELECT position FROM order_events ORDER BY position").fetchall()
        due = [(e["position"],) for e in witness.shown if "order" in e]
        assert events == [at for at in due if at[0] <= self._archive.position], "rows of events"
        ended = cursor.execute("SELECT id, done_position FROM orders_done ORDER BY id").fetchall()
        due = {i: p for i, p in witness.orders.ended.items() if p <= self._archive.position}
        assert ended == sorted(due.items()), "rows are not the ended orders"

    def close(self) -> None:
        """Free the memory."""
        self._archive.close()
