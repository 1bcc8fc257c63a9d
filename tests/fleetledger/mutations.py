"""Bodies that are almost right: golden requests with one thing or a few changed, by seed."""

import json
from collections.abc import Sequence
from copy import deepcopy
from random import Random
from typing import Any

NASTY: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2**31 - 1, 2**31, 2**53 + 1, 2**63, 2**64, -(2**63), 10**400),
    *(0.0, -0.0, 1e-320, 1e308, float("nan"), float("inf"), float("-inf"), 0.1),
    *("", " ", "0", "true", "null", "\0", "\ud800", "\u202e", "é", "🤖", "a" * 201, "x" * 5_000),
    *("../../etc/passwd", "'; drop table orders; --", "%00", "{}", "[]", "*", "scenes/**", "$#?"),
    *([], {}, [[]], [None], {"": None}, {"a": {"b": {"c": []}}}, [1, "1", None, {}]),
)
CHANGES_MAX = 3
DEEP = 2_000


def mutated(random: Random, body: Any, names: Sequence[str]) -> bytes:
    """Give the bytes of a changed body; some are no JSON at all.

    `names` are words that mean something to the server, so that a change may also hit.
    """
    roll = random.random()
    if roll < 0.02:
        return random.randbytes(random.randint(0, 64))
    changed = deepcopy(body)
    if roll < 0.04:
        return _deep(random)
    for _ in range(random.randint(0, CHANGES_MAX)):
        changed = _changed(random, changed, names)
    raw = json.dumps(changed).encode("utf-8", "surrogatepass")
    if roll < 0.08:
        cut = random.randint(0, len(raw))
        return raw[:cut] + (b"" if random.random() < 0.5 else random.randbytes(3)) + raw[cut + 1 :]
    return raw


def _deep(random: Random) -> bytes:
    depth = random.choice((40, DEEP, 50 * DEEP))
    return b'{"a":' * depth if random.random() < 0.5 else b"[" * depth + b"]" * depth


def _changed(random: Random, body: Any, names: Sequence[str]) -> Any:
    holders = list(_holders(body))
    if not holders or random.random() < 0.02:
        return _value(random, names)
    holder = random.choice(holders)
    if isinstance(holder, dict):
        return _in_object(random, body, holder, names)
    index = random.randrange(len(holder))
    match random.randrange(4):
        case 0:
            holder[index] = _value(random, names)
        case 1:
            del holder[index]
        case 2:
            holder.insert(index, deepcopy(holder[index]))
        case _:
            holder.extend(deepcopy(holder[index]) for _ in range(random.choice((5, 1_100))))
    return body


def _in_object(random: Random, body: Any, holder: dict[str, Any], names: Sequence[str]) -> Any:
    key = random.choice(list(holder))
    match random.randrange(6):
        case 0 | 1 | 2:
            holder[key] = _value(random, names)
        case 3:
            del holder[key]
        case 4:
            holder[str(random.choice(NASTY))] = holder.pop(key)
        case _:
            other = random.choice(list(holder))
            holder[key], holder[other] = holder[other], holder[key]
    return body


def _value(random: Random, names: Sequence[str]) -> Any:
    if names and random.random() < 0.4:
        return random.choice(names)
    return deepcopy(random.choice(NASTY))


def _holders(body: Any) -> Any:
    """Find every object and list that holds something."""
    if isinstance(body, dict | list) and body:
        yield body
        for inner in body.values() if isinstance(body, dict) else body:
            yield from _holders(inner)


def adapted(random: Random, body: Any, real: dict[str, Sequence[str]]) -> Any:
    """Put names of the running plant in place of the examples', by the names of the fields."""
    if isinstance(body, list):
        return [adapted(random, item, real) for item in body]
    if not isinstance(body, dict):
        return body
    found = {}
    for key, value in body.items():
        known = real.get(key)
        if known and isinstance(value, list):
            found[key] = [random.choice(known) for _ in value[:3]]
        elif known and isinstance(value, str):
            found[key] = random.choice(known)
        else:
            found[key] = adapted(random, value, real)
    return found
