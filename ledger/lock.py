"""One server to a ledger: a lock that the kernel releases when its holder dies, however it dies."""

import fcntl
import os
from contextlib import suppress
from pathlib import Path

from ledger.errors import LedgerLocked

LOCK_NAME = "lock"


class Lock:
    """Holds the folder until closed. The file stays; only the lock on it counts."""

    def __init__(self, folder: Path, name: str = LOCK_NAME) -> None:
        """Take the lock, or raise LedgerLocked at once if somebody has it."""
        path = folder / name
        fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(fd, 32, 0).decode(errors="replace").strip()
            os.close(fd)
            raise LedgerLocked(f"{folder} is in use by process {holder or 'unknown'}") from None
        with suppress(OSError):  # for people; the lock does not need it, and the disk may be full
            os.ftruncate(fd, 0)
            os.pwrite(fd, f"{os.getpid()}\n".encode(), 0)
        self._fd: int | None = fd

    def close(self) -> None:
        """Let go; a second time does nothing."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None
