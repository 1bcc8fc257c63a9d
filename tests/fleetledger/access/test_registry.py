from pathlib import Path

import pytest

from fleetledger.access.file import FILE_NAME, AccessFile, digest_of
from fleetledger.access.registry import (
    Change,
    Registry,
    key_added,
    key_removed,
    key_rotated,
    user_added,
    user_changed,
    user_removed,
)
from ledger.errors import Refused
from ledger.events import Event, KeyAdded, KeyRemoved, Role, UserAdded, UserChanged, UserRemoved

ADMIN = user_added("anna", Role.ADMIN, "hash", "s1")


def made(*changes: Change) -> Registry:
    registry = Registry()
    for change in changes:
        registry, _ = change(registry)
    return registry


def event_of(registry: Registry, change: Change) -> Event | None:
    return change(registry)[1]


def test_every_change_gives_the_event_that_says_it() -> None:
    registry = made(ADMIN, key_added("wms", Role.OPERATOR, "d1"))

    said = [
        event_of(Registry(), ADMIN),
        event_of(registry, user_changed("anna", password="other", stamp="s2")),
        event_of(registry, user_added("bob", Role.VIEWER, "hash", "s")),
        event_of(registry, key_rotated("wms", "d2", 5)),
        event_of(registry, key_removed("wms")),
    ]

    assert [type(event) for event in said] == [
        UserAdded,
        UserChanged,
        UserAdded,
        KeyAdded,
        KeyRemoved,
    ]
    assert "hash" not in repr(said)
    assert "other" not in repr(said)


def test_what_is_as_asked_already_is_no_change() -> None:
    registry = made(ADMIN)

    after, event = user_changed("anna", role=Role.ADMIN, disabled=False, stamp="s2")(registry)

    assert (after, event) == (registry, None)


@pytest.mark.parametrize(
    ("change", "stamp"),
    [
        (user_changed("bob", role=Role.OPERATOR, stamp="s2"), "s1"),
        (user_changed("bob", password="other", stamp="s2"), "s2"),
        (user_changed("bob", disabled=True, stamp="s2"), "s2"),
    ],
)
def test_sessions_end_with_the_password_and_by_being_disabled(change: Change, stamp: str) -> None:
    registry, _ = change(made(ADMIN, user_added("bob", Role.VIEWER, "hash", "s1")))

    assert registry.users["bob"].stamp == stamp


@pytest.mark.parametrize(
    "change",
    [
        user_removed("anna"),
        user_changed("anna", role=Role.OPERATOR, stamp="s"),
        user_changed("anna", disabled=True, stamp="s"),
    ],
)
def test_the_last_admin_stays(change: Change) -> None:
    with pytest.raises(Refused, match="admin") as refused:
        change(made(ADMIN, key_added("wms", Role.OPERATOR, "d")))
    assert refused.value.code == "errLastAdmin"

    after, event = change(made(ADMIN, key_added("wms", Role.ADMIN, "d")))
    assert isinstance(event, UserRemoved | UserChanged)
    assert after.keys


@pytest.mark.parametrize("name", ["", "a b", "ä", ".a", "a;b", "a/b", "x" * 101, "scheduler"])
def test_names_fit_into_cookies_and_are_nobody_elses(name: str) -> None:
    for change in (user_added(name, Role.VIEWER, "h", "s"), key_added(name, Role.VIEWER, "d")):
        with pytest.raises(Refused):
            change(Registry())


def test_one_name_is_one_caller() -> None:
    registry = made(ADMIN, key_added("wms", Role.OPERATOR, "d"))

    for change in (key_added("anna", Role.VIEWER, "d"), user_added("wms", Role.VIEWER, "h", "s")):
        with pytest.raises(Refused, match="already"):
            change(registry)


def test_only_the_key_before_the_last_rotation_stays_good() -> None:
    registry = made(
        key_added("wms", Role.OPERATOR, "d1"),
        key_rotated("wms", "d2", 5),
        key_rotated("wms", "d3", 9),
    )

    key = registry.keys["wms"]
    assert key.old is not None
    assert (key.digest, key.old.digest, key.old.until_ms) == ("d3", "d2", 9)


def test_the_first_start_makes_a_pair_and_keeps_only_its_digest(tmp_path: Path) -> None:
    file = AccessFile(tmp_path, lambda: 1)

    key = file.first_key()

    assert key is not None
    assert file.registry.keys["fleetledger"].digest == digest_of(key)
    assert key not in (tmp_path / FILE_NAME).read_text()
    assert (tmp_path / FILE_NAME).stat().st_mode & 0o077 == 0
    assert AccessFile(tmp_path, lambda: 1).first_key() is None


@pytest.mark.parametrize("by_command_line", [True, False])
def test_pairs_of_a_version_without_roles_become_admins(
    tmp_path: Path, by_command_line: bool
) -> None:
    (tmp_path / "keys.json").write_text('{"m4": "' + digest_of("seer") + '"}')
    file = AccessFile(tmp_path, lambda: 1)

    if by_command_line:  # it comes before the server's first start
        file.change(key_added("wms", Role.VIEWER, "d"), "test")
    assert file.first_key() is None

    again = AccessFile(tmp_path, lambda: 1).registry
    assert again.keys["m4"].role is Role.ADMIN
    assert again.keys["m4"].digest == digest_of("seer")
    assert not (tmp_path / "keys.json").exists()


def test_what_another_process_changed_is_noticed_and_built_upon(tmp_path: Path) -> None:
    server, command_line = AccessFile(tmp_path, lambda: 1), AccessFile(tmp_path, lambda: 1)
    server.change(ADMIN, "anna")

    command_line.change(key_added("wms", Role.OPERATOR, "d1"), "cli")
    assert server.refresh()
    assert not server.refresh()
    command_line.change(key_added("mes", Role.OPERATOR, "d2"), "cli")
    server.change(user_added("bob", Role.VIEWER, "h", "s"), "anna")

    assert set(server.registry.users) == {"anna", "bob"}
    assert set(server.registry.keys) == {"wms", "mes"}


def test_a_damaged_file_is_named_and_nothing_is_written_over_it(tmp_path: Path) -> None:
    file = AccessFile(tmp_path, lambda: 1)
    file.change(ADMIN, "test")
    (tmp_path / FILE_NAME).write_text('{"users": {"anna": {"role": "queen"}}}')

    with pytest.raises(Refused, match="damaged"):
        file.refresh()
    with pytest.raises(Refused, match="damaged"):
        file.change(user_removed("anna"), "test")

    assert "queen" in (tmp_path / FILE_NAME).read_text()
    assert "anna" in file.registry.users, "what was in force stays in force"
