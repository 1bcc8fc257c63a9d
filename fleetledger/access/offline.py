"""Access changed by the command line, with or without a server on the folder."""

import os
import pwd
import secrets
import sys
from pathlib import Path

from fleetledger.access.file import AccessFile, digest_of, new_key
from fleetledger.access.passwords import check_form, hashed
from fleetledger.access.registry import (
    Change,
    key_added,
    key_removed,
    key_rotated,
    user_added,
    user_changed,
    user_removed,
)
from fleetledger.clock import wall_ms
from ledger.events import Role


def list_users(data: Path) -> None:
    """Print a line for each."""
    for name, user in sorted(AccessFile(data, wall_ms).registry.users.items()):
        _print(f"{name}\t{user.role}\t{'disabled' if user.disabled else 'enabled'}")


def add_user(data: Path, name: str, role: Role, password: str) -> None:
    """Let a person sign in."""
    check_form(password)
    _change(data, user_added(name, role, hashed(password), _stamp()))


def change_user(
    data: Path, name: str, *, role: Role | None, password: str | None, disabled: bool | None
) -> None:
    """Change what is not None."""
    if password is not None:
        check_form(password)
    change = user_changed(
        name,
        role=role,
        password=None if password is None else hashed(password),
        disabled=disabled,
        stamp=_stamp(),
    )
    _change(data, change)


def remove_user(data: Path, name: str) -> None:
    """Let a person sign in no more."""
    _change(data, user_removed(name))


def list_keys(data: Path) -> None:
    """Print a line for each."""
    for app, key in sorted(AccessFile(data, wall_ms).registry.keys.items()):
        rotating = key.old is not None and key.old.until_ms > wall_ms()
        _print(f"{app}\t{key.role}\t{'old key still good' if rotating else 'one key'}")


def add_key(data: Path, app_id: str, role: Role) -> None:
    """Make a key pair and print its key."""
    key = new_key()
    _change(data, key_added(app_id, role, digest_of(key)))
    _print(key)


def rotate_key(data: Path, app_id: str, grace_minutes: int) -> None:
    """Make another key and print it."""
    key = new_key()
    _change(data, key_rotated(app_id, digest_of(key), wall_ms() + grace_minutes * 60_000))
    _print(key)


def remove_key(data: Path, app_id: str) -> None:
    """Take a key pair back."""
    _change(data, key_removed(app_id))


def _change(data: Path, change: Change) -> None:
    """Say in the audit that it was the command line, and whose."""
    AccessFile(data, wall_ms).change(change, f"fleetledger-cli ({_person()})")


def _person() -> str:
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:  # a user without a name, as in containers
        return str(os.getuid())


def _stamp() -> str:
    return secrets.token_hex(8)


def _print(line: str) -> None:
    sys.stdout.write(line + "\n")
