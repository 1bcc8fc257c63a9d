"""The core's side of sealing: starts the sealer's process when there is something to be sealed.

Whatever happens there, commits neither wait nor fail: a segment that is not sealed only takes more
room.
"""

import asyncio
import contextlib
import sys
from collections.abc import Callable
from pathlib import Path

import structlog
from prometheus_client import Counter, Gauge

from ledger.errors import LedgerError
from ledger.seal import unsealed
from ledger.segment import SUFFIX

FAILURES = Counter(
    "fleetledger_sealing_failures", "Runs of the sealer that left a segment unsealed"
)
UNSEALED = Gauge("fleetledger_unsealed_segments", "Finished segments that are still to be sealed")
LOOK_S = 5.0  # between two looks whether a segment has been finished
PAUSES_S = (10.0, 60.0, 600.0)  # before it is tried again; then not before the next segment
STOP_S = 2.0  # then it is killed: the whole server has 5 s (contract)
HINT = "Nothing is lost, the segment takes more room. The sealer's own log line says why."

log = structlog.get_logger()


class Sealer:
    """One process at a time, of low priority, and none while there is nothing to do."""

    def __init__(self, data: Path, low: Callable[[], bool]) -> None:
        """Take the data folder, and what tells that the disk is so full that it must not write."""
        self._data = data
        self._low = low
        self._process: asyncio.subprocess.Process | None = None

    async def run(self) -> None:
        """Seal at start and whenever a segment is finished, until cancelled."""
        seen = ""
        while True:
            newest = await asyncio.to_thread(self._newest)
            if newest != seen and not self._low():
                seen = newest
                for pause_s in (*PAUSES_S, None):
                    if await self._seal() or pause_s is None:
                        break
                    await asyncio.sleep(pause_s)
            await asyncio.sleep(LOOK_S)

    def _newest(self) -> str:
        return max((path.name for path in (self._data / "ledger").glob(f"*{SUFFIX}")), default="")

    async def _seal(self) -> bool:
        """Have all sealed that can be; False where some could not be."""
        try:
            if not await self._waiting():
                return True
            # in our own session: a system may share out the processor among sessions first
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                *("-m", "fleetledger", "role", "sealer", "--data", str(self._data)),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.DEVNULL,
            )
            code = await self._process.wait()
            self._process = None
            await self._waiting()
        except (LedgerError, OSError) as trouble:
            FAILURES.inc()
            log.error("sealing failed", reason=str(trouble), hint=HINT)
            return False
        if code:
            FAILURES.inc()
            log.error("sealing failed", exit_code=code, hint=HINT)
        return code == 0

    async def _waiting(self) -> int:
        """How many segments are to be sealed."""
        waiting = len(await asyncio.to_thread(unsealed, self._data / "ledger"))
        UNSEALED.set(waiting)
        return waiting

    async def stop(self) -> None:
        """Ask it to end, and kill it if it does not; what it has not done, the next start does."""
        process = self._process
        if process is None or process.returncode is not None:
            return
        assert process.stdin is not None
        process.stdin.close()
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        try:
            await asyncio.wait_for(process.wait(), STOP_S)
        except TimeoutError:
            log.warning("child killed", child="sealer")
            process.kill()
            await process.wait()
