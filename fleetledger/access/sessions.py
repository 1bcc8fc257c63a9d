"""Sessions of people who signed in: random tokens, of which only digests are kept."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import msgspec

from fleetledger.access.file import digest_of, new_key
from fleetledger.access.registry import User
from fleetledger.private_file import read_private, replace_private
from ledger.errors import Refused

FILE_NAME = "sessions.json"
IDLE_MS = 12 * 3_600_000
AGE_MS = 7 * 24 * 3_600_000
SESSIONS_MAX = 10_000
OF_USER_MAX = 20  # the one used longest ago ends
USED_APART_MS = 60_000  # uses closer than this are not told apart


class Session(msgspec.Struct, kw_only=True):
    """One browser or program of a person."""

    user: str
    stamp: str  # the user's when it began: another one now, and it has ended
    since_ms: int
    used_ms: int


class Sessions:
    """All sessions, in memory and by `keep` in `sessions.json`. Of the event loop's thread."""

    def __init__(self, data: Path, now_ms: Callable[[], int]) -> None:
        """Read those of the last run; a damaged file has everybody sign in again."""
        self._path = data / FILE_NAME
        self._now_ms = now_ms
        self._sessions: dict[str, Session] = {}
        self._changed = False
        self._writing = asyncio.Lock()
        raw = read_private(self._path)
        if raw is not None:
            try:
                self._sessions = msgspec.json.decode(raw, type=dict[str, Session])
            except msgspec.DecodeError as trouble:
                words = f"{self._path} is damaged ({trouble}): remove it, and all sign in again."
                raise Refused("errSessionsDamaged", words, str(self._path)) from trouble
            for session in self._sessions.values():
                self._brought_back(session, now_ms())

    def begin(self, name: str, user: User) -> str:
        """Begin a session and give its token; `keep` must follow."""
        self._make_room(name)
        token, now_ms = new_key(), self._now_ms()
        self._sessions[digest_of(token)] = Session(
            user=name, stamp=user.stamp, since_ms=now_ms, used_ms=now_ms
        )
        self._changed = True
        return token

    def session(self, token: str) -> Session | None:
        """Find the session of a token, and note its use; whether its user still may is not seen."""
        found = self._sessions.get(digest_of(token))  # by digest, so timing tells nothing of it
        if found is None:
            return None
        now_ms = self._now_ms()
        self._brought_back(found, now_ms)
        if _over(found, now_ms):
            return None
        if now_ms - found.used_ms >= USED_APART_MS:
            found.used_ms = now_ms
            self._changed = True
        return found

    def end(self, token: str) -> None:
        """End a session; `keep` must follow."""
        if self._sessions.pop(digest_of(token), None) is not None:
            self._changed = True

    def tidy(self, still: Callable[[Session], bool]) -> None:
        """Forget those that are over, and those whose user may not call any more."""
        now_ms = self._now_ms()
        for session in self._sessions.values():
            self._brought_back(session, now_ms)
        over = [d for d, s in self._sessions.items() if _over(s, now_ms) or not still(s)]
        for digest in over:
            del self._sessions[digest]
        self._changed = self._changed or bool(over)

    async def keep(self) -> None:
        """Write what changed; when this returns, all changes before the call are on disk."""
        async with self._writing:
            if not self._changed:
                return
            self._changed = False
            written = msgspec.json.encode(self._sessions)
            try:
                await asyncio.to_thread(replace_private, self._path, written)
            except BaseException:
                self._changed = True
                raise

    def _brought_back(self, session: Session, now_ms: int) -> None:
        """Let a session whose times are to come begin now: the wall was set back.

        It goes on, and no longer than any other that begins now.
        """
        if session.used_ms > now_ms + USED_APART_MS or session.since_ms > now_ms + USED_APART_MS:
            session.since_ms = min(session.since_ms, now_ms)
            session.used_ms = min(session.used_ms, now_ms)
            self._changed = True

    def _make_room(self, name: str) -> None:
        own = [d for d, session in self._sessions.items() if session.user == name]
        if len(own) >= OF_USER_MAX:
            del self._sessions[min(own, key=lambda d: self._sessions[d].used_ms)]
        elif len(self._sessions) >= SESSIONS_MAX:
            del self._sessions[min(self._sessions, key=lambda d: self._sessions[d].used_ms)]


def _over(session: Session, now_ms: int) -> bool:
    return now_ms - session.used_ms >= IDLE_MS or now_ms - session.since_ms >= AGE_MS
