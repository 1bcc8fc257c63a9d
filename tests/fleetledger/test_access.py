from pathlib import Path

from fleetledger.access import Keys


def test_the_first_start_makes_a_pair_that_works_and_only_its_hash_is_kept(tmp_path: Path) -> None:
    keys, key = Keys.open(tmp_path)

    assert key is not None
    assert keys.caller("fleetledger", key) == "fleetledger"
    assert key not in (tmp_path / "keys.json").read_text()
    assert (tmp_path / "keys.json").stat().st_mode & 0o077 == 0


def test_the_next_start_knows_the_pair_and_makes_no_other(tmp_path: Path) -> None:
    _, key = Keys.open(tmp_path)

    again, second = Keys.open(tmp_path)

    assert second is None
    assert key is not None
    assert again.caller("fleetledger", key) == "fleetledger"


def test_a_wrong_key_and_an_unknown_id_are_nobody(tmp_path: Path) -> None:
    keys, key = Keys.open(tmp_path)

    assert key is not None
    assert keys.caller("fleetledger", key + "x") is None
    assert keys.caller("somebody", key) is None
    assert keys.caller("somebody", "") is None
