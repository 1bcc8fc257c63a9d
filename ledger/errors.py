"""What can go wrong with the ledger.

LedgerError
├── Conflict         somebody else appended first
├── Unknown          an append may or may not be on disk
├── LedgerBusy       more events wait for the disk than allowed
├── LedgerDamaged    bytes on disk are not what was written
├── LedgerLocked     another process has the ledger open
└── LedgerNewer      written by a newer program
"""

from pathlib import Path


class LedgerError(Exception):
    """Base; `hint` tells the operator what to do next."""

    hint = "See docs/operations.md."


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


class LedgerBusy(LedgerError):
    """The disk is so slow that the queue before it is full: nothing was appended, try later."""

    hint = "Look at the disk: it syncs more slowly than events come in."


class LedgerDamaged(LedgerError):
    """A segment holds something else than what was written."""

    hint = "Run `fleetledger verify DIR`, and restore the named file from a backup."

    def __init__(self, path: Path, offset: int, what: str, position: int | None = None) -> None:
        """Take the file, the byte offset, what is wrong there, and the position if known."""
        where = f"{path}, byte {offset}"
        if position is not None:
            where += f", position {position}"
        super().__init__(f"{where}: {what}")
        self.path = path
        self.offset = offset
        self.what = what
        self.position = position


class LedgerLocked(LedgerError):
    """Two servers on one folder would write two histories."""

    hint = "Stop the other server first; it holds the lock on the data folder."


class LedgerNewer(LedgerError):
    """The ledger has event types or shapes that this program does not know."""

    hint = "Start a version of fleetledger at least as new as the one that wrote it."


class Refused(Exception):
    """The expected no to a request: a stable code, words that name the field, and arguments.

    Outside the tree above, for nothing is wrong with the ledger: dialects answer it with HTTP
    `status` and `{code, message, args}` (spec/m4.md, ErrorBody).
    """

    status = 400

    def __init__(self, code: str, message: str, *args: object) -> None:
        """Take the code that programs read, the sentence that people read, and its arguments."""
        super().__init__(message)
        self.code = code
        self.message = message
        self.arguments = args
