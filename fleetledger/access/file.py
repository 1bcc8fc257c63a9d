"""The file `access.json`: read, changed by one at a time, and read again when others changed it."""

import hashlib
import secrets
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias, TypeVar

import msgspec

from fleetledger.access.registry import EVERYWHERE, Change, Key, Registry, Told
from fleetledger.private_file import held, read_private, replace_private
from ledger.errors import Refused
from ledger.events import KeyAdded, Role

FILE_NAME = "access.json"
OLD_FILE_NAME = "keys.json"  # of versions that knew no roles
FIRST_APP = "fleetledger"
UNTOLD_MAX = 10_000  # changes by the command line while no server runs

Mark: TypeAlias = tuple[int, int, int]  # which file it is, when written, how long

T = TypeVar("T")


class AccessFile:
    """The newest registry, and the ways to change it. Safe to use from every thread.

    The command line changes the file too, also while a server runs: so every change begins with
    what the file holds, and `refresh` is called now and then.
    """

    def __init__(self, data: Path, now_ms: Callable[[], int]) -> None:
        """Take the data folder and the wall's clock; raises Refused where the file is damaged."""
        self.path = data / FILE_NAME
        self._old_path = data / OLD_FILE_NAME
        self._now_ms = now_ms
        self._lock = threading.Lock()
        self._mark = self._mark_now()
        self.registry = self._read()

    @property
    def empty(self) -> bool:
        """Whether nobody may call."""
        return not (self.registry.users or self.registry.keys)

    def refresh(self) -> bool:
        """Read the file if it is another than last time; tells whether it was."""
        with self._lock:
            mark = self._mark_now()
            if mark == self._mark:
                return False
            self.registry, self._mark = self._read(), mark
            return True

    def change(self, change: Change, by: str) -> Registry:
        """Make one change, with its event to be told; on disk when this returns."""
        with self._lock, held(self.path):
            before = self._read()
            after, event = change(before)
            if event is None:
                return before
            if len(after.untold) >= UNTOLD_MAX:
                words = "Too many changes wait to be told to the ledger: start the server first."
                raise Refused("errTooMany", words, UNTOLD_MAX)
            told = Told(by=by, at_ms=self._now_ms(), event=event)
            self._write(msgspec.structs.replace(after, untold=(*after.untold, told)))
            return self.registry

    def told(self, events: tuple[Told, ...]) -> None:
        """Forget changes that the ledger has now."""
        with self._lock, held(self.path):
            newest = self._read()
            untold = tuple(told for told in newest.untold if told not in events)
            self._write(msgspec.structs.replace(newest, untold=untold))

    def first_key(self) -> str | None:
        """Make a key where nobody may call yet, and give it, once: only its digest is kept."""
        given = None
        with self._lock, held(self.path):
            if self.path.exists():
                return None
            registry = self._read()
            if not registry.keys:
                given = new_key()
                registry = self._of_keys({FIRST_APP: digest_of(given)})
            self._write(registry)
        return given

    def _read(self) -> Registry:
        """Read the file; where there is none, the keys of a version that had no roles."""
        raw = read_private(self.path)
        if raw is not None:
            return _decoded(self.path, raw, Registry)
        raw = read_private(self._old_path)
        if raw is not None:
            return self._of_keys(_decoded(self._old_path, raw, dict[str, str]))
        return Registry()

    def _of_keys(self, digests: dict[str, str]) -> Registry:
        role, now_ms = Role.ADMIN, self._now_ms()
        return Registry(
            keys={app: Key(role=role, digest=digest) for app, digest in digests.items()},
            untold=tuple(
                Told(by="serve", at_ms=now_ms, event=KeyAdded(scene=EVERYWHERE, app=app, role=role))
                for app in digests
            ),
        )

    def _write(self, registry: Registry) -> None:
        replace_private(self.path, msgspec.json.format(msgspec.json.encode(registry)))
        self._old_path.unlink(missing_ok=True)  # what it held is in the new file
        self.registry, self._mark = registry, self._mark_now()

    def _mark_now(self) -> Mark | None:
        try:
            found = self.path.stat()
        except FileNotFoundError:
            return None
        return found.st_ino, found.st_mtime_ns, found.st_size


def new_key() -> str:
    """Make a key: 256 random bits."""
    return secrets.token_urlsafe(32)


def digest_of(key: str) -> str:
    """Digest a key or a token, whose bits are all random."""
    return hashlib.sha256(key.encode()).hexdigest()


def _decoded(path: Path, raw: bytes, kind: type[T]) -> T:
    try:
        return msgspec.json.decode(raw, type=kind)
    except msgspec.DecodeError as trouble:
        words = f"{path} is damaged ({trouble}): restore it from a backup, or remove it."
        raise Refused("errAccessDamaged", words, str(path)) from trouble
