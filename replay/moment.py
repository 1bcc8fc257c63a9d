"""Any past state of the fleet: the nearest snapshot, or a moment looked at before, and the fold."""

from bisect import bisect_right
from functools import partial
from pathlib import Path
from threading import Lock

from ledger.errors import Refused
from ledger.evolve import evolve
from ledger.moment import At
from ledger.scan import read_folder
from ledger.scene import Value
from ledger.snapshot import EVENTS_APART, Read, restore_from
from ledger.state import Fleet

KEPT_MAX = 16  # states kept for those who drag a slider

__all__ = ["At", "Moments"]


class _Kept(Value, frozen=True, kw_only=True):
    """A state, and how long it lasted."""

    fleet: Fleet
    next_ms: int | None  # when the next event came; None = not known, or none came yet


class Moments:
    """Gives the fleet as it was. Thread-safe; the states it gives are shared, only to be read."""

    def __init__(self, data: Path, *, read: Read | None = None, kept_max: int = KEPT_MAX) -> None:
        """Take the data folder; where the ledger is open in this process, hand over its `read`,
        which shows only what is on disk.
        """
        self.read: Read = read or partial(read_folder, data / "ledger")
        self._snapshots = data / "snapshots"
        self._kept_max = kept_max
        self._lock = Lock()
        self._kept: dict[int, _Kept] = {}  # by position, least recently used first

    def fleet(self, at: At) -> Fleet:
        """Give the state at a moment; raises Refused for a position that is not there yet."""
        with self._lock:
            kept = self._found(at) or self._folded(at)
            position = kept.fleet.position
            if at.position is not None and position < at.position:
                words = f"{at.position} is not written yet, the newest is {position}."
                raise Refused("errFieldInvalid", f"Field 'position' is wrong: {words}", "position")
            self._kept.pop(position, None)
            self._kept[position] = kept
            while len(self._kept) > self._kept_max:
                del self._kept[next(iter(self._kept))]
            return kept.fleet

    def _found(self, at: At) -> _Kept | None:
        for kept in self._kept.values():
            if at.position is not None and kept.fleet.position == at.position:
                return kept
            if at.at_ms is None or kept.next_ms is None:
                continue
            if kept.fleet.at_ms <= at.at_ms < kept.next_ms:
                return kept
        return None

    def _folded(self, at: At) -> _Kept:
        before = self._before(at)
        if before is not None:
            kept = self._continued(before.fleet.copy(), at, EVENTS_APART)
            if kept is not None:
                return kept
        # the search for the next event, which ends the state's time, costs one event more
        fleet = restore_from(self.read, self._snapshots, position=at.position, at_ms=at.at_ms)
        return self._continued(fleet, at, None) or _Kept(fleet=fleet, next_ms=None)

    def _before(self, at: At) -> _Kept | None:
        """Find the kept state from which the moment is reached soonest."""
        known = sorted(self._kept.values(), key=lambda kept: kept.fleet.position)
        if at.position is not None:
            place = bisect_right(known, at.position, key=lambda kept: kept.fleet.position)
        elif at.at_ms is not None:
            place = bisect_right(known, at.at_ms, key=lambda kept: kept.fleet.at_ms)
        else:
            place = len(known)
        return known[place - 1] if place else None

    def _continued(self, fleet: Fleet, at: At, events_max: int | None) -> _Kept | None:
        """Fold on up to the moment; None if that is farther than a snapshot would be."""
        start = fleet.position
        for event in self.read(start, at.position):
            if at.at_ms is not None and event.at_ms > at.at_ms:
                return _Kept(fleet=fleet, next_ms=event.at_ms)
            if events_max is not None and event.position - start > events_max:
                return None
            evolve(fleet, event)
        return _Kept(fleet=fleet, next_ms=None)
