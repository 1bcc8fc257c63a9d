"""Keeps the ledger's disk from getting full: below a reserve of free space no command is taken.

A write that fails ends the server, since nobody knows what of it is on disk. A command that is
refused before it is written ends nothing, and as soon as there is room the next one is taken.
"""

import asyncio
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import structlog
from prometheus_client import Gauge

from commands.handle import Appends
from ledger.errors import DiskFull, LedgerError
from ledger.events import AnyEvent

LOOK_S = 1.0  # between two looks at the disk
MB = 1_000_000

ACCEPTING = Gauge("fleetledger_ledger_accepting", "1 = the ledger takes commands, 0 = it does not")
FREE = Gauge("fleetledger_ledger_free_bytes", "Free space on the ledger's disk")

log = structlog.get_logger()


def free_bytes(folder: Path) -> int:
    """Give the space that this process may still fill on the folder's disk."""
    disk = os.statvfs(folder)
    return disk.f_bavail * disk.f_frsize


class DiskGuard:
    """The ledger as those who append see it. `look` may run on any thread."""

    def __init__(
        self,
        ledger: Appends,
        folder: Path,
        reserve_bytes: int,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        """Take the ledger, its folder, what must stay free there, and how to measure it."""
        self._ledger = ledger
        self._folder = folder
        self._reserve_bytes = reserve_bytes
        self._measure = free
        self._free_bytes = reserve_bytes
        self._failed = False
        self.low = False  # too little is free

    def append(self, events: Sequence[AnyEvent], expected: int) -> int:
        """Append as the ledger does; raises DiskFull, and then nothing was appended."""
        if self.low:
            raise DiskFull(self._words())
        return self._ledger.append(events, expected)

    def check(self) -> None:
        """Look now; raises DiskFull where there is too little room, and OSError."""
        self._measured(self._measure(self._folder))
        if self.low:
            full = DiskFull(self._words())
            full.hint = "Free space on that disk, or lower disk_reserve_mb, then start again."
            raise full

    def look(self) -> None:
        """Measure, and tell when it begins or ceases to be too little. Never raises."""
        try:
            free = self._measure(self._folder)
        except OSError as trouble:  # then appends will fail, and say more
            log.warning("free space is not known", reason=str(trouble))
            return
        was_low = self.low
        self._measured(free)
        if self.low and not was_low:
            log.critical("commands are refused", reason=self._words(), hint=DiskFull.hint)
        elif was_low and not self.low:
            log.warning("commands are taken again", free_mb=free // MB)

    def failed(self, _: LedgerError) -> None:
        """Take note that the ledger takes nothing more."""
        self._failed = True
        ACCEPTING.set(0)

    async def watch(self) -> None:
        """Look every second until cancelled."""
        while True:
            await asyncio.to_thread(self.look)
            await asyncio.sleep(LOOK_S)

    def _measured(self, free: int) -> None:
        self._free_bytes = free
        self.low = free < self._reserve_bytes
        FREE.set(free)
        ACCEPTING.set(0 if self.low or self._failed else 1)

    def _words(self) -> str:
        return (
            f"{self._folder} has {self._free_bytes / MB:.1f} MB free, "
            f"{self._reserve_bytes / MB:g} MB must stay free (disk_reserve_mb)."
        )
