from pathlib import Path

import pytest

from ledger.disk import DRAFT, Disk, write_file
from tests.ledger.disks import FailingDisk


class Noting(Disk):
    """Remembers which folders were synced."""

    def __init__(self) -> None:
        self.synced: list[Path] = []

    def sync_folder(self, folder: Path) -> None:
        super().sync_folder(folder)
        self.synced.append(folder)


def test_folders_are_made_with_those_above_them_and_their_names_kept(tmp_path: Path) -> None:
    disk = Noting()
    disk.make_folder(tmp_path / "a" / "b" / "c")
    assert disk.synced == [tmp_path, tmp_path / "a", tmp_path / "a" / "b"]
    disk.make_folder(tmp_path / "a" / "b" / "c")
    assert len(disk.synced) == 3
    assert (tmp_path / "a" / "b" / "c").is_dir()


def test_a_file_in_a_folder_s_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("")
    with pytest.raises(FileExistsError):
        Disk().make_folder(tmp_path / "a")


def test_what_is_on_disk_settles_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * 10_000)
    Disk().settle(path)
    assert path.read_bytes() == b"x" * 10_000
    with pytest.raises(FileNotFoundError):
        Disk().settle(tmp_path / "none")


@pytest.mark.parametrize("disk", [FailingDisk(write=0), FailingDisk(sync=0)])
def test_a_file_that_could_not_be_written_whole_has_no_name(
    tmp_path: Path, disk: FailingDisk
) -> None:
    path = tmp_path / "file"
    with pytest.raises(OSError, match=r"space|error"):
        write_file(disk, path, b"x" * 100)
    assert not path.exists()
    assert path.with_name(path.name + DRAFT).exists()  # for the next start to take away
    assert disk.calls_after == []
