"""A disk as bad as a real one may be: takes little, runs full, fails, and forgets what it did not
sync.

Real files in a temporary folder show what the system would show: everything written, synced or not.
Beside them stands what the platter holds. A power cut leaves of each file the platter and any part
of the unsynced pages, in any order, the last one perhaps torn; and of each folder any part of the
names that were made, changed or taken away since it was synced. What was synced is safe: a byte
that never changes survives the rewriting of its page.
"""

import errno
import os
import shutil
from collections import Counter
from pathlib import Path
from random import Random

from ledger.disk import Disk

PAGE = 4096
SECTOR = 512


class Crashed(BaseException):
    """The process or the machine has died; no code but the simulation's may catch it."""


class Inode:
    """A file whatever its name: what is seen, what the platter has, and what is on its way."""

    def __init__(self) -> None:
        self.seen = bytearray()
        self.platter = bytearray()
        self.dirty: set[int] = set()  # pages that the next sync writes
        self.cut: int | None = None  # shortest it has been since the last sync, if it was cut
        self.failed = False  # a write or a sync was refused: its owner must leave it alone

    def write(self, data: bytes | memoryview) -> None:
        start = len(self.seen)
        self.seen += data
        self.dirty.update(range(start // PAGE, (len(self.seen) - 1) // PAGE + 1))

    def truncate(self, size: int) -> None:
        del self.seen[size:]
        self.cut = size if self.cut is None else min(self.cut, size)
        self.dirty = {page for page in self.dirty if page * PAGE < size}
        if size % PAGE:
            self.dirty.add(size // PAGE)

    def sync(self) -> None:
        """Bring the dirty pages to the platter; what an earlier failure left behind stays there."""
        self._take(self.dirty, len(self.seen))
        self.dirty, self.cut = set(), None

    def fail_to_sync(self, rng: Random) -> None:
        """Some pages make it, all count as clean from now on (fsync(2) on Linux)."""
        if rng.random() < 0.5:
            some = {page for page in self.dirty if rng.random() < 0.5}
            self._take(some, len(self.seen) if rng.random() < 0.5 else None)
        self.dirty, self.cut, self.failed = set(), None, True

    def settle(self) -> None:
        """Let memory forget what the platter does not have."""
        self.sync()
        self.seen = bytearray(self.platter)

    def lose_power(self, rng: Random) -> None:
        """Leave one of the contents that the platter may have."""
        if self.cut is not None and rng.random() < 0.7:
            del self.platter[self.cut :]
            self.cut = None
        if self.cut is None:
            self._survive(rng)
        self.seen = bytearray(self.platter)
        self.dirty, self.cut, self.failed = set(), None, False

    def _survive(self, rng: Random) -> None:
        """Bring some of the dirty pages to the platter."""
        dirty, fate = sorted(self.dirty), rng.random()
        if fate < 0.2:
            return
        if fate < 0.4:
            pages = dirty
        elif fate < 0.7:  # in order, as far as it got
            pages = dirty[: rng.randrange(len(dirty) + 1)]
        else:  # in any order
            pages = [page for page in dirty if rng.random() < 0.6]
        torn = pages.pop() if pages and rng.random() < 0.4 else None
        self._take(pages, len(self.seen) if dirty and rng.random() < 0.3 else None)
        if torn is not None:
            self._tear(torn, rng)

    def _take(self, pages: set[int] | list[int], size: int | None) -> None:
        """Write pages; the file ends at `size`, or where the last written page does."""
        for page in sorted(pages):
            self._put(page * PAGE, min((page + 1) * PAGE, len(self.seen)))
        if size is not None:
            del self.platter[size:]
            self.platter += bytes(size - len(self.platter))

    def _put(self, start: int, end: int) -> None:
        self.platter += bytes(max(0, start - len(self.platter)))
        self.platter[start:end] = self.seen[start:end]

    def _tear(self, page: int, rng: Random) -> None:
        """Some sectors of the page are new; one of them may hold what nobody ever wrote."""
        start, end = page * PAGE, min((page + 1) * PAGE, len(self.seen))
        old = len(self.platter)
        for sector in range(start, end, SECTOR):
            if rng.random() < 0.5:
                self._put(sector, min(sector + SECTOR, end))
        if len(self.platter) > max(old, start) and rng.random() < 0.3:
            at = rng.randrange(max(old, start), len(self.platter))
            until = min(at + SECTOR - at % SECTOR, len(self.platter))
            self.platter[at:until] = rng.randbytes(until - at)


class Trouble:
    """What is going to happen, and at which call: chosen anew for each life of the core."""

    def __init__(self, rng: Random, *, soon: bool) -> None:
        calls = 12 if soon else rng.choice((60, 250))
        self.crash_at = rng.randrange(1, calls) if rng.random() < 0.8 else None
        self.crash_after = rng.random() < 0.5  # the call has done its work
        self.power = rng.random() < 0.7  # or else only the process dies
        self.short = rng.choice((0.0, 0.0, 0.3))
        self.fault_at = rng.randrange(1, calls) if rng.random() < 0.35 else None
        self.faults = rng.choice((1, 1, 1, 5))  # so many calls fail from there on


class FaultyDisk(Disk):
    """Counts calls, strikes at the chosen ones, and can lose its power."""

    def __init__(self, root: Path, rng: Random) -> None:
        self.root = root
        self.calls = 0
        self.trouble: Trouble | None = None
        self.faults: list[str] = []  # what has been refused, in words
        self.broken_rules: list[str] = []  # what a ledger must never do
        self.fates: Counter[str] = Counter()
        self.dead = False
        self._rng = rng
        self._fds: dict[int, Inode] = {}
        self._names: dict[Path, Inode] = {}
        self._kept: dict[Path, Inode] = {}  # names that the platter has
        self._pending: list[tuple[Path | None, Path | None, Inode]] = []  # from, to
        self._life = 0  # calls before this life

    # what a ledger calls

    def create(self, path: Path) -> int:
        with self._call("create", full=True):
            fd = super().create(path)
            inode = self._fds[fd] = self._names[path] = Inode()
            self._pending.append((None, path, inode))
        return fd

    def reopen(self, path: Path) -> int:
        with self._call("open"):
            fd = super().reopen(path)
            self._fds[fd] = self._names[path]
        return fd

    def write(self, fd: int, data: bytes | memoryview) -> int:
        inode, taken = self._leave_alone(fd, "write"), len(data)
        if self.trouble is not None and self._rng.random() < self.trouble.short:
            taken = self._rng.randrange(1, taken + 1)
        call = self._call("write", full=True)
        if call.strikes:
            taken = self._rng.randrange(taken + 1)
            inode.failed = True
        if call.dies and not call.done:  # in the middle of it
            taken = self._rng.randrange(taken + 1)
        if taken:
            os.write(fd, data[:taken])
            inode.write(data[:taken])
        with call:
            return taken

    def sync(self, fd: int) -> None:
        inode, call = self._leave_alone(fd, "sync"), self._call("sync")
        if call.strikes:
            inode.fail_to_sync(self._rng)
        with call:
            self.persist(inode)

    def persist(self, inode: Inode) -> None:
        """Keep the promise of a sync; a disk that lies does not."""
        inode.sync()

    def settle(self, path: Path) -> None:
        inode, call = self._names[path], self._call("settle")
        if call.strikes:
            inode.fail_to_sync(self._rng)
        with call:
            inode.settle()
            path.write_bytes(inode.seen)

    def truncate(self, fd: int, size: int) -> None:
        inode = self._leave_alone(fd, "truncate")
        with self._call("truncate"):
            super().truncate(fd, size)
            inode.truncate(size)

    def close(self, fd: int) -> None:
        if not self.dead:
            del self._fds[fd]
            super().close(fd)

    def rename(self, source: Path, target: Path) -> None:
        with self._call("rename"):
            source.rename(target)
            inode = self._names[target] = self._names.pop(source)
            self._pending.append((source, target, inode))
        self.sync_folder(target.parent)

    def remove(self, path: Path) -> None:
        with self._call("remove"):
            super().remove(path)
            self._pending.append((path, None, self._names.pop(path)))

    def sync_folder(self, folder: Path) -> None:
        with self._call("sync of a folder"):
            self.persist_names(folder)

    def persist_names(self, folder: Path) -> None:
        """Keep the promise of a folder's sync."""
        waiting, self._pending = self._pending, []
        for change in waiting:
            if folder in {path.parent for path in change[:2] if path is not None}:
                self._rename_on_platter(*change)
            else:
                self._pending.append(change)

    # what the simulation calls

    def live(self, trouble: Trouble | None) -> None:
        """Begin a life of the core; without trouble nothing happens to it."""
        self.trouble, self._life, self.dead = trouble, self.calls, False
        for inode in self._names.values():
            inode.failed = False  # another process may write to it, having settled it

    def die(self) -> None:
        """Let the process die now: its files are closed, and the machine goes on."""
        if not self.dead:
            self.fates["process died"] += 1
        self.dead = True
        for fd in self._fds:
            os.close(fd)
        self._fds.clear()

    def lose_power(self) -> None:
        """Let the machine die too, and leave what a platter may hold then."""
        self.die()
        self.fates["power cut"] += 1
        if self._rng.random() < 0.5:
            survived = self._pending[: self._rng.randrange(len(self._pending) + 1)]
        else:
            survived = [change for change in self._pending if self._rng.random() < 0.5]
        for change in survived:
            self._rename_on_platter(*change)
        self._pending.clear()
        folders = {path.parent for path in (*self._names, *self._kept)}
        for folder in folders:
            shutil.rmtree(folder)
            folder.mkdir()
        self._names = dict(self._kept)
        for path, inode in self._names.items():
            inode.lose_power(self._rng)
            path.write_bytes(inode.seen)

    def _rename_on_platter(self, source: Path | None, target: Path | None, inode: Inode) -> None:
        if source is not None:
            self._kept.pop(source, None)
        if target is not None:
            self._kept[target] = inode

    def _leave_alone(self, fd: int, what: str) -> Inode:
        if self.dead:
            raise Crashed
        inode = self._fds[fd]
        if inode.failed:
            self.broken_rules.append(f"{what} on a file that had failed, call {self.calls}")
        return inode

    def _call(self, what: str, *, full: bool = False) -> "_Call":
        if self.dead:
            raise Crashed
        self.calls += 1
        return _Call(self, what, full, self.calls - self._life, self._rng)


class _Call:
    """One call: what happens to it is known before, and happens around its work."""

    def __init__(self, disk: FaultyDisk, what: str, full: bool, number: int, rng: Random) -> None:
        trouble = disk.trouble
        at = trouble.fault_at if trouble is not None else None
        self._disk, self._what, self._full = disk, what, full
        self.strikes = trouble is not None and at is not None and at <= number < at + trouble.faults
        self.dies = trouble is not None and number == trouble.crash_at
        self.done = trouble is not None and trouble.crash_after
        self._code = errno.ENOSPC if full and rng.random() < 0.5 else errno.EIO

    def __enter__(self) -> None:
        if self.dies and not self.done:
            self._die()
        if self.strikes:
            self._disk.faults.append(f"{self._what}: {os.strerror(self._code)}")
            self._disk.fates[f"failed {self._what}"] += 1
            raise OSError(self._code, os.strerror(self._code))

    def __exit__(self, *failed: object) -> None:
        if self.dies and self.done:
            self._die()

    def _die(self) -> None:
        assert self._disk.trouble is not None
        if self._disk.trouble.power:
            self._disk.lose_power()
        else:
            self._disk.die()
        raise Crashed
