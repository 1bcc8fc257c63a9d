"""Events of access: who may call, and who was refused. They change no state: they are the audit.

Passwords and keys are never in the ledger; `scene` is empty, for access is to all scenes.
"""

from enum import StrEnum
from typing import TypeAlias

from ledger.events.base import Event


class Role(StrEnum):
    """What a caller may do; each may all that those before it may."""

    VIEWER = "viewer"  # look
    OPERATOR = "operator"  # send orders, and tell robots and devices what to do
    ADMIN = "admin"  # change scenes, robots, settings and access


class UserAdded(Event, frozen=True, kw_only=True):
    """A person may sign in from now on."""

    user: str
    role: Role


class UserChanged(Event, frozen=True, kw_only=True):
    """A person got another role or password, or may not sign in for now."""

    user: str
    role: Role
    disabled: bool = False
    password: bool = False  # it was changed


class UserRemoved(Event, frozen=True, kw_only=True):
    """A person may not sign in any more."""

    user: str


class KeyAdded(Event, frozen=True, kw_only=True):
    """A machine client got a key pair, or another key in place of its old one."""

    app: str
    role: Role
    rotated: bool = False


class KeyRemoved(Event, frozen=True, kw_only=True):
    """A key pair was taken back."""

    app: str


class SignedIn(Event, frozen=True, kw_only=True):
    """A person signed in."""

    user: str
    address: str


class SignedOut(Event, frozen=True, kw_only=True):
    """A person signed out."""

    user: str


class AccessRefused(Event, frozen=True, kw_only=True):
    """Somebody was refused; alike refusals of one minute are one event with their number."""

    caller: str  # as claimed, cut; empty = none
    address: str
    call: str  # method and path
    code: str  # of the answer
    count: int = 1


AccessEvent: TypeAlias = (
    UserAdded
    | UserChanged
    | UserRemoved
    | KeyAdded
    | KeyRemoved
    | SignedIn
    | SignedOut
    | AccessRefused
)
