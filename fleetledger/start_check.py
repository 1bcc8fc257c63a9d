"""Whether a data folder can be served: looked at before anything in it is changed."""

import errno
import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import duckdb
import structlog

from fleetledger.config import Settings
from ledger.disk import Disk
from ledger.errors import DiskTrouble, LedgerLost
from ledger.segment import SUFFIX
from ledger.snapshot import snapshot_paths
from ledger.store import FileLedger
from projections.archive import position_of

TOLD_S = 2.0  # between two lines about progress
PROBE_NAME = ".probe"
PROBE_BYTES = 4096
# a server that could not write these would find out only while it serves
WRITTEN = (
    "access.json",
    "clock",
    "history.duckdb",
    "ledger/lock",
    "outbox.sqlite",
    "secrets.json",
    "sessions.json",
)

log = structlog.get_logger()


@contextmanager
def usable(path: Path) -> Iterator[None]:
    """Name the file, or this path, and the next step where the system or a database says no."""
    try:
        yield
    except OSError as trouble:
        raise DiskTrouble(Path(trouble.filename or path), trouble) from trouble
    except (duckdb.Error, sqlite3.Error) as trouble:
        raise DiskTrouble(path, trouble) from trouble


def check_folder(settings: Settings) -> None:
    """Refuse a folder that cannot be served; raises DiskTrouble and LedgerLost."""
    data, ledger = settings.data, settings.ledger
    with usable(data):
        Disk().make_folder(data)
        _probe(data)
    if ledger.exists():
        with usable(ledger):
            _probe(ledger)
    _refuse_lost(settings)
    for name in WRITTEN:
        file = data / name
        if file.exists() and not os.access(file, os.R_OK | os.W_OK):
            raise DiskTrouble(file, PermissionError(errno.EACCES, os.strerror(errno.EACCES)))


def open_ledger(settings: Settings) -> FileLedger:
    """Check every byte of the ledger, mend a torn tail and open it; raises LedgerError.

    A log line tells how far it is whenever that takes another while.
    """
    told = time.monotonic()

    def progress(done: int, total: int) -> None:
        nonlocal told
        if time.monotonic() - told > TOLD_S:
            told = time.monotonic()
            log.info("checking the ledger", percent=100 * done // total, megabytes=total // 10**6)

    with usable(settings.ledger):
        return FileLedger.open(settings.ledger, snapshots=settings.snapshots, progress=progress)


def _probe(folder: Path) -> None:
    """Write a little: rights and the kind of a mount tell less than trying does."""
    if not os.access(folder, os.R_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
    probe = folder / PROBE_NAME
    try:
        fd = os.open(probe, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o600)
        try:
            os.write(fd, bytes(PROBE_BYTES))
            os.fsync(fd)
        finally:
            os.close(fd)
            probe.unlink(missing_ok=True)
    except OSError as trouble:
        raise OSError(trouble.errno, trouble.strerror, str(folder)) from trouble


def _refuse_lost(settings: Settings) -> None:
    """An empty ledger beside what was made from a full one is no new ledger."""
    if any(settings.ledger.glob(f"*{SUFFIX}")):
        return
    made = {path: int(path.stem) for path in snapshot_paths(settings.snapshots)[-1:]}
    history = settings.data / "history.duckdb"
    if history.exists():
        made[history] = position_of(history)
    known = {path: position for path, position in made.items() if position > 0}
    if known:
        names = " and ".join(str(path) for path in known)
        words = f"{settings.ledger} holds no events, but {names} came of {max(known.values())}."
        raise LedgerLost(words)
