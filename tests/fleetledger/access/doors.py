"""Access in a folder, with a handler and a clock of the test's own."""

from pathlib import Path

from commands.handle import Handler
from fleetledger.access.service import Access
from ledger.events import AnyEvent
from ledger.state import Fleet
from ledger.store import MemoryLedger

START_MS = 1_760_000_000_000


class Doors:
    """A server's access, whose time goes when it is told to."""

    def __init__(self, data: Path, *, enforced: bool = True) -> None:
        self.data = data
        self.now_ms = START_MS
        self.ledger = MemoryLedger()
        self._ids = 0
        self.handler = Handler(Fleet(), self.ledger, lambda: self.now_ms, self._new_id)
        self.access = self.opened(enforced=enforced)

    def opened(self, *, enforced: bool = True) -> Access:
        """Open the folder, as a start does."""
        return Access(
            self.data,
            enforced=enforced,
            handler=self.handler,
            durable=self._durable,
            now_ms=lambda: self.now_ms,
            now_s=lambda: self.now_ms / 1000,
        )

    def pass_s(self, seconds: float) -> None:
        self.now_ms += int(seconds * 1000)

    def told(self) -> list[AnyEvent]:
        """Events that the ledger has."""
        return list(self.ledger.read(0))

    def _new_id(self) -> str:
        self._ids += 1
        return f"{self._ids:024X}"

    async def _durable(self, position: int) -> None:
        assert position <= self.handler.fleet.position
