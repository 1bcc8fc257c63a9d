"""One file of the ledger: how it is named, begun, written chunk by chunk, and finished.

    magic, Header, Chunk …, Metadata `fleetledger.segment`, DataEnd with CRC, Footer, magic

One commit is one chunk. Schemas and channels stand in the chunk that first needs them, because MCAP
has no checksum outside chunks. Everything from Metadata on is the *trailer*; it always has the same
size, and every segment but the newest has one. A segment is never opened again for more events.
"""

import hashlib
import re
import zlib
from array import array
from collections.abc import Iterable
from pathlib import Path

from ledger import mcap_records as mcap
from ledger.codec import encode, schema_of
from ledger.disk import Disk, write_all, write_file
from ledger.errors import LedgerDamaged
from ledger.events import EVENTS, AnyEvent, Event
from ledger.scene import Value

SUFFIX = ".mcap"
BEGINNING = mcap.MAGIC + mcap.header("", "fleetledger-1")  # the same bytes in every segment
ENDING = mcap.footer() + mcap.MAGIC
TRAILER_NAME = "fleetledger.segment"
_FORMAT = re.compile(rb"fleetledger-[a-z0-9-]*[0-9]")
AS_NEWER = "as a newer program might"
NO_HASH = "0" * 64  # predecessor of the first segment

SEGMENT_BYTES_MAX = 64 * 1024 * 1024
SEGMENT_CHUNKS_MAX = 50_000
NS_PER_MS = 1_000_000


def segment_name(first: int) -> str:
    """File name of the segment that begins with this position."""
    return f"{first:020}{SUFFIX}"


def first_position(path: Path) -> int:
    """First position of a segment, from its name; LedgerDamaged where that is not a position."""
    stem = path.name.removesuffix(SUFFIX)
    if len(stem) != 20 or not stem.isascii() or not stem.isdigit() or int(stem) == 0:
        raise LedgerDamaged(path, 0, "its name is not a first position of 20 digits")
    return int(stem)


def segment_paths(directory: Path) -> list[Path]:
    """All segments in order of position."""
    paths = sorted(directory.glob(f"*{SUFFIX}"))
    for path in paths:
        first_position(path)
    return paths


def header_flaw(data: bytes) -> str:
    """Say what is wrong with a beginning that is not ours; a newer program may have written it."""
    said = _FORMAT.search(data[: 2 * len(BEGINNING)])
    if said is None or data.startswith(BEGINNING):
        return "its header is not ours"
    return f"its header is not ours: it says {said[0].decode()}, {AS_NEWER}"


class Trailer(Value, frozen=True, kw_only=True):
    """What a finished segment says of itself."""

    first: int
    last: int
    predecessor: str  # sha256 of the segment before it, so that none can be exchanged unnoticed
    sha256: str  # of the predecessor's hash and all payloads: survives sealing

    def record(self) -> bytes:
        """The Metadata record; digits are padded so that every trailer has the same size."""
        values = {
            "first": f"{self.first:020}",
            "last": f"{self.last:020}",
            "predecessor": self.predecessor,
            "sha256": self.sha256,
        }
        return mcap.metadata(TRAILER_NAME, values)

    def to_bytes(self, data_crc: int) -> bytes:
        """The whole trailer, for a data section with this CRC before its Metadata record."""
        named = self.record()
        return named + mcap.data_end(zlib.crc32(named, data_crc)) + ENDING


_SAMPLE = Trailer(first=1, last=1, predecessor=NO_HASH, sha256=NO_HASH)
TRAILER_BYTES = len(_SAMPLE.to_bytes(0))
# offsets of the four values in the record; only lengths before them, which do not vary
_VALUES: dict[str, slice] = {}
_at = _SAMPLE.record().index(b"first") - 4
for _key, _size in (("first", 20), ("last", 20), ("predecessor", 64), ("sha256", 64)):
    _at += 4 + len(_key) + 4
    _VALUES[_key] = slice(_at, _at + _size)
    _at += _size
_CRC = slice(len(_SAMPLE.record()) + mcap.RECORD.size, len(_SAMPLE.record()) + mcap.RECORD.size + 4)


def parse_trailer_record(record: bytes) -> Trailer | None:
    """Read a Metadata record; None unless every byte is as we would have written it."""
    if len(record) != len(_SAMPLE.record()):
        return None
    if not (record[_VALUES["first"]].isdigit() and record[_VALUES["last"]].isdigit()):
        return None
    words = {key: record[where].decode("latin-1") for key, where in _VALUES.items()}
    trailer = Trailer(
        first=int(words["first"]),
        last=int(words["last"]),
        predecessor=words["predecessor"],
        sha256=words["sha256"],
    )
    return trailer if trailer.record() == record else None


def read_trailer(tail: bytes) -> tuple[Trailer, int] | None:
    """Read the last TRAILER_BYTES of a file: the trailer and the CRC of the data section, or None.

    None unless every byte is as we would have written it.
    """
    if len(tail) != TRAILER_BYTES or not tail.endswith(ENDING):
        return None
    trailer = parse_trailer_record(tail[: len(_SAMPLE.record())])
    if trailer is None:
        return None
    crc = int.from_bytes(tail[_CRC], "little")
    written = trailer.record() + mcap.data_end(crc) + ENDING
    return (trailer, crc) if tail == written else None


def _declaration(number: int, kind: type[Event], aggregate: str) -> bytes:
    name = kind.__name__
    return mcap.schema(number, name, "jsonschema", schema_of(kind)) + mcap.channel(
        number, number, f"{aggregate}/{name}", "json"
    )


class _Channel(Value, frozen=True, kw_only=True):
    number: int
    declaration: bytes


_CHANNELS: dict[type, _Channel] = {
    kind: _Channel(number=number, declaration=_declaration(number, kind, aggregate))
    for number, (kind, aggregate) in enumerate(EVENTS.items(), 1)
}


class SegmentWriter:
    """The newest segment. `add` events, `write` them as one chunk; `finish` it at last.

    Holds a file; belongs to one thread. After any OSError it must not be used any more.
    """

    def __init__(self, disk: Disk, directory: Path, first: int, last_ns: int, predecessor: str):
        """Create the file whole or not at all: draft, sync, rename, sync the folder."""
        self.path = directory / segment_name(first)
        self.first = first
        self.next = first  # position of the next event to add
        self.last_ns = last_ns  # log time of the newest event
        self.size = len(BEGINNING)
        self.index = array("Q")  # first position of each chunk
        self.offsets = array("Q")  # and where it begins
        self._disk = disk
        self._crc = zlib.crc32(BEGINNING)
        self._predecessor = predecessor
        self._sha = hashlib.sha256(predecessor.encode())
        self._unhashed: list[bytes] = []
        self._declared: set[type] = set()
        self._pending = bytearray()
        self._pending_first = (first, 0)  # position and log time of its first event, 0 = none
        self._spare = b""
        self._written = (first, 0)  # first position and size of the newest chunk
        self._fd = write_file(disk, self.path, BEGINNING)

    @property
    def pending_bytes(self) -> int:
        """Size of what the next commit would write."""
        return len(self._pending)

    def add(self, events: Iterable[AnyEvent]) -> None:
        """Put events into the next chunk. Log times are the events' own, but strictly increasing.

        Two events of one millisecond get neighbouring nanoseconds, so that readers which sort by
        time keep the order of positions; the publish time is the event's, unchanged.
        """
        pending, last_ns, sequence = self._pending, self.last_ns, self.next - self.first
        pack, channels, declared = mcap.MESSAGE_HEAD.pack, _CHANNELS, self._declared
        unhashed, rest, opcode = self._unhashed, mcap.MESSAGE_REST, mcap.MESSAGE
        for event in events:
            payload = encode(event)
            kind = type(event)
            known = channels[kind]
            if kind not in declared:
                declared.add(kind)
                pending += known.declaration
                self._spare = known.declaration
            at_ns = event.at_ms * NS_PER_MS
            last_ns = at_ns if at_ns > last_ns else last_ns + 1
            if not self._pending_first[1]:
                self._pending_first = (self.first + sequence, last_ns)
            pending += pack(opcode, rest + len(payload), known.number, sequence, last_ns, at_ns)
            pending += payload
            unhashed.append(payload)
            sequence += 1
        self.last_ns = last_ns
        self.next = self.first + sequence

    def write(self) -> None:
        """Write the pending events as one chunk and return when they are on disk."""
        first, first_ns = self._pending_first
        data = mcap.chunk(self._pending, first_ns, self.last_ns, self._spare)
        write_all(self._disk, self._fd, data)
        self._disk.sync(self._fd)
        self._crc = zlib.crc32(data, self._crc)
        self._pending.clear()
        self._pending_first = (self.next, 0)
        self._written = (first, len(data))

    def committed(self) -> None:
        """Show readers the chunk just written; the caller holds the lock that they hold."""
        first, size = self._written
        self.offsets.append(self.size)
        self.index.append(first)
        self.size += size

    def hash(self) -> None:
        """Hash what has been added; best after everybody has been told, for nobody waits for it.

        One long update lets go of Python's lock, which many short ones do not.
        """
        self._sha.update(b"".join(self._unhashed))
        self._unhashed.clear()

    def finish(self) -> str:
        """Write the trailer, sync and close; gives the hash that the next segment names."""
        self.hash()
        trailer = Trailer(
            first=self.first,
            last=self.next - 1,
            predecessor=self._predecessor,
            sha256=self._sha.hexdigest(),
        )
        finish(self._disk, self._fd, trailer, self._crc)
        self.close()
        return trailer.sha256

    def close(self) -> None:
        """Close the file as it is; a second time does nothing."""
        if self._fd >= 0:
            self._disk.close(self._fd)
            self._fd = -1


def finish(disk: Disk, fd: int, trailer: Trailer, data_crc: int) -> None:
    """Append the trailer and sync."""
    write_all(disk, fd, trailer.to_bytes(data_crc))
    disk.sync(fd)
