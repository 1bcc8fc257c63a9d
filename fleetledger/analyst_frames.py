"""What the core and the analyst's process say to each other over its pipes."""

import struct
from typing import Protocol, TypeAlias

import msgspec

from ledger.scene import Value

_LENGTH = struct.Struct(">I")
_HEAD = struct.Struct(">QHQI")  # number, HTTP status, position, length of the body
HEAD_BYTES = _HEAD.size


class Asked(Value, frozen=True, kw_only=True, tag=True):
    """A statement; it is answered as of this position or a later one."""

    number: int
    sql: str
    rows_max: int
    position: int


class Dropped(Value, frozen=True, kw_only=True, tag=True):
    """Who asked has gone."""

    number: int


class Grown(Value, frozen=True, kw_only=True, tag=True):
    """The ledger is on disk up to here: take it in while nobody asks."""

    position: int


ToAnalyst: TypeAlias = Asked | Dropped | Grown


class Answered(Value, frozen=True, kw_only=True):
    """The answer, ready to be sent on."""

    number: int
    status: int
    position: int
    body: bytes


class Stream(Protocol):
    """A pipe to read from, as files are."""

    def read(self, size: int, /) -> bytes:
        """Give so many bytes, or fewer at the end."""


def written(message: ToAnalyst) -> bytes:
    """Write a message to the analyst."""
    body = msgspec.json.encode(message)
    return _LENGTH.pack(len(body)) + body


def read(pipe: Stream) -> ToAnalyst | None:
    """Wait for a message of the core; None = it has gone."""
    head = pipe.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(head)
    body = pipe.read(length)
    return msgspec.json.decode(body, type=ToAnalyst) if len(body) == length else None


def answer(answered: Answered) -> bytes:
    """Write an answer of the analyst."""
    size = len(answered.body)
    return _HEAD.pack(answered.number, answered.status, answered.position, size) + answered.body


def head(raw: bytes) -> tuple[int, int, int, int]:
    """Read number, status, position and the body's length."""
    number, status, position, length = _HEAD.unpack(raw)
    return number, status, position, length
