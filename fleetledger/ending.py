"""What a server does whose ledger has failed: refuse commands, answer queries a while, and end."""

import asyncio
from collections.abc import Callable

import structlog

from ledger.errors import LedgerError

FAILED_CODE = 3  # exit code

log = structlog.get_logger()


class Ending:
    """Hears of the failure, and sets `stop` when the grace is over; a signal may set it before."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        stop: asyncio.Event,
        grace_s: float,
        tell: Callable[[LedgerError], None],
    ) -> None:
        """Take how long queries go on, and who is to hear of a failure first, on its thread."""
        self._loop = loop
        self._stop = stop
        self._grace_s = grace_s
        self._tell = tell
        self.exit_code = 0

    def failed(self, failure: LedgerError) -> None:
        """Take the news; called on the committer's thread."""
        self.exit_code = FAILED_CODE
        self._tell(failure)
        self._loop.call_soon_threadsafe(self._begin, failure)

    def _begin(self, failure: LedgerError) -> None:
        log.critical(
            "ledger failed; commands are refused, queries are answered a little longer",
            reason=str(failure),
            hint=failure.hint,
            ends_in_s=self._grace_s,
        )
        self._loop.call_later(self._grace_s, self._stop.set)
