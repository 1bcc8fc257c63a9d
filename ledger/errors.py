"""What can go wrong with the ledger.

LedgerError
├── Conflict         somebody else appended first
├── DiskFull         too little room is left to go on
├── DiskTrouble      a file or folder cannot be used as the server must
├── Unknown          an append may or may not be on disk
├── LedgerBusy       more events wait for the disk than allowed
├── LedgerDamaged    bytes on disk are not what was written
├── LedgerDiverged   what was followed is not the core's history
├── LedgerLocked     another process has the ledger open
├── LedgerLost       there was a ledger, and it is gone
├── LedgerNewer      written by a newer program
└── NotSealed        a segment could not be packed, and stays as it is
"""

import errno
from pathlib import Path


class LedgerError(Exception):
    """Base; `hint` tells the operator what to do next, `code` is what HTTP answers with its 503."""

    hint = "See docs/operations.md."
    code = "errLedgerUnavailable"


class Conflict(LedgerError):
    """The append expected another newest position: decide again on the newest state."""

    def __init__(self, expected: int, actual: int) -> None:
        """Take the position the writer expected and the one that is."""
        super().__init__(f"expected position {expected}, the ledger is at {actual}")
        self.expected = expected
        self.actual = actual


class Unknown(LedgerError):
    """A write or sync failed: nobody knows whether the last events are on disk."""

    hint = "Free disk space or mend the disk, then start again: recovery keeps what is whole."


_ROOM = "Free space on that disk, or move the data folder to a larger one, then start again."
_RIGHTS = "Give the user that the server runs as the right to read and write it, then start again."
_NEXT_STEP = {
    errno.ENOSPC: _ROOM,
    errno.EDQUOT: "Free space, or raise the quota of the server's user, then start again.",
    errno.EFBIG: "Raise the limit on the size of files (ulimit -f), then start again.",
    errno.EROFS: "Make the disk writable: it is mounted read-only, by a system often after a fault "
    "of the disk, so look into the system's log first. Then start again.",
    errno.EACCES: _RIGHTS,
    errno.EPERM: _RIGHTS,
    errno.EIO: "The disk is failing: copy the data folder to another one while it can be read, run "
    "`fleetledger verify` on the copy, and start from there.",
    errno.EEXIST: "A file stands where a folder must be: name another folder, or move the file.",
    errno.ENOTDIR: "A file stands where a folder must be: name another folder, or move the file.",
    errno.EMFILE: "Raise the limit on open files (ulimit -n), then start again.",
    errno.ENFILE: "The system has no more open files to give: end what holds them, then try again.",
    errno.ESTALE: "The network share is gone: mount it again, then start again.",
}


def next_step(trouble: BaseException | None) -> str:
    """Tell what an operator can do about an error of the system; "" where nobody knows."""
    number = trouble.errno if isinstance(trouble, OSError) else None
    return _NEXT_STEP.get(number, "") if number is not None else ""


class DiskTrouble(LedgerError):
    """A file or folder of the data folder cannot be used as the server must."""

    def __init__(self, path: Path, trouble: Exception) -> None:
        """Take what cannot be used, and what the system says."""
        words = trouble.strerror if isinstance(trouble, OSError) else None
        super().__init__(f"{path} cannot be used: {words or trouble}.")
        self.hint = next_step(trouble) or LedgerError.hint


class DiskFull(LedgerError):
    """So little room is left that going on would end in a failed write: nothing was appended."""

    hint = "Free space on that disk; the server takes commands again by itself once there is room."
    code = "errDiskFull"


class LedgerBusy(LedgerError):
    """The disk is so slow that the queue before it is full: nothing was appended, try later."""

    hint = "Look at the disk: it syncs more slowly than events come in."


class LedgerDamaged(LedgerError):
    """A segment holds something else than what was written."""

    hint = "Run `fleetledger verify DIR`, and restore the named file from a backup."

    def __init__(
        self,
        path: Path,
        offset: int,
        what: str,
        position: int | None = None,
        hint: str | None = None,
    ) -> None:
        """Take the file, the byte offset, what is wrong there, the position and advice if known."""
        where = f"{path}, byte {offset}"
        if position is not None:
            where += f", position {position}"
        super().__init__(f"{where}: {what}")
        self.hint = hint or type(self).hint
        self.path = path
        self.offset = offset
        self.what = what
        self.position = position


class LedgerDiverged(LedgerError):
    """The core's history is not the one that a follower has: a backup, or another ledger."""

    hint = (
        "The core's ledger was restored from a backup, or is another one: what was followed after "
        "that is void. Begin anew from its state, or from position 0."
    )

    def __init__(self, ours: int, theirs: int) -> None:
        """Take the newest position that the follower has, and where the core is for it."""
        what = "has another event there" if ours == theirs else f"ends at {theirs}"
        super().__init__(f"followed up to position {ours}, but the core {what}")
        self.position = ours


class LedgerLocked(LedgerError):
    """Two servers on one folder would write two histories."""

    hint = "Stop the other server first; it holds the lock on the data folder."


class LedgerLost(LedgerError):
    """What is made from the ledger is there, the ledger is not: to begin anew would hide a loss."""

    hint = (
        "Restore the ledger from a backup, or mount the disk that it is on. Only to begin an empty "
        "one on purpose: move the files named here out of the data folder first."
    )


class LedgerNewer(LedgerError):
    """The ledger has event types or shapes that this program does not know."""

    hint = "Start a version of fleetledger at least as new as the one that wrote it."


class NotSealed(LedgerError):
    """The packed draft of a segment does not hold what the segment does: it is thrown away."""

    hint = "Nothing is lost. If it happens again, look at the memory and the disk of this machine."

    def __init__(self, draft: Path, offset: int, what: str) -> None:
        """Take the draft, the byte offset, and what is wrong there."""
        super().__init__(f"{draft}, byte {offset}: {what}")


class Refused(Exception):
    """The expected no to a request: a stable code, words that name the field, and arguments.

    Outside the tree above, for nothing is wrong with the ledger: dialects answer it with HTTP
    `status` and `{code, message, args}` (spec/m4.md, ErrorBody).
    """

    status = 400
    wait_s: int | None = None  # after which it may be asked again

    def __init__(self, code: str, message: str, *args: object) -> None:
        """Take the code that programs read, the sentence that people read, and its arguments."""
        super().__init__(message)
        self.code = code
        self.message = message
        self.arguments = args
