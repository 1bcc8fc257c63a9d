"""What is wrong in a ledger's folder: found here, said by the start of a server and by `verify`."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

from ledger import sealed
from ledger.chunks import Flaw, Tally, damage_of
from ledger.errors import LedgerDamaged, LedgerNewer
from ledger.events import AnyEvent
from ledger.measure import Ends, Measured, crc_of, ends_of, measure, measure_sealed, sound_end
from ledger.scan import events_between, sealed_events
from ledger.scene import Value
from ledger.segment import (
    AS_NEWER,
    BEGINNING,
    NO_HASH,
    SUFFIX,
    Trailer,
    first_position,
    header_flaw,
)
from ledger.snapshot import Unusable, check, snapshot_paths

RESTORE = "Stop the server and restore this file from a backup."
MISSING = "Stop the server and restore the missing segment from a backup, or give it back its name."
NAME = "Give it back the name it had, or take it out of the folder if it is a copy."
FOREIGN = "Stop the server and restore this file, or the one before it, from a backup of one time."
BEHIND = (
    "Restore the newest segments from a backup; only to go on from the older history on purpose, "
    "stop the server and delete `snapshots/`."
)
UPDATE = f"{LedgerNewer.hint} If it is none of a newer one: {RESTORE}"
DELETE = "Stop the server and delete this file: snapshots are a cache."
THREADS = 2  # that check the files at start; computing a CRC lets go of Python's lock

Progress = Callable[[int, int], None]  # bytes checked, bytes in all


def unseen(done: int, total: int) -> None:
    """Progress that nobody looks at."""


class Finding(Value, frozen=True, kw_only=True):
    """Something that is not as it was written."""

    path: Path
    offset: int
    position: int | None
    what: str
    advice: str
    damage: bool = True  # False = worth knowing, nothing is lost

    def error(self) -> LedgerDamaged:
        """The same as the refusal to start."""
        return LedgerDamaged(self.path, self.offset, self.what, self.position, self.advice)


class Newest(Value, frozen=True, kw_only=True):
    """The newest segment, counted through."""

    path: Path
    finished: bool
    size: int
    measured: Measured


class Inspection:
    """Goes through a folder's segments in order, and keeps what it finds."""

    def __init__(self, *, thorough: bool) -> None:
        """Thorough = every hash is computed and every event decoded; else right CRCs suffice."""
        self.findings: list[Finding] = []
        self.segments = 0
        self.sealed = 0
        self.chunks = 0
        self.events = 0  # decoded
        self.position = 0
        self.sha256 = NO_HASH
        self.predecessor = NO_HASH  # of the newest segment
        self.last_ns = 0  # log time of the newest event
        self.newest: Newest | None = None  # where it had to be counted through
        self._thorough = thorough
        self._lost = False  # nobody knows where the segment before ended

    @property
    def damage(self) -> Iterator[Finding]:
        """What a server must not start with."""
        return (finding for finding in self.findings if finding.damage)

    def find(
        self, path: Path, offset: int, position: int | None, what: str, advice: str = RESTORE
    ) -> None:
        """Keep a finding."""
        if what.endswith(AS_NEWER):
            advice = UPDATE
        self.findings.append(
            Finding(path=path, offset=offset, position=position, what=what, advice=advice)
        )

    def paths(self, directory: Path) -> list[Path]:
        """All segments in order of position; a name that is none is a finding."""
        paths: list[Path] = []
        for path in sorted(directory.glob(f"*{SUFFIX}")):
            try:
                first_position(path)
                paths.append(path)
            except LedgerDamaged as error:
                self.find(path, 0, None, error.what, NAME)
        return paths

    def folder(self, directory: Path, progress: Progress = unseen, more: int = 0) -> int:
        """Inspect all segments; gives their size. `more` bytes are to be checked after them."""
        paths = self.paths(directory)
        sizes = [path.stat().st_size for path in paths]
        total, done = sum(sizes) + more, 0
        with ThreadPoolExecutor(THREADS) as pool:
            quick: Iterator[Ends | None] = iter(())
            if not self._thorough:
                quick = pool.map(sound_end, paths)
            for path, size in zip(paths, sizes, strict=True):
                self.segment(path, next(quick, None), newest=path is paths[-1])
                done += size
                progress(done, total)
        return done

    def alone(self, path: Path) -> None:
        """Inspect one file, whatever stands before it."""
        self._lost = True
        self.segment(path, None, newest=True)

    def segment(self, path: Path, ends: Ends | None, *, newest: bool) -> None:
        """Inspect one file against those before it; `ends` if its CRCs are known to be right."""
        first = first_position(path)
        self.segments += 1
        self.predecessor = self.sha256
        if not self._lost and first != self.position + 1:
            self._gap(path, first)
        if ends is None:
            ends = self._examine(path, first, newest)
        else:
            self._own(path, ends, first)
            self._follows(path, ends.trailer, first)
        if ends is not None:
            self.position, self.sha256 = ends.trailer.last, ends.trailer.sha256
        self._lost = ends is None

    def _gap(self, path: Path, first: int) -> None:
        if first > self.position:
            what = f"position {self.position + 1} is missing before it"
            self.find(path, 0, self.position + 1, what, MISSING)
        else:
            what = f"position {first} is in the segment before it already"
            self.find(path, 0, first, what, NAME)

    def _own(self, path: Path, ends: Ends, first: int) -> bool:
        """Whether the file has its own name."""
        if ends.trailer.first == first:
            return True
        what = f"its trailer says that it begins at position {ends.trailer.first}"
        self.find(path, ends.data_end - len(ends.trailer.record()), first, what, NAME)
        return False

    def _follows(self, path: Path, trailer: Trailer, first: int) -> None:
        if not self._lost and trailer.predecessor != self.sha256:
            what = "it does not follow the segment before it: the hashes differ"
            self.find(path, 0, first, what, FOREIGN)

    def _examine(self, path: Path, first: int, newest: bool) -> Ends | None:
        """Count through a file and say all that is wrong in it."""
        with path.open("rb") as file:
            if sealed.is_sealed(file):
                return self._examine_sealed(path, file, first, newest)
            ends = ends_of(file)
            file.seek(0)
            data = file.read()
            return self._examine_live(path, data, ends, first, newest, file)

    def _examine_live(
        self,
        path: Path,
        data: bytes,
        ends: Ends | None,
        first: int,
        newest: bool,
        file: BinaryIO,
    ) -> Ends | None:
        end = len(data) if ends is None else ends.data_end - len(ends.trailer.record())
        predecessor = self.sha256 if ends is None else ends.trailer.predecessor
        measured = measure(data, end, first, predecessor)
        position = first + measured.tally.sequence  # where the first flaw is
        header = measured.flaw is not None and measured.flaw.offset == 0
        if ends is not None:
            self._claims(path, file, ends, first, measured)
        elif header or not newest:
            what = header_flaw(data) if header else "it has no trailer, but a successor"
            self.find(path, 0 if header else measured.end, position, what)
        elif measured.flaw is not None:
            self._torn_or_damaged(path, data, measured.flaw, measured, position)
        self.chunks += measured.chunks
        if newest:
            finished = ends is not None
            self.newest = Newest(path=path, finished=finished, size=len(data), measured=measured)
        tally = Tally(last_ns=self.last_ns)  # log times go on from segment to segment
        self._meaning(path, events_between(path, data, len(BEGINNING), measured.end, tally))
        self.last_ns = max(self.last_ns, measured.tally.last_ns)
        if ends is None and newest and not header:
            trailer = Trailer(
                first=first, last=position - 1, predecessor=predecessor, sha256=measured.sha256
            )
            return Ends(trailer=trailer, data_crc=0, data_end=measured.end)
        return ends

    def _examine_sealed(self, path: Path, file: BinaryIO, first: int, newest: bool) -> Ends | None:
        self.sealed += 1
        contents = sealed.read_contents(file)
        if isinstance(contents, Flaw):
            self.find(path, contents.offset, first, contents.what)
            return None
        ends = Ends(
            trailer=contents.trailer, data_crc=contents.data_crc, data_end=contents.data_end
        )
        measured = measure_sealed(file, contents, first)
        self._claims(path, file, ends, first, measured)
        self.chunks += measured.chunks
        if newest:
            size = file.seek(0, 2)
            self.newest = Newest(path=path, finished=True, size=size, measured=measured)
        self._meaning(path, sealed_events(path, file, contents, 0, chunks=measured.chunks))
        self.last_ns = max(self.last_ns, measured.tally.last_ns)
        return ends

    def _claims(
        self, path: Path, file: BinaryIO, ends: Ends, first: int, measured: Measured
    ) -> None:
        """Compare what a finished segment holds with what it says of itself."""
        trailer, named_at = ends.trailer, ends.data_end - len(ends.trailer.record())
        last = first + measured.tally.sequence - 1
        if self._own(path, ends, first):
            if measured.flaw is not None:
                self.find(path, measured.flaw.offset, last + 1, measured.flaw.what)
            elif (trailer.last, trailer.sha256) != (last, measured.sha256):
                self.find(path, named_at, last, "its trailer does not fit its content")
        self._follows(path, trailer, first)
        if measured.flaw is None and crc_of(file, ends.data_end) != ends.data_crc:
            self.find(path, ends.data_end, last, "the CRC of its data section is wrong")

    def _torn_or_damaged(
        self, path: Path, data: bytes, flaw: Flaw, measured: Measured, position: int
    ) -> None:
        damage = damage_of(data, flaw, measured.end, len(data))
        if damage is not None:
            self.find(path, damage.offset, position, damage.what)
            return
        what = "a commit was torn or is being written; it was never acknowledged"
        advice = "Nothing to do: the next start keeps the tail aside and cuts it."
        finding = Finding(
            path=path,
            offset=measured.end,
            position=position,
            what=what,
            advice=advice,
            damage=False,
        )
        self.findings.append(finding)

    def _meaning(self, path: Path, batches: Iterator[list[AnyEvent]]) -> None:
        """Decode every event that can be reached."""
        if not self._thorough:
            return
        try:
            for events in batches:
                self.events += len(events)
        except LedgerDamaged as error:
            self.find(path, error.offset, error.position, error.what)
        except LedgerNewer as error:
            self.find(path, 0, None, str(error), error.hint)

    def snapshots(self, directory: Path) -> None:
        """Look for states after the newest event: then the newest segments are missing.

        A snapshot is made of what is on disk, so the ledger has lost something. A damaged one is
        no reason not to start, for it is a cache; a thorough look names it.
        """
        for path in snapshot_paths(directory):
            if self._thorough or int(path.stem) > self.position:
                self._snapshot(path)

    def _snapshot(self, path: Path) -> None:
        try:
            position = check(path.read_bytes())[0].position
        except Unusable as error:
            if self._thorough:
                self.find(path, 0, int(path.stem), str(error), DELETE)
            return
        if position > self.position:
            what = f"the ledger ends at position {self.position}, but here is the state after it"
            self.find(path, 0, position, what, BEHIND)
