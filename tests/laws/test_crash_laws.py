"""A crash loses nothing acknowledged, at any call of the disk (promise 2).

Tens of seeds in every run; the soak has thousands.
"""

from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.errors import LedgerDamaged
from tests.laws.crash.disk import Crashed, FaultyDisk, Inode, Trouble
from tests.laws.crash.simulation import simulate

SEEDS = 16
SEEDS_OF_A_STAGE = 20
LIARS_SEEDS = 12  # the first shows that nothing is kept, the fourth that memory is trusted


@pytest.mark.parametrize("seed", range(1, SEEDS + 1))
def test_what_was_acknowledged_survives(seed: int) -> None:
    simulate(seed)


def stage(seed: int) -> None:
    """For the soak: other seeds, and some longer lives."""
    for n in range(SEEDS_OF_A_STAGE):
        simulate(seed * SEEDS_OF_A_STAGE + n, *((600,) if n == 0 else ()))


def test_the_same_seed_lives_through_the_same_again() -> None:
    once, again, other = simulate(5, 60), simulate(5, 60), simulate(6, 60)
    assert once == again
    assert once.digest != other.digest


class SyncsNothing(FaultyDisk):
    """Says that it has synced."""

    def persist(self, inode: Inode) -> None:
        """Leave the pages where they are."""


class SyncsNoFolder(FaultyDisk):
    """Keeps files, but not always their names."""

    def persist_names(self, folder: Path) -> None:
        """Leave them as they are."""


class ForgetsNothing(FaultyDisk):
    """Goes on showing bytes that a failed sync has not brought to the platter."""

    def settle(self, path: Path) -> None:
        """Sync, and let memory be."""
        self.persist(self._names[path])


@pytest.mark.parametrize("liar", [SyncsNothing, SyncsNoFolder, ForgetsNothing])
def test_a_disk_that_lies_is_found_out(liar: Callable[[Path, Random], FaultyDisk]) -> None:
    """The simulation would see it if the ledger did not sync."""
    with pytest.raises((AssertionError, LedgerDamaged)) as caught:
        for seed in range(1, LIARS_SEEDS + 1):
            simulate(seed, kind=liar)
    assert "python -m tests.laws.crash --seed" in caught.value.__notes__[0]


CHANGES = st.lists(
    st.one_of(
        st.binary(min_size=1, max_size=9000),
        st.sampled_from(("sync", "cut", "fail")),
    ),
    max_size=12,
)


@given(changes=CHANGES, seed=st.integers(0, 999))
@settings(max_examples=200, deadline=None)
def test_a_power_cut_takes_only_what_was_not_synced(changes: list[bytes | str], seed: int) -> None:
    inode, rng, synced, trusted = Inode(), Random(seed), b"", True
    for change in changes:
        match change:
            case "sync":
                inode.sync()
                synced = bytes(inode.platter) if trusted else b""
            case "cut":
                inode.truncate(len(inode.seen) // 2)
                synced = synced[: len(inode.seen)]
            case "fail":
                inode.fail_to_sync(rng)
                synced, trusted = b"", False  # nobody may count on anything any more
            case bytes():
                inode.write(change)
    seen = bytes(inode.seen)
    inode.lose_power(rng)
    assert inode.seen == inode.platter
    assert bytes(inode.seen).startswith(synced)
    if "cut" not in changes:
        assert len(inode.seen) <= len(seen)


def test_every_call_may_be_the_last_one(tmp_path: Path) -> None:
    disk = FaultyDisk(tmp_path, Random(1))
    folder = tmp_path / "folder"
    folder.mkdir()
    for number in range(1, 5):
        trouble = Trouble(Random(number), soon=True)
        trouble.crash_at, trouble.fault_at = number, None
        disk.live(trouble)
        with pytest.raises(Crashed):
            for name in ("a", "b", "c", "d"):
                disk.close(disk.create(folder / f"{name}{number}"))
        with pytest.raises(Crashed):
            disk.sync_folder(folder)
        assert disk.calls == number * (number + 1) // 2
