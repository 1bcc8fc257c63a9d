"""Who calls: key pairs of machine clients, checked in constant time (spec/m4.md §1)."""

import hashlib
import hmac
import os
import secrets
from pathlib import Path

import msgspec

APP_ID_HEADER = "xyy-app-id"
APP_KEY_HEADER = "xyy-app-key"


class Keys:
    """Key pairs of a data folder: `keys.json` holds the ids and the hashes of the keys."""

    def __init__(self, hashes: dict[str, str]) -> None:
        self._hashes = hashes

    @classmethod
    def open(cls, data: Path) -> tuple["Keys", str | None]:
        """Read the keys; where there are none, make a pair and give its key, once."""
        path = data / "keys.json"
        if path.exists():
            return cls(msgspec.json.decode(path.read_bytes(), type=dict[str, str])), None
        key = secrets.token_urlsafe(32)
        hashes = {"fleetledger": _hash(key)}
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(hashes)))
        return cls(hashes), key

    def caller(self, app_id: str, key: str) -> str | None:
        """Give the id of the caller if the key is right; takes as long where the id is unknown."""
        # keys are 256 random bits, so one round of SHA-256 is as hard to turn back as many
        known = self._hashes.get(app_id, _hash(""))
        right = hmac.compare_digest(known, _hash(key))
        return app_id if right and app_id in self._hashes else None


def _hash(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()
