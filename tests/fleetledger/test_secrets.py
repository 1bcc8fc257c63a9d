from pathlib import Path

import pytest

from fleetledger.secrets import FILE_NAME, NAME_CHARS_MAX, Secrets
from ledger.errors import Refused


def test_a_secret_is_there_after_a_restart_until_it_is_removed(tmp_path: Path) -> None:
    secrets = Secrets(tmp_path)
    secrets.put("gateway/S1/AMB-01", "long")
    secrets.put("callback/S1", "longer")
    secrets.put("gateway/S1/AMB-01", "changed")

    again = Secrets(tmp_path)
    assert again.get("gateway/S1/AMB-01") == "changed"
    again.remove("gateway/S1/AMB-01")
    again.remove("never there")

    last = Secrets(tmp_path)
    assert last.get("gateway/S1/AMB-01") is None
    assert last.get("callback/S1") == "longer"


def test_nobody_else_of_the_machine_may_read_the_file(tmp_path: Path) -> None:
    Secrets(tmp_path).put("name", "value")

    assert (tmp_path / FILE_NAME).stat().st_mode & 0o077 == 0


def test_a_leftover_draft_or_a_link_in_its_place_is_not_written_through(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.write_text("untouched")
    (tmp_path / f"{FILE_NAME}.new").symlink_to(other)

    Secrets(tmp_path).put("name", "value")

    assert other.read_text() == "untouched"
    assert Secrets(tmp_path).get("name") == "value"


@pytest.mark.parametrize("name", ["", "x" * (NAME_CHARS_MAX + 1), "\ud800"])
def test_what_cannot_be_kept_is_refused_and_changes_nothing(tmp_path: Path, name: str) -> None:
    secrets = Secrets(tmp_path)

    with pytest.raises(Refused):
        secrets.put(name, "value")

    assert not (tmp_path / FILE_NAME).exists()


def test_a_damaged_file_is_named_and_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text("{")

    with pytest.raises(Refused, match=FILE_NAME):
        Secrets(tmp_path)

    assert (tmp_path / FILE_NAME).read_text() == "{"
