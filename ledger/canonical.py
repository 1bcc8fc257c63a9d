"""Canonical JSON: equal values give equal bytes, in whatever order their maps were filled."""

import msgspec


def canonical_json(value: object) -> bytes:
    """Encode with sorted maps.

    msgspec sorts maps by text only; values that hold maps by number (charging levels by group,
    doors that were opened) go round by plain maps, whose keys are text as they are in JSON.
    """
    try:
        return msgspec.json.encode(value, order="deterministic")
    except TypeError:
        plain = msgspec.to_builtins(value, str_keys=True)
        return msgspec.json.encode(plain, order="deterministic")
