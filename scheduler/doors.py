"""The doors of one scene: which are open, which must be, and what they are told.

A door is told to be open every second for as long as a robot or a person wants it, under one
number for the whole of that time. Only its report that it is open under this number lets robots
in: one that was open by chance may be about to close. Nobody wants it any more: it is not told any
more, and closes by itself. After our start a door that is found open is kept open until all robots
have been placed, for one may be in it.
"""

from collections.abc import Mapping

from ledger.ids import RobotName
from ledger.link import DoorReport, DoorState, DoorStatus, TellDoor
from ledger.scene import Door, Scene, Value
from scheduler.traffic.doors import DoorNow

FRESH_MS = 3_000  # a door that has not been heard for so long may be anything
TELL_MS = 1_000
OPENED_ONCE_MS = 10_000  # how long a door stays wanted that somebody had open once


class Heard(Value, frozen=True, kw_only=True):
    """A report, and when it came in by our clock."""

    report: DoorReport
    at_ms: int


class _Want(Value, frozen=True, kw_only=True):
    """Wanted open without a break since this number was given out."""

    number: int
    robots: tuple[RobotName, ...]
    told_ms: int


class DoorDesk:
    """Keeps the doors; whom they are for is said by traffic, pass by pass."""

    def __init__(self) -> None:
        self._heard: dict[int, Heard] = {}
        self._wants: dict[int, _Want] = {}
        self._numbers = 0  # given out
        self._close: set[int] = set()  # asked for by somebody

    def hear(self, report: DoorReport, now_ms: int) -> None:
        """Take in what a door says."""
        known = self._heard.get(report.door)
        if known is None or report.at_ms >= known.report.at_ms:
            self._heard[report.door] = Heard(report=report, at_ms=now_ms)

    def heard(self, door: int) -> Heard | None:
        """Give the newest report of a door."""
        return self._heard.get(door)

    def close(self, door: int) -> None:
        """Somebody wants it closed: it is told so once, as soon as nobody wants it open."""
        self._close.add(door)

    def now(self, scene: Scene, broken: Mapping[int, str], now_ms: int) -> dict[int, DoorNow]:
        """Say of each door what traffic may do; `broken` are those that do not work, and why."""
        return {door.id: self._now(door, broken, now_ms) for door in scene.doors}

    def _now(self, door: Door, broken: Mapping[int, str], now_ms: int) -> DoorNow:
        heard, want = self._heard.get(door.id), self._wants.get(door.id)
        works = not door.disabled and door.id not in broken
        if heard is None or now_ms - heard.at_ms > FRESH_MS:
            return DoorNow(works=works)
        is_open = heard.report.status is DoorStatus.OPENED
        promised = want is not None and heard.report.obeyed == want.number
        return DoorNow(
            enter=is_open and promised and works and heard.report.fault is None,
            leave=is_open,
            works=works,
        )

    def want(
        self,
        scene: Scene,
        robots: Mapping[int, tuple[RobotName, ...]],
        settled: frozenset[int],
        now_ms: int,
    ) -> list[TellDoor]:
        """Say what doors are to be told; `settled` are the areas whose robots are all placed."""
        told: list[TellDoor] = []
        for door in scene.doors:
            message = self._want(scene, door, robots.get(door.id, ()), settled, now_ms)
            if message is not None:
                told.append(message)
        known = {door.id for door in scene.doors}
        for gone in self._heard.keys() - known:
            del self._heard[gone]
        for gone in self._wants.keys() - known:
            del self._wants[gone]
        self._close &= known
        return told

    def _want(
        self,
        scene: Scene,
        door: Door,
        robots: tuple[RobotName, ...],
        settled: frozenset[int],
        now_ms: int,
    ) -> TellDoor | None:
        want = self._wants.get(door.id)
        by_people = not door.disabled and _is_asked_for(scene, door, now_ms)
        if not (robots or by_people or (door.area not in settled and self._is_open(door))):
            self._wants.pop(door.id, None)
            if door.id not in self._close:
                return None
            self._close.discard(door.id)
            return TellDoor(door=door.id, open=False)
        if want is not None and want.robots == robots and now_ms - want.told_ms < TELL_MS:
            return None
        if want is None:
            self._numbers = max(self._numbers + 1, now_ms)  # above those of a scheduler before us
        number = self._numbers if want is None else want.number
        self._close.discard(door.id)
        self._wants[door.id] = _Want(number=number, robots=robots, told_ms=now_ms)
        return TellDoor(door=door.id, open=True, number=number, robots=robots)

    def _is_open(self, door: Door) -> bool:
        heard = self._heard.get(door.id)
        return heard is not None and heard.report.status is not DoorStatus.CLOSED

    def states(self) -> list[DoorState]:
        """Say for whom each door is open or opening, the wanted ones only."""
        return [
            DoorState(door=door, robots=want.robots) for door, want in sorted(self._wants.items())
        ]


def _is_asked_for(scene: Scene, door: Door, now_ms: int) -> bool:
    opened_ms = scene.opened_doors.get(door.id)
    once = opened_ms is not None and now_ms - opened_ms < OPENED_ONCE_MS
    return once or door.id in scene.held_doors
