"""Real faults of disks without a real disk: a small one in memory, read-only ones, limits on files.

`unshare` gives a program mounts of its own, for root and, where the system lets them, for others.
"""

import os
import resource
import subprocess
from contextlib import suppress
from functools import cache
from pathlib import Path

import pytest

from fleetledger.disk_guard import free_bytes

FILLS_MAX = 100
ALONE = ("unshare", "--mount", "--map-root-user")


@cache
def _may_mount() -> bool:
    tried = subprocess.run(
        [*ALONE, "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True, check=False
    )
    return tried.returncode == 0


def _in_own_mounts(mount: str, folder: Path, command: list[str]) -> list[str]:
    if not _may_mount():
        pytest.skip("this system lets nobody mount in a namespace of its own (unshare)")
    return [*ALONE, "sh", "-c", f'{mount} && exec "$@"', "sh", str(folder), *command]


def on_small_disk(size_mb: int, folder: Path, command: list[str]) -> list[str]:
    """Run a program for which the folder is an empty disk of this size; see `seen_by`."""
    take = f'folder="$1"; shift; mount -t tmpfs -o size={size_mb}m none "$folder"'
    return _in_own_mounts(take, folder, command)


def read_only(folder: Path, command: list[str]) -> list[str]:
    """Run a program for which the folder is as it is, and cannot be changed."""
    bind = 'mount --bind "$folder" "$folder" && mount -o remount,bind,ro "$folder"'
    return _in_own_mounts(f'folder="$1"; shift; {bind}', folder, command)


def without_privileges(command: list[str]) -> list[str]:
    """Run a program for which rights on files count, though root started it."""
    return command if os.geteuid() != 0 else ["unshare", "--user", *command]


def seen_by(process: int, path: Path) -> Path:
    """Give the path under which a program's own mounts are seen from here."""
    return Path(f"/proc/{process}/root{path}")


def limit_files(process: int, size: int | None) -> None:
    """Let no file of a running program grow beyond a size; None lifts it."""
    _, hard = resource.prlimit(process, resource.RLIMIT_FSIZE)
    resource.prlimit(process, resource.RLIMIT_FSIZE, (hard if size is None else size, hard))


def fill(folder: Path, leave_bytes: int) -> Path:
    """Take all space of a folder's disk but so much; gives the file to remove.

    Others may write there meanwhile.
    """
    path = folder / "filler"
    with path.open("ab") as file:
        for _ in range(FILLS_MAX):
            size = free_bytes(folder) - leave_bytes
            if size <= 0:
                return path
            with suppress(OSError):  # somebody else has just taken of it
                os.posix_fallocate(file.fileno(), os.fstat(file.fileno()).st_size, size)
    raise AssertionError(f"{folder} does not get full")
