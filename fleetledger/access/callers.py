"""Who calls: told by headers or cookies of every request, by look-ups only (spec/m4.md §1).

The first of these that is there decides, and a wrong one is not made good by the next: the pair
of a machine client, the id and token of a person, the same as cookies.
"""

import hmac
import re
from collections.abc import Callable, Mapping
from typing import Protocol

from fleetledger.access.file import digest_of
from fleetledger.access.registry import Registry
from fleetledger.access.sessions import Session, Sessions
from ledger.events import Role
from ledger.scene import Value

APP_ID_HEADER = "xyy-app-id"
APP_KEY_HEADER = "xyy-app-key"
USER_HEADER = "x-xzz-qyq"
TOKEN_HEADER = "x-xzz-qyx"
USER_COOKIE = "xzz-qyq-"  # and the port of the page
TOKEN_COOKIE = "xzz-qyx-"
CLAIM_CHARS_MAX = 100
COOKIE_PAIRS_MAX = 8  # a browser sends the cookies of all ports of a host
LOOPBACK = re.compile(
    rb"(127\.\d+\.\d+\.\d+|\[::1\]|[^.:]*|[^:]*\.localhost)(:\d+)?", re.IGNORECASE
)
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})

_APP_ID, _APP_KEY = APP_ID_HEADER.encode(), APP_KEY_HEADER.encode()
_USER, _TOKEN = USER_HEADER.encode(), TOKEN_HEADER.encode()

Headers = Mapping[bytes, bytes]


class Caller(Value, frozen=True, kw_only=True):
    """Somebody who may call."""

    name: str  # a user's, or an app id
    role: Role
    app: bool = False
    token: str = ""  # of a person's session
    ambient: bool = False  # a browser sends it along whoever's page it shows


ANYBODY = Caller(name="anonymous", role=Role.ADMIN, ambient=True)


class Callers(Protocol):
    """Tells who calls."""

    def caller(self, headers: Headers) -> Caller | None:
        """Give the caller; None = nobody known."""

    def host_is_known(self, headers: Headers) -> bool:
        """Tell whether the name that the client used for this server is one of its own."""


class Anybody:
    """Callers of a server without access control, on loopback: whoever they say they are."""

    def caller(self, headers: Headers) -> Caller:
        """Take the claimed name, for the ledger says who asked."""
        claimed = headers.get(_APP_ID) or headers.get(_USER)
        if claimed is None:
            return ANYBODY
        name = claimed.decode("latin-1")[:CLAIM_CHARS_MAX]
        return Caller(name=name, role=Role.ADMIN, ambient=True)

    def host_is_known(self, headers: Headers) -> bool:
        """Refuse names that somebody else's page may have pointed at this machine.

        Those have a dot: one without is nobody's to buy.
        """
        return LOOPBACK.fullmatch(headers.get(b"host", b"")) is not None


class KnownCallers:
    """Callers with keys and sessions."""

    def __init__(
        self, registry: Callable[[], Registry], sessions: Sessions, now_ms: Callable[[], int]
    ) -> None:
        """Take where the newest registry is, the sessions, and the wall's clock."""
        self._registry = registry
        self._sessions = sessions
        self._now_ms = now_ms

    def caller(self, headers: Headers) -> Caller | None:
        """Tell who calls, by the newest registry: a change of access counts at once."""
        app_id, key = headers.get(_APP_ID), headers.get(_APP_KEY)
        if app_id is not None or key is not None:
            return self._app((app_id or b"").decode("latin-1"), (key or b"").decode("latin-1"))
        user, token = headers.get(_USER), headers.get(_TOKEN)
        if user is not None or token is not None:
            return self.person((user or b"").decode("latin-1"), (token or b"").decode("latin-1"))
        cookies = headers.get(b"cookie")
        return None if cookies is None else self._browser(cookies)

    def host_is_known(self, headers: Headers) -> bool:
        """Accept every name: who has no key gets nothing by it."""
        return True

    def _app(self, app_id: str, key: str) -> Caller | None:
        """Compare digests in constant time, as long where the id is unknown."""
        known = self._registry().keys.get(app_id)
        digest = digest_of(key)
        right = hmac.compare_digest(digest, _NO_DIGEST if known is None else known.digest)
        if known is None:
            return None
        if not right and known.old is not None and self._now_ms() < known.old.until_ms:
            right = hmac.compare_digest(digest, known.old.digest)
        return Caller(name=app_id, role=known.role, app=True) if right else None

    def person(self, name: str, token: str, *, ambient: bool = False) -> Caller | None:
        """Find the session, and see whether its user still may call."""
        session = self._sessions.session(token)
        if session is None or session.user != name or not self.holds(session):
            return None
        role = self._registry().users[name].role
        return Caller(name=name, role=role, token=token, ambient=ambient)

    def holds(self, session: Session) -> bool:
        """Tell whether the user is there, and as when the session began."""
        user = self._registry().users.get(session.user)
        return user is not None and not user.disabled and user.stamp == session.stamp

    def _browser(self, cookies: bytes) -> Caller | None:
        names, tokens = _pairs(cookies)
        for port, token in tokens[:COOKIE_PAIRS_MAX]:
            caller = self.person(names.get(port, ""), token, ambient=True)
            if caller is not None:
                return caller
        return None


_NO_DIGEST = digest_of("")


def claimed(headers: Headers) -> str:
    """Give the name that a call came with, right or wrong; empty = none."""
    name = headers.get(_APP_ID) or headers.get(_USER)
    if name is None and b"cookie" in headers:
        names, _ = _pairs(headers[b"cookie"])
        return next(iter(names.values()), "")[:CLAIM_CHARS_MAX]
    return (name or b"").decode("latin-1")[:CLAIM_CHARS_MAX]


def _pairs(cookies: bytes) -> tuple[dict[str, str], list[tuple[str, str]]]:
    """Read names by port, and tokens with their ports."""
    names: dict[str, str] = {}
    tokens: list[tuple[str, str]] = []
    for part in cookies.decode("latin-1").split(";"):
        name, _, value = part.strip().partition("=")
        if name.startswith(USER_COOKIE):
            names[name.removeprefix(USER_COOKIE)] = value
        elif name.startswith(TOKEN_COOKIE):
            tokens.append((name.removeprefix(TOKEN_COOKIE), value))
    return names, tokens


def from_own_page(headers: Headers) -> bool:
    """Tell whether a browser's request comes from a page of this server, or from no page at all.

    Only browsers send these headers, and no page can forge them. Without them it is a program.
    """
    site = headers.get(b"sec-fetch-site")
    if site is not None:
        return site in (b"same-origin", b"none")
    origin = headers.get(b"origin")
    if origin is None:
        return True
    host = headers.get(b"host", b"").lower()
    # a proxy before the server may speak TLS while it does not: hosts are compared, not schemes
    _, _, named = origin.lower().partition(b"://")
    return bool(host) and named == host
