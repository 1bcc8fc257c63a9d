"""The sealer's process: packs finished segments, as long as there are some, and ends."""

import os
import signal
import sys
from pathlib import Path

import structlog

from fleetledger.logs import configure
from fleetledger.orphaned import stop_when_orphaned
from ledger.disk import Disk
from ledger.errors import LedgerError, next_step
from ledger.seal import seal_folder

NICE = 19  # nobody waits for it
FAILED = 1  # exit code: at least one segment stays as it is

log = structlog.get_logger()


def run_sealer(data: Path) -> int:
    """Seal all that can be sealed; gives the exit code."""
    os.setpgid(0, 0)  # Ctrl-C is for the server, which stops its children in order
    os.nice(NICE)
    configure(process="sealer", as_json=not sys.stderr.isatty())
    stop = stop_when_orphaned()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    failures = 0

    def failed(path: Path, trouble: Exception) -> None:
        nonlocal failures
        failures += 1
        hint = trouble.hint if isinstance(trouble, LedgerError) else next_step(trouble)
        log.error("segment not sealed", segment=path.name, reason=str(trouble), hint=hint)

    for done in seal_folder(Disk(), data / "ledger", stop.is_set, failed):
        log.info(
            "segment sealed",
            segment=done.path.name,
            events=done.events,
            bytes_before=done.bytes_before,
            bytes_after=done.bytes_after,
        )
    return FAILED if failures else 0
