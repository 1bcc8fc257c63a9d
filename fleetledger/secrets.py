"""Secrets that the server must be able to read again: of gateways, and for signing callbacks.

They are not in the ledger, which may be copied and exported. Passwords and keys of callers are
elsewhere (`fleetledger/access/`): of those only hashes are kept.
"""

import asyncio
import threading
from collections.abc import Mapping
from pathlib import Path

import msgspec

from fleetledger.private_file import held, read_private, replace_private
from ledger.errors import Refused

FILE_NAME = "secrets.json"
SECRETS_MAX = 20_000  # a robot has one, a scene has one
NAME_CHARS_MAX = 500
VALUE_CHARS_MAX = 10_000


class Secrets:
    """Names with their secrets, in `secrets.json` of the data folder, mode 0600.

    Safe to use from every thread. Reading is a look-up in memory; a change is on disk when it
    returns, which takes as long as the disk takes to sync.
    """

    def __init__(self, data: Path) -> None:
        """Read the file of a data folder; none is the same as an empty one."""
        self._path = data / FILE_NAME
        self._lock = threading.Lock()
        self._writing = asyncio.Lock()  # of those who wait on the event loop
        self._asked: dict[str, str] = {}  # by all who wait for either lock
        self._secrets = self._read()

    def get(self, name: str) -> str | None:
        """Give a secret; None where there is none of that name."""
        return self._secrets.get(name)

    def put(self, name: str, value: str) -> None:
        """Keep a secret, in place of an earlier one of that name."""
        self.put_all({name: value})

    def put_all(self, secrets: Mapping[str, str]) -> None:
        """Keep several secrets, all of them or none; the disk is waited for once.

        Whoever gets to write takes along what others ask for at the same time.
        """
        _check_all(secrets)
        self._asked |= secrets
        with self._lock:
            if all(self._secrets.get(name) == value for name, value in secrets.items()):
                return
            others, self._asked = self._asked, {}
            changed = {**self._secrets, **others, **secrets}
            if len(changed) > SECRETS_MAX:
                changed = {**self._secrets, **secrets}
            if len(changed) > SECRETS_MAX:
                words = f"There are {SECRETS_MAX} secrets already: remove some first."
                raise Refused("errTooMany", words, SECRETS_MAX)
            self._write(changed)

    async def keep(self, secrets: Mapping[str, str]) -> None:
        """Do the same on a thread; one at a time, which takes along what comes meanwhile."""
        _check_all(secrets)
        self._asked |= secrets
        async with self._writing:
            await asyncio.to_thread(self.put_all, secrets)

    def remove(self, name: str) -> None:
        """Forget a secret; one that is not there is nothing to do."""
        with self._lock:
            if name in self._secrets:
                self._write({known: v for known, v in self._secrets.items() if known != name})

    def _write(self, changed: dict[str, str]) -> None:
        with held(self._path):
            replace_private(self._path, msgspec.json.encode(changed))
        self._secrets = changed  # replaced, never changed: readers take no lock

    def _read(self) -> dict[str, str]:
        raw = read_private(self._path)
        if raw is None:
            return {}
        try:
            return msgspec.json.decode(raw, type=dict[str, str])
        except msgspec.DecodeError as trouble:
            words = f"{self._path} is damaged ({trouble}): restore it from a backup, or remove it."
            raise Refused("errSecretsDamaged", words, str(self._path)) from trouble


def _check_all(secrets: Mapping[str, str]) -> None:
    for name, value in secrets.items():
        _check("name", name, NAME_CHARS_MAX)
        _check("value", value, VALUE_CHARS_MAX)


def _check(what: str, text: str, most: int) -> None:
    """Refuse what cannot be kept: empty, too long, or half a character (it has no UTF-8)."""
    if not text or len(text) > most or any("\ud800" <= c <= "\udfff" for c in text):
        words = f"The {what} of a secret must have 1 to {most} characters of Unicode."
        raise Refused("errSecretInvalid", words)
