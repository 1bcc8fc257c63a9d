"""Checks all that a ledger's folder holds: for `fleetledger verify DIR`, server on or off."""

import zlib
from collections.abc import Callable
from pathlib import Path

from ledger.errors import LedgerDamaged, LedgerNewer
from ledger.recovery import Measured, measure
from ledger.scan import Tally, events_between, later_chunk
from ledger.scene import Value
from ledger.segment import (
    BEGINNING,
    NO_HASH,
    SUFFIX,
    TRAILER_BYTES,
    Trailer,
    first_position,
    read_trailer,
)
from ledger.snapshot import Unusable, check, snapshot_paths

RESTORE = "Stop the server and restore this file from a backup."
DELETE = "Stop the server and delete this file: snapshots are a cache."

Progress = Callable[[int, int], None]  # bytes checked, bytes in all


class Finding(Value, frozen=True, kw_only=True):
    """Something that is not as it was written."""

    path: Path
    offset: int
    position: int | None
    what: str
    advice: str
    damage: bool = True  # False = worth knowing, nothing is lost


class Verdict(Value, frozen=True, kw_only=True):
    """What was counted and found."""

    segments: int
    chunks: int
    events: int
    snapshots: int
    position: int  # of the newest event
    findings: tuple[Finding, ...]

    @property
    def sound(self) -> bool:
        """Nothing is damaged."""
        return not any(finding.damage for finding in self.findings)


class _Check:
    """What has been found so far in one run."""

    def __init__(self) -> None:
        self.findings: list[Finding] = []
        self.chunks = 0
        self.events = 0
        self.position = 0
        self.sha256 = NO_HASH
        self.last_ns = 0  # log time of the newest event

    def find(
        self, path: Path, offset: int, position: int | None, what: str, advice: str = RESTORE
    ) -> None:
        self.findings.append(
            Finding(path=path, offset=offset, position=position, what=what, advice=advice)
        )

    def segment(self, path: Path, newest: bool) -> None:
        """Check one file against the one before it."""
        data = path.read_bytes()
        first = first_position(path)
        if first != self.position + 1:
            what = f"position {self.position + 1} is missing before it"
            self.find(path, 0, self.position + 1, what)
        found = read_trailer(data[-TRAILER_BYTES:])
        end = len(data) if found is None else len(data) - TRAILER_BYTES
        predecessor = self.sha256 if found is None else found[0].predecessor
        measured = measure(data, end, predecessor)
        self.chunks += measured.chunks
        last = first + measured.tally.sequence - 1
        if measured.flaw is not None and (
            found is not None
            or not newest
            or measured.flaw.offset == 0
            or later_chunk(data, measured.end, len(data)) is not None
        ):
            self.find(path, measured.flaw.offset, last + 1, measured.flaw.what)
        elif found is None and not newest:
            self.find(path, len(data), last, "it has no trailer, but a successor")
        elif found is None and measured.flaw is not None:
            self._torn(path, measured, last)
        elif found is not None:
            self._trailer(path, data, end, found, measured, first)
        self._meaning(path, data, measured)
        self.last_ns = max(self.last_ns, measured.tally.last_ns)
        self.position = found[0].last if found is not None else last
        self.sha256 = found[0].sha256 if found is not None else measured.sha256

    def _torn(self, path: Path, measured: Measured, last: int) -> None:
        what = "a commit was torn or is being written; it was never acknowledged"
        advice = "Nothing to do: the next start keeps the tail aside and cuts it."
        finding = Finding(
            path=path,
            offset=measured.end,
            position=last + 1,
            what=what,
            advice=advice,
            damage=False,
        )
        self.findings.append(finding)

    def _trailer(
        self,
        path: Path,
        data: bytes,
        end: int,
        found: tuple[Trailer, int],
        measured: Measured,
        first: int,
    ) -> None:
        trailer, crc = found
        last = first + measured.tally.sequence - 1
        if (trailer.first, trailer.last, trailer.sha256) != (first, last, measured.sha256):
            self.find(path, end, last, "its trailer does not fit its content")
        if trailer.predecessor != self.sha256:
            what = "it does not follow the segment before it: the hashes differ"
            self.find(path, end, first, what)
        if zlib.crc32(memoryview(data)[: end + len(trailer.record())]) != crc:
            self.find(path, end, last, "the CRC of its data section is wrong")

    def _meaning(self, path: Path, data: bytes, measured: Measured) -> None:
        """Decode every event that can be reached."""
        tally = Tally(last_ns=self.last_ns)  # log times go on from segment to segment
        start = len(BEGINNING)
        try:
            for events in events_between(path, data, start, measured.end, tally):
                self.events += len(events)
        except LedgerDamaged as error:
            self.find(path, error.offset, error.position, error.what)
        except LedgerNewer as error:
            self.find(path, 0, None, str(error), error.hint)

    def snapshot(self, path: Path) -> None:
        """Check a snapshot's checksum, and that the ledger reaches so far."""
        try:
            head, _ = check(path.read_bytes())
        except Unusable as error:
            self.find(path, 0, int(path.stem), str(error), DELETE)
            return
        if head.position > self.position:
            what = f"the ledger ends at position {self.position}, but here is the state after it"
            self.find(path, 0, head.position, what, "Restore the newest segments from a backup.")


def verify(directory: Path, progress: Progress = lambda done, total: None) -> Verdict:
    """Check a data folder: segments in `ledger/`, snapshots in `snapshots/`. Changes nothing.

    Raises FileNotFoundError where there is no ledger. A server may be running: what it writes
    meanwhile may show as a tail, which is no damage.
    """
    ledger_dir, snapshots_dir = directory / "ledger", directory / "snapshots"
    if not ledger_dir.is_dir():
        raise FileNotFoundError(f"{directory} holds no ledger folder")
    checked = _Check()
    paths: list[Path] = []
    for path in sorted(ledger_dir.glob(f"*{SUFFIX}")):
        try:
            first_position(path)
            paths.append(path)
        except LedgerDamaged as error:
            checked.find(path, 0, None, error.what, "Give it back the name it had.")
    snapshots = snapshot_paths(snapshots_dir)
    total = sum(path.stat().st_size for path in (*paths, *snapshots))
    done = 0
    for path in paths:
        checked.segment(path, newest=path is paths[-1])
        done += path.stat().st_size
        progress(min(done, total), total)
    for path in snapshots:
        checked.snapshot(path)
        done += path.stat().st_size
        progress(min(done, total), total)
    return Verdict(
        segments=len(paths),
        chunks=checked.chunks,
        events=checked.events,
        snapshots=len(snapshots),
        position=checked.position,
        findings=tuple(checked.findings),
    )
