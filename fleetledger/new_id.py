"""Ids of what is new."""

import random
import secrets

_ids = random.Random(secrets.randbits(256))


def new_id() -> str:
    """Make an id like M4's: 24 hexadecimal digits. Unique, but no secret.

    Asking the system for chance each time lets go of the interpreter's lock, and to get it back
    took longer than deciding the order (measured under load).
    """
    return f"{_ids.getrandbits(96):024X}"
