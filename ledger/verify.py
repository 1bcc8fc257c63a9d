"""Checks all that a ledger's folder holds: for `fleetledger verify DIR`, server on or off."""

from pathlib import Path

from ledger.damage import Finding, Inspection, Progress, unseen
from ledger.scene import Value
from ledger.snapshot import snapshot_paths

__all__ = ["Finding", "Verdict", "verify"]


class Verdict(Value, frozen=True, kw_only=True):
    """What was counted and found."""

    segments: int
    sealed: int  # of them
    chunks: int
    events: int
    snapshots: int
    position: int  # of the newest event
    findings: tuple[Finding, ...]

    @property
    def sound(self) -> bool:
        """Nothing is damaged."""
        return not any(finding.damage for finding in self.findings)


def verify(directory: Path, progress: Progress = unseen) -> Verdict:
    """Check a data folder: segments in `ledger/`, snapshots in `snapshots/`. Changes nothing.

    Every CRC, hash and position is computed anew and every event decoded; what a start of the
    server checks is part of it. Raises FileNotFoundError where there is no ledger. A server may be
    running: what it writes meanwhile may show as a tail, which is no damage.
    """
    ledger_dir, snapshots_dir = directory / "ledger", directory / "snapshots"
    if not ledger_dir.is_dir():
        raise FileNotFoundError(f"{directory} holds no ledger folder")
    checked = Inspection(thorough=True)
    snapshots = snapshot_paths(snapshots_dir)
    more = sum(path.stat().st_size for path in snapshots)
    done = checked.folder(ledger_dir, progress, more)
    checked.snapshots(snapshots_dir)
    progress(done + more, done + more)
    return Verdict(
        segments=checked.segments,
        sealed=checked.sealed,
        chunks=checked.chunks,
        events=checked.events,
        snapshots=len(snapshots),
        position=checked.position,
        findings=tuple(checked.findings),
    )
