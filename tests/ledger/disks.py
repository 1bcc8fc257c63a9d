"""Disks that fail as real ones do, over the real one."""

import errno
import os
import threading

from ledger.disk import Disk


class ShortDisk(Disk):
    """Takes at most a few bytes at once."""

    def write(self, fd: int, data: bytes | memoryview) -> int:
        return super().write(fd, memoryview(data)[:7])


class FailingDisk(Disk):
    """Fails from the nth write or sync on: writes leave half of their bytes, as a full disk does.

    What fails once does not fail again, so that anything that tried again would seem to succeed.
    """

    def __init__(self, write: int | None = None, sync: int | None = None) -> None:
        self.writes_left = write
        self.syncs_left = sync
        self.calls_after: list[str] = []
        self.failed = False

    def write(self, fd: int, data: bytes | memoryview) -> int:
        if self.failed:
            self.calls_after.append("write")
        if self.writes_left is not None and not self.failed:
            if self.writes_left == 0:
                self.failed = True
                super().write(fd, memoryview(data)[: len(data) // 2])
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self.writes_left -= 1
        return super().write(fd, data)

    def sync(self, fd: int) -> None:
        if self.failed:
            self.calls_after.append("sync")
        if self.syncs_left is not None and not self.failed:
            if self.syncs_left == 0:
                self.failed = True
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            self.syncs_left -= 1
        super().sync(fd)


class GatedDisk(Disk):
    """Syncs only while the gate is open, and counts."""

    def __init__(self) -> None:
        self.gate = threading.Event()
        self.waiting = threading.Event()
        self.syncs = 0
        self.sizes: list[int] = []

    def write(self, fd: int, data: bytes | memoryview) -> int:
        self.sizes.append(len(data))
        return super().write(fd, data)

    def sync(self, fd: int) -> None:
        self.syncs += 1
        self.waiting.set()
        self.gate.wait()
        super().sync(fd)
