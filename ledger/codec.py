"""Events as JSON bytes and back, their JSON Schemas, and the way out of retired shapes."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import msgspec

from ledger.errors import LedgerNewer
from ledger.events import EVENTS, AnyEvent, Event

# retired event type -> what it says in today's words; kept for ever, with a fixture each
UPCASTERS: Mapping[type[Event], Callable[[Any], AnyEvent]] = {}

# part of events -> fields that it once had and that nobody reads any more
RETIRED_FIELDS: Mapping[str, frozenset[str]] = {"RobotConfig": frozenset({"gateway_secret"})}

NAMES = {kind.__name__: kind for kind in EVENTS}

_ENCODER = msgspec.json.Encoder()
encode: Callable[[AnyEvent], bytes] = _ENCODER.encode  # the tag `type` comes first


class _Tag(msgspec.Struct):
    type: str


_TAG = msgspec.json.Decoder(_Tag)


class Decoder:
    """Reads events of today, and of yesterday through upcasters; one per thread is not needed."""

    def __init__(self, upcasters: Mapping[type[Event], Callable[[Any], AnyEvent]] = UPCASTERS):
        self._today: Callable[[bytes | memoryview], AnyEvent]
        self._today = msgspec.json.Decoder(AnyEvent).decode
        self._retired = {
            kind.__name__: (msgspec.json.Decoder(kind), up) for kind, up in upcasters.items()
        }

    def decode(self, payload: bytes | memoryview) -> AnyEvent:
        """Read one event; raises LedgerNewer for a type or shape that this program cannot know.

        Callers have checked the bytes' CRC, so what does not fit was written on purpose.
        """
        try:
            return self._today(payload)
        except msgspec.ValidationError as error:
            name = _TAG.decode(payload).type
            if name in self._retired:
                decoder, upcast = self._retired[name]
                return upcast(decoder.decode(payload))
            what = "has an unknown shape" if name in NAMES else "is an unknown type of event"
            raise LedgerNewer(f"{name} {what}: {error}") from error

    def check(self, name: str, schema: bytes) -> None:
        """Refuse a ledger whose schema of this event says more than ours: LedgerNewer.

        Unknown fields would otherwise be skipped in silence and the fold would differ.
        """
        if name in self._retired:
            return
        if name not in NAMES:
            raise LedgerNewer(f"{name} is an unknown type of event")
        ours = schema_of(NAMES[name])
        if schema == ours:
            return
        known, theirs = _shapes(ours), _shapes(schema)
        for title, words in theirs.items():
            ours_or_retired = known.get(title, frozenset()) | RETIRED_FIELDS.get(title, frozenset())
            if more := words - ours_or_retired:
                raise LedgerNewer(f"{name}: {title} has unknown {', '.join(sorted(more))}")


DECODER = Decoder()
decode = DECODER.decode


@cache
def schema_of(kind: type[Event]) -> bytes:
    """Give the JSON Schema of an event: an object at the root, as Foxglove wants it."""
    schema = msgspec.json.schema(kind)
    definitions = dict(schema["$defs"])
    root = {**definitions.pop(kind.__name__), "$defs": definitions}
    return msgspec.json.encode(root, order="deterministic")


def _shapes(schema: bytes) -> dict[str, frozenset[str]]:
    """Give the field names, or the values of an enumeration, of each definition in a schema."""
    root = msgspec.json.decode(schema)
    definitions = {root.get("title", ""): root, **root.get("$defs", {})}
    return {
        title: frozenset(map(str, (*shape.get("properties", ()), *shape.get("enum", ()))))
        for title, shape in definitions.items()
    }
