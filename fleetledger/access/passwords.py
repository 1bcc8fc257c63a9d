"""Passwords: hashed by argon2id, in threads, few at a time, and never written anywhere else."""

import asyncio
import secrets
from functools import cache

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from fleetledger.http import Later
from ledger.errors import Refused

CHARS_MIN = 10
CHARS_MAX = 256
# OWASP's least for argon2id: 19 MiB, 2 passes, 1 lane; 47 ms a check on one core (measured)
_hasher = PasswordHasher(memory_cost=19_456, time_cost=2, parallelism=1)
AT_ONCE_MAX = 2  # 50 ms of a core each: more would slow orders down
WAITING_MAX = 16  # behind them, so under half a second


def check_form(password: str, field: str = "password") -> None:
    """Refuse what is too short to be safe, too long to be one, or half a character."""
    whole = not any("\ud800" <= character <= "\udfff" for character in password)
    if not CHARS_MIN <= len(password) <= CHARS_MAX or not whole:
        words = f"Field '{field}' must have {CHARS_MIN} to {CHARS_MAX} characters of Unicode."
        raise Refused("errPasswordInvalid", words, field)


def hashed(password: str) -> str:
    """Hash for keeping; takes about 50 ms."""
    return _hasher.hash(password)


def matches(known: str, password: str) -> bool:
    """Compare a password with its hash; takes about 50 ms, whatever the outcome."""
    try:
        return _hasher.verify(known, password.encode(errors="replace"))
    except (VerificationError, InvalidHashError):
        return False


@cache
def nobodys() -> str:
    """Make what an unknown user's password is compared with; nobody knows its password."""
    return hashed(secrets.token_urlsafe(16))


class Passwords:
    """Hashes and compares beside the event loop."""

    def __init__(self) -> None:
        """Make the queue."""
        nobodys()  # now, or the first unknown user would be told by the time
        self._turns = asyncio.Semaphore(AT_ONCE_MAX)
        self._waiting = 0

    async def hashed(self, password: str) -> str:
        """Hash for keeping."""
        await self._turn()
        try:
            return await asyncio.to_thread(hashed, password)
        finally:
            self._turns.release()

    async def match(self, known: str | None, password: str) -> bool:
        """Compare; takes as long where there is no such user."""
        await self._turn()
        try:
            right = await asyncio.to_thread(matches, known or nobodys(), password)
        finally:
            self._turns.release()
        return right and known is not None

    async def _turn(self) -> None:
        if self._waiting >= WAITING_MAX:
            raise Later("errTooManySignIns", "Too many sign in at once: try again in a second.", 1)
        self._waiting += 1
        try:
            await self._turns.acquire()
        finally:
            self._waiting -= 1
