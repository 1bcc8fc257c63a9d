"""Who may call: people and machine clients, as the file `access.json` keeps them.

Pure values and the rules for changing them; each change also gives the event for the audit.
"""

import re
from collections.abc import Callable
from typing import TypeAlias

import msgspec

from ledger.errors import Refused
from ledger.events import (
    AccessEvent,
    KeyAdded,
    KeyRemoved,
    Role,
    UserAdded,
    UserChanged,
    UserRemoved,
)
from ledger.ids import SceneId
from ledger.scene import Value

USERS_MAX = 1_000
KEYS_MAX = 1_000
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.@-]{0,99}")  # it stands in cookies and in headers
AUTHORS = frozenset({"scheduler", "serve", "fleetledger-cli", "fleetledger-gate", "anonymous"})
EVERYWHERE = SceneId("")  # access is to all scenes


class User(Value, frozen=True, kw_only=True):
    """A person."""

    role: Role
    password: str  # argon2id, with its salt and its cost
    stamp: str  # random; sessions of an older one have ended
    disabled: bool = False


class OldKey(Value, frozen=True, kw_only=True):
    """What a rotated key was, still good for a while."""

    digest: str
    until_ms: int


class Key(Value, frozen=True, kw_only=True):
    """A machine client's key: SHA-256 of 256 random bits, which one round cannot weaken."""

    role: Role
    digest: str  # hexadecimal
    old: OldKey | None = None


class Told(Value, frozen=True, kw_only=True):
    """An event that is to be told to the ledger, with who caused it."""

    by: str
    at_ms: int
    event: AccessEvent


class Registry(Value, frozen=True, kw_only=True):
    """All of the file."""

    users: dict[str, User] = {}
    keys: dict[str, Key] = {}
    untold: tuple[Told, ...] = ()  # changes that the ledger does not have yet


Change: TypeAlias = Callable[[Registry], tuple[Registry, AccessEvent | None]]  # None = no change


def user_added(name: str, role: Role, password: str, stamp: str) -> Change:
    """Let a person sign in; `password` is its hash."""

    def change(registry: Registry) -> tuple[Registry, AccessEvent | None]:
        _check_new(registry, name, "username")
        if len(registry.users) >= USERS_MAX:
            raise Refused("errTooMany", f"There are {USERS_MAX} users already.", USERS_MAX)
        user = User(role=role, password=password, stamp=stamp)
        users = {**registry.users, name: user}
        event = UserAdded(scene=EVERYWHERE, user=name, role=role)
        return msgspec.structs.replace(registry, users=users), event

    return change


def user_changed(
    name: str,
    *,
    role: Role | None = None,
    password: str | None = None,
    disabled: bool | None = None,
    stamp: str,
) -> Change:
    """Change what is not None; a new password, or being disabled, ends the person's sessions."""

    def change(registry: Registry) -> tuple[Registry, AccessEvent | None]:
        before = known_user(registry, name)
        after = msgspec.structs.replace(
            before,
            role=role or before.role,
            password=password or before.password,
            disabled=before.disabled if disabled is None else disabled,
            stamp=stamp if password or (disabled and not before.disabled) else before.stamp,
        )
        if after == before:
            return registry, None
        changed = msgspec.structs.replace(registry, users={**registry.users, name: after})
        _check_admin_left(registry, changed)
        event = UserChanged(
            scene=EVERYWHERE,
            user=name,
            role=after.role,
            disabled=after.disabled,
            password=password is not None,
        )
        return changed, event

    return change


def user_removed(name: str) -> Change:
    """Take a person out; the sessions end."""

    def change(registry: Registry) -> tuple[Registry, AccessEvent | None]:
        known_user(registry, name)
        users = {n: user for n, user in registry.users.items() if n != name}
        changed = msgspec.structs.replace(registry, users=users)
        _check_admin_left(registry, changed)
        return changed, UserRemoved(scene=EVERYWHERE, user=name)

    return change


def key_added(app: str, role: Role, digest: str) -> Change:
    """Let a machine client call."""

    def change(registry: Registry) -> tuple[Registry, AccessEvent | None]:
        _check_new(registry, app, "appId")
        if len(registry.keys) >= KEYS_MAX:
            raise Refused("errTooMany", f"There are {KEYS_MAX} key pairs already.", KEYS_MAX)
        keys = {**registry.keys, app: Key(role=role, digest=digest)}
        event = KeyAdded(scene=EVERYWHERE, app=app, role=role)
        return msgspec.structs.replace(registry, keys=keys), event

    return change


def key_rotated(app: str, digest: str, old_until_ms: int) -> Change:
    """Give a client another key; the one before stays good until then, older ones do not."""

    def change(registry: Registry) -> tuple[Registry, AccessEvent | None]:
        before = _known_key(registry, app)
        old = OldKey(digest=before.digest, until_ms=old_until_ms)
        keys = {**registry.keys, app: Key(role=before.role, digest=digest, old=old)}
        event = KeyAdded(scene=EVERYWHERE, app=app, role=before.role, rotated=True)
        return msgspec.structs.replace(registry, keys=keys), event

    return change


def key_removed(app: str) -> Change:
    """Take a key pair back, the old key too."""

    def change(registry: Registry) -> tuple[Registry, AccessEvent | None]:
        _known_key(registry, app)
        keys = {id_: key for id_, key in registry.keys.items() if id_ != app}
        changed = msgspec.structs.replace(registry, keys=keys)
        _check_admin_left(registry, changed)
        return changed, KeyRemoved(scene=EVERYWHERE, app=app)

    return change


def known_user(registry: Registry, name: str) -> User:
    """Find a person, or refuse."""
    if name not in registry.users:
        raise Refused("errUserNotFound", f"Field 'username': there is no user '{name}'.", name)
    return registry.users[name]


def _known_key(registry: Registry, app: str) -> Key:
    if app not in registry.keys:
        raise Refused("errKeyNotFound", f"Field 'appId': there is no key pair '{app}'.", app)
    return registry.keys[app]


def _check_new(registry: Registry, name: str, field: str) -> None:
    """One name, one caller: the ledger says who asked by it, and repeated keys go by it."""
    if not NAME.fullmatch(name) or name in AUTHORS:
        words = (
            f"Field '{field}' must have 1 to 100 of the characters A-Z a-z 0-9 _ . @ -, "
            f"not begin with one of . @ -, and be none of {', '.join(sorted(AUTHORS))}."
        )
        raise Refused("errNameInvalid", words, field)
    if name in registry.users or name in registry.keys:
        words = f"Field '{field}': a user or a key pair has the name '{name}' already."
        raise Refused("errNameTaken", words, name)


def _check_admin_left(before: Registry, after: Registry) -> None:
    if _has_admin(before) and not _has_admin(after):
        words = "Nobody could change access any more: let somebody else be admin first."
        raise Refused("errLastAdmin", words)


def _has_admin(registry: Registry) -> bool:
    people = any(u.role is Role.ADMIN and not u.disabled for u in registry.users.values())
    return people or any(key.role is Role.ADMIN for key in registry.keys.values())
