"""Files of the data folder that only the server's own user may read: access and secrets."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ledger.errors import Refused, next_step

MODE = 0o600
BYTES_MAX = 16_000_000


class NotWritten(Refused):
    """The disk did not take a change, which therefore is not in force."""

    status = 503

    def __init__(self, path: Path, trouble: OSError) -> None:
        """Take the file, and what the system says."""
        words = f"{path} cannot be written: {trouble.strerror or trouble}. {next_step(trouble)}"
        super().__init__("errNotWritten", words.strip(), str(path))


def read_private(path: Path) -> bytes | None:
    """Read the file; None where there is none. Refuses one that is absurdly large."""
    try:
        fd = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return None
    with os.fdopen(fd, "rb") as file:
        if os.fstat(file.fileno()).st_size > BYTES_MAX:
            words = f"{path} has more than {BYTES_MAX} bytes: it is none of ours."
            raise Refused("errPrivateFile", words, str(path))
        return file.read()


def replace_private(path: Path, data: bytes) -> None:
    """Replace the file at once or not at all; on disk when this returns. Raises NotWritten.

    The draft is made anew each time: an old one, or a link in its place, is not written through.
    """
    try:
        _replace(path, data)
    except OSError as trouble:
        raise NotWritten(path, trouble) from trouble


def _replace(path: Path, data: bytes) -> None:
    draft = path.with_name(path.name + ".new")
    draft.unlink(missing_ok=True)
    fd = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, MODE)
    with os.fdopen(fd, "wb") as file:
        _give_to_owner_of(path.parent, fd)
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Keep other processes from changing the file meanwhile: server and command line both do.

    The lock is on a file beside it, since the file itself is replaced; waits for the other one,
    which holds it for one reading and one writing. Raises NotWritten.
    """
    lock = path.with_name(path.name + ".lock")
    try:
        fd = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, MODE)
    except OSError as trouble:
        raise NotWritten(path, trouble) from trouble
    try:
        _give_to_owner_of(path.parent, fd)
        fcntl.flock(fd, fcntl.LOCK_EX)
        yield
    finally:
        os.close(fd)


def _give_to_owner_of(folder: Path, fd: int) -> None:
    """Let root run the command line on the folder of a server that runs as somebody else."""
    if os.geteuid() == 0:
        owner = folder.stat()
        os.fchown(fd, owner.st_uid, owner.st_gid)
