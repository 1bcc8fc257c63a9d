"""Ledgers on disk for tests: written commit by commit, so that chunk borders are known."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ledger.events import AnyEvent
from ledger.store import FileLedger


def commit_each(ledger: FileLedger, commits: Sequence[Sequence[AnyEvent]]) -> None:
    """Append each list as one command and wait for it, so that each becomes a chunk of its own."""
    for events in commits:
        assert ledger.wait(ledger.append(events, ledger.position), 30)


def in_threes(events: Sequence[AnyEvent]) -> list[Sequence[AnyEvent]]:
    """Cut a history into commands of three events."""
    return [events[n : n + 3] for n in range(0, len(events), 3)]


def written(directory: Path, commits: Sequence[Sequence[AnyEvent]], **options: Any) -> Path:
    """A cleanly closed ledger; gives its newest segment."""
    ledger = FileLedger.open(directory, **options)
    commit_each(ledger, commits)
    ledger.close()
    return max(directory.glob("*.mcap"))


def killed(directory: Path, commits: Sequence[Sequence[AnyEvent]]) -> tuple[bytes, list[int]]:
    """What a ledger's one segment looks like after kill -9: its bytes, and where chunks end."""
    ledger = FileLedger.open(directory)
    ends = []
    (path,) = [directory / "00000000000000000001.mcap"]
    for events in commits:
        commit_each(ledger, [events])
        ends.append(path.stat().st_size)
    raw = path.read_bytes()
    ledger.close()
    return raw, ends
