"""The few things that a ledger asks of a file system, so that tests can let each of them fail."""

import os
from pathlib import Path


class Disk:
    """The real one. Every method raises OSError as the system does."""

    def create(self, path: Path) -> int:
        """Create a file that must not exist yet, for appending."""
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)

    def reopen(self, path: Path) -> int:
        """Open an existing file for appending."""
        return os.open(path, os.O_WRONLY | os.O_APPEND)

    def write(self, fd: int, data: bytes | memoryview) -> int:
        """Append; may take fewer bytes than offered."""
        return os.write(fd, data)

    def sync(self, fd: int) -> None:
        """Return when what was written is on disk."""
        os.fdatasync(fd)

    def settle(self, path: Path) -> None:
        """Return when what a reader will see of a file is what the disk holds of it.

        After a failed sync the system goes on showing bytes that the disk never took, and the next
        sync succeeds without writing them (Rebello et al., "Can Applications Recover from fsync
        Failures?", 2020). So what is in memory is synced once more and then forgotten.
        """
        fd = os.open(path, os.O_RDWR)
        try:
            os.fsync(fd)
            os.posix_fadvise(fd, 0, 0, os.POSIX_FADV_DONTNEED)
        finally:
            os.close(fd)

    def truncate(self, fd: int, size: int) -> None:
        """Cut the file."""
        os.ftruncate(fd, size)

    def close(self, fd: int) -> None:
        """Close the file."""
        os.close(fd)

    def rename(self, source: Path, target: Path) -> None:
        """Rename, and return when the folder is on disk."""
        source.rename(target)
        self.sync_folder(target.parent)

    def remove(self, path: Path) -> None:
        """Take a name away; for good once the folder is synced."""
        path.unlink()

    def make_folder(self, folder: Path) -> None:
        """Make a folder where none is, and those above it; return when their names are on disk."""
        made = [f for f in (folder, *folder.parents) if not f.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        for new in reversed(made):
            self.sync_folder(new.parent)

    def sync_folder(self, folder: Path) -> None:
        """Return when the names in the folder are on disk."""
        fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


def write_all(disk: Disk, fd: int, data: bytes) -> None:
    """Write to the end, however little the system takes at once."""
    rest = memoryview(data)
    while rest:
        taken = disk.write(fd, rest)
        if taken <= 0:
            raise OSError(f"the disk took {taken} of {len(rest)} bytes")
        rest = rest[taken:]


def write_file(disk: Disk, path: Path, data: bytes) -> int:
    """Make a whole file appear under its name at once or not at all; gives its open descriptor.

    Raises FileExistsError rather than replace one.
    """
    if path.exists():
        raise FileExistsError(path)
    draft = path.with_name(path.name + DRAFT)
    fd = disk.create(draft)
    try:
        write_all(disk, fd, data)
        disk.sync(fd)
        disk.rename(draft, path)
    except BaseException:
        disk.close(fd)
        raise
    return fd


DRAFT = ".tmp"  # ending of files that are not whole yet; leftovers are removed at open
