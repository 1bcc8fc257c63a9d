from pathlib import Path

import pytest
from pydantic import ValidationError

from fleetledger.config import Auth, Settings


def test_flags_win_over_the_environment_and_that_over_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "config.toml").write_text("port = 1\nspeed = 2.0\nseed = 3\n")
    monkeypatch.setenv("FLEETLEDGER_PORT", "11")
    monkeypatch.setenv("FLEETLEDGER_SPEED", "12")

    settings = Settings.load(tmp_path, port=21, host=None)

    assert (settings.port, settings.speed, settings.seed) == (21, 12.0, 3)
    assert settings.host == "127.0.0.1"


def test_a_server_without_keys_stays_on_this_machine(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="only allowed on a loopback host"):
        Settings.load(tmp_path, auth=Auth.NONE, host="0.0.0.0")

    assert Settings.load(tmp_path, auth=Auth.NONE, host="::1").auth is Auth.NONE


def test_a_misspelt_key_in_the_file_is_not_ignored(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text("prot = 5800\n")

    with pytest.raises(ValidationError, match="prot"):
        Settings.load(tmp_path)
