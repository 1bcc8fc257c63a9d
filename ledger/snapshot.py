"""The state at some positions, kept beside the ledger to save folding from the beginning.

A cache: one that is damaged, of another shape or ahead of the ledger is passed over with a log
line, and deleting all of them changes nothing but time.
File: one line of JSON (the head), then the Fleet as JSON in the order of its dictionaries, for that
order is state too (answers are forgotten oldest first).
"""

import hashlib
from collections.abc import Callable, Iterator
from functools import cache
from itertools import islice
from pathlib import Path

import msgspec
import structlog

from ledger.disk import DRAFT, Disk, write_file
from ledger.events import AnyEvent
from ledger.evolve import evolve
from ledger.pace import GiveWay, at_once
from ledger.scan import read_folder
from ledger.scene import Value
from ledger.state import STATE_VERSION, Fleet

SUFFIX = ".snapshot"
EVENTS_APART = 20_000  # restoring any moment folds at most as many: 0.2 s, if enough are kept
KEPT_MAX = 64
HEAD_BYTES_MAX = 4096
PIECE_ENTRIES = 100  # encoded without a pause: some 0.4 ms

log = structlog.get_logger()

Read = Callable[[int, int | None], Iterator[AnyEvent]]  # after, until


class Head(Value, frozen=True, kw_only=True):
    """First line of a snapshot."""

    format: str
    state_version: int
    shape: str  # of the state's types: catches a change that forgot to raise the version
    position: int
    at_ms: int
    size: int
    sha256: str


FORMAT = "fleetledger-snapshot-1"


class Unusable(Exception):
    """Why a snapshot cannot be used; never leaves this module's callers as a failure."""


@cache
def shape() -> str:
    """Fingerprint of the state's types, names and defaults."""
    schema = msgspec.json.encode(msgspec.json.schema(Fleet), order="deterministic")
    return hashlib.sha256(schema).hexdigest()[:16]


def to_bytes(fleet: Fleet, give_way: GiveWay = at_once) -> bytes:
    """Head and state as one file's content; `give_way` is called between pieces of some 0.4 ms."""
    pieces: list[bytes] = []
    sha = hashlib.sha256()
    for piece in _pieces(fleet):
        pieces.append(piece)
        sha.update(piece)
        give_way()
    body = b"".join(pieces)
    head = Head(
        format=FORMAT,
        state_version=STATE_VERSION,
        shape=shape(),
        position=fleet.position,
        at_ms=fleet.at_ms,
        size=len(body),
        sha256=sha.hexdigest(),
    )
    return msgspec.json.encode(head) + b"\n" + body


def _pieces(fleet: Fleet) -> Iterator[bytes]:
    """The same bytes as encoding all at once, which would keep every other thread waiting."""
    before = b"{"
    for name in fleet.__struct_fields__:
        yield before + b'"' + name.encode() + b'":'
        value = getattr(fleet, name)
        if isinstance(value, dict) and value:
            entries = iter(value.items())
            before = b"{"
            while some := dict(islice(entries, PIECE_ENTRIES)):
                yield before + msgspec.json.encode(some)[1:-1]
                before = b","
            yield b"}"
        else:
            yield msgspec.json.encode(value)
        before = b","
    yield b"}"


def head_of(line: bytes) -> Head:
    """Read a head; raises Unusable."""
    try:
        head = msgspec.json.decode(line, type=Head)
    except msgspec.MsgspecError as error:
        raise Unusable(f"its first line is not a head: {error}") from error
    if head.format != FORMAT:
        raise Unusable(f"its format is {head.format}")
    return head


def check(raw: bytes) -> tuple[Head, bytes]:
    """Check size and hash; gives head and body, or raises Unusable."""
    line, _, body = raw.partition(b"\n")
    head = head_of(line)
    if len(body) != head.size or hashlib.sha256(body).hexdigest() != head.sha256:
        raise Unusable("its checksum is wrong")
    return head, body


def load(path: Path) -> Fleet:
    """Read a snapshot; raises Unusable, for another version's too."""
    try:
        head, body = check(path.read_bytes())
    except OSError as error:
        raise Unusable(str(error)) from error
    if (head.state_version, head.shape) != (STATE_VERSION, shape()):
        raise Unusable(f"its state has version {head.state_version} and shape {head.shape}")
    try:
        fleet = msgspec.json.decode(body, type=Fleet)
    except msgspec.MsgspecError as error:
        raise Unusable(f"its state cannot be read: {error}") from error
    if (fleet.position, fleet.at_ms) != (head.position, head.at_ms):
        raise Unusable("its head is of another state")
    return fleet


def snapshot_paths(directory: Path) -> list[Path]:
    """All snapshots whose name is a position, in order of position."""
    found = (path for path in directory.glob(f"*{SUFFIX}") if path.stem.isdigit())
    return sorted(found, key=lambda path: int(path.stem))


def save(
    directory: Path,
    fleet: Fleet,
    kept_max: int = KEPT_MAX,
    disk: Disk | None = None,
    give_way: GiveWay = at_once,
) -> Path:
    """Keep the state; hand over a copy whose position is on disk, from any thread.

    Beyond `kept_max` the snapshot goes whose absence leaves the smallest gap between its
    neighbours; the newest always stays. So moments long past stay cheap too.
    """
    disk = disk or Disk()
    disk.make_folder(directory)
    path = directory / f"{fleet.position:020}{SUFFIX}"
    if path.exists():
        return path
    for draft in directory.glob(f"*{DRAFT}"):  # of whom a crash or a full disk stopped
        disk.remove(draft)
    disk.close(write_file(disk, path, to_bytes(fleet, give_way)))
    _thin(disk, directory, kept_max)
    return path


def _thin(disk: Disk, directory: Path, kept_max: int) -> None:
    paths = snapshot_paths(directory)
    while len(paths) > kept_max:
        positions = [0, *(int(path.stem) for path in paths)]
        gaps = [
            positions[n + 2] - positions[n] for n in range(len(paths) - 1)
        ]  # left by taking away paths[n]
        disk.remove(paths.pop(gaps.index(min(gaps)) if gaps else 0))


def _head(path: Path) -> Head | None:
    try:
        with path.open("rb") as file:
            return head_of(file.readline(HEAD_BYTES_MAX))
    except (OSError, Unusable) as error:
        log.warning("snapshot passed over", snapshot=path.name, why=str(error))
        return None


def nearest(directory: Path, position: int | None = None, at_ms: int | None = None) -> Fleet:
    """Newest usable snapshot at or before a moment; an empty fleet if there is none."""
    for path in reversed(snapshot_paths(directory)):
        if position is not None and int(path.stem) > position:
            continue
        if at_ms is not None:
            head = _head(path)
            if head is None or head.at_ms > at_ms:
                continue
        try:
            return load(path)
        except Unusable as error:
            log.warning("snapshot passed over", snapshot=path.name, why=str(error))
    return Fleet()


def restore(
    ledger_dir: Path,
    snapshots_dir: Path,
    *,
    position: int | None = None,
    at_ms: int | None = None,
    read: Read | None = None,
) -> Fleet:
    """State right after a position, or after all events up to an instant; the newest if neither.

    Where the ledger is open in this process, hand over its `read`: it shows only what is durable.
    Otherwise the files are read as they are. A moment after the newest event gives the newest
    state; instants rely on event times never going back.
    """
    return restore_from(read or _reader(ledger_dir), snapshots_dir, position=position, at_ms=at_ms)


def _reader(ledger_dir: Path) -> Read:
    def read(after: int, until: int | None) -> Iterator[AnyEvent]:
        return read_folder(ledger_dir, after, until)

    return read


def restore_from(
    read: Read, snapshots_dir: Path, *, position: int | None = None, at_ms: int | None = None
) -> Fleet:
    """As `restore`, for events from anywhere."""
    fleet = nearest(snapshots_dir, position, at_ms)
    if fleet.position and next(read(fleet.position - 1, fleet.position), None) is None:
        why = "the ledger ends before it"
        log.error("snapshots passed over", position=fleet.position, why=why)
        fleet = Fleet()
    for event in read(fleet.position, position):
        if at_ms is not None and event.at_ms > at_ms:
            break
        evolve(fleet, event)
    return fleet


class Snapshotter:
    """Says when the next snapshot is due; the owner of the fleet saves a copy where it likes."""

    def __init__(
        self, directory: Path, events_apart: int = EVENTS_APART, disk: Disk | None = None
    ) -> None:
        """Go on from the snapshots that are there."""
        self._directory = directory
        self._disk = disk
        self._apart = events_apart
        paths = snapshot_paths(directory)
        self._newest = int(paths[-1].stem) if paths else 0
        self._live = 0  # orders in the newest one

    def due(self, position: int) -> bool:
        """Whether enough has happened since the newest one: no less than saving costs.

        Saving is work for every live order, so the more there are the further apart.
        """
        return position - self._newest >= max(self._apart, 2 * self._live)

    def keep(self, fleet: Fleet, give_way: GiveWay = at_once) -> None:
        """Save it, or go without where the disk does not take it: the next is due as any other."""
        try:
            self.save(fleet, give_way)
        except OSError as trouble:
            log.warning("snapshot not written", position=fleet.position, reason=str(trouble))

    def save(self, fleet: Fleet, give_way: GiveWay = at_once) -> Path:
        """Save a copied fleet whose position is durable; call it off the thread that answers."""
        self._newest = max(self._newest, fleet.position)
        self._live = len(fleet.orders)
        return save(self._directory, fleet, disk=self._disk, give_way=give_way)
