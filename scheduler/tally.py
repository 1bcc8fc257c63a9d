"""Sums up who has waited for whom, how long and where, for the ledger: moments would be too much.

The telemetry log has every moment for days; the ledger has these sums for ever. They are lost from
the last ones on when the scheduler ends, which costs minutes of a statistic.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TypeAlias

import msgspec

from ledger.ids import PointName, RobotName, SceneId
from ledger.proposals import NoteWaits
from ledger.waits import Counts, CycleSeen, Wait, WaitReason, WaitSum, cycles

STRETCH_MS = 600_000  # one event of a scene in so long
SUMS_MAX = 200  # in one event: 20 kB
SUM_MS_MIN = 2_000  # shorter ones are left out
KEYS_MAX = 20_000  # told apart in one stretch
CYCLE_MS_MIN = 3_000  # robots that wait for each other for less are about to be pushed aside
CYCLES_MAX = 50  # in one event
LADDER = "Ladder:"  # before the words of what was done for who was stuck
BREACHES = "Breaches"
PUSHES = "Pushes"  # counted beside plannings, whose words are those of `traffic.waits.Due`

_Key: TypeAlias = tuple[RobotName, WaitReason, tuple[RobotName, ...], PointName | None]


class _Sum(msgspec.Struct):
    times: int = 0
    total_ms: int = 0
    longest_ms: int = 0


class _Ring(msgspec.Struct):
    since_ms: int
    counted: bool = False


class Tally:
    """What the robots of one scene have waited for since the last sums were taken away."""

    def __init__(self, now_ms: int) -> None:
        """Begin with nothing."""
        self._from_ms = now_ms
        self._sums: dict[_Key, _Sum] = {}
        self._open: dict[RobotName, tuple[_Key, int, int]] = {}  # what, since when, summed until
        self._rings: dict[tuple[RobotName, ...], _Ring] = {}
        self._seen: list[CycleSeen] = []
        self._rest_ms = 0
        self._cycles = 0
        self._known: dict[str, int] = {}  # as traffic counted last
        self._counted: Counter[str] = Counter()  # since the beginning
        self._noted: Counter[str] = Counter()  # when sums were last taken away

    def take(self, waits: Iterable[Wait], now_ms: int) -> None:
        """Take in who waits now; until the next call it counts as going on."""
        found = {wait.robot: wait for wait in waits}
        before, self._open = self._open, {}
        for robot, wait in found.items():
            key = (robot, wait.reason, wait.blockers, wait.place)
            known = before.get(robot)
            goes_on = known is not None and known[0] == key
            if known is not None and goes_on:
                _, since_ms, until_ms = known
            else:  # whoever waits has stood for a little before it was said
                since_ms = now_ms if known is not None else min(wait.since_ms, now_ms)
                since_ms = until_ms = max(since_ms, self._from_ms)
            self._open[robot] = key, since_ms, now_ms
            self._add(key, since_ms, until_ms, now_ms, goes_on=goes_on)
        self._take_rings(cycles({robot: wait.awaited for robot, wait in found.items()}), now_ms)

    def _add(self, key: _Key, since_ms: int, until_ms: int, now_ms: int, *, goes_on: bool) -> None:
        found = self._sums.get(key)
        if found is None:
            if len(self._sums) >= KEYS_MAX:
                self._rest_ms += now_ms - until_ms
                return
            found = self._sums[key] = _Sum()
        found.times += not goes_on or not found.times
        found.total_ms += now_ms - until_ms
        found.longest_ms = max(found.longest_ms, now_ms - since_ms)

    def _take_rings(self, found: list[tuple[RobotName, ...]], now_ms: int) -> None:
        before, self._rings = self._rings, {}
        for robots in found:
            ring = self._rings[robots] = before.pop(robots, _Ring(since_ms=now_ms))
            if not ring.counted and now_ms - ring.since_ms >= CYCLE_MS_MIN:
                ring.counted = True
                self._cycles += 1
        for robots, ring in before.items():
            if ring.counted and len(self._seen) < CYCLES_MAX:
                seen = CycleSeen(robots=robots, from_ms=ring.since_ms, until_ms=now_ms)
                self._seen.append(seen)

    def count(
        self,
        pushes: int,
        plannings: Mapping[str, int],
        ladder: Mapping[str, int] | None = None,
        breaches: int = 0,
    ) -> None:
        """Take in what traffic has counted since it was made, which may have been just now."""
        now = {**plannings, PUSHES: pushes, BREACHES: breaches}
        now |= {f"{LADDER}{word}": number for word, number in (ladder or {}).items()}
        for word, number in now.items():
            known = self._known.get(word, 0)
            self._counted[word] += number - known if number >= known else number
        self._known = now

    def counts(self, scene: SceneId, now_ms: int) -> Counts:
        """What has been counted since the beginning."""
        words = sorted(self._counted.items())
        return Counts(
            scene=scene,
            at_ms=now_ms,
            plannings=_plannings(self._counted),
            pushes=self._counted[PUSHES],
            cycles=self._cycles,
            breaches=self._counted[BREACHES],
            ladder={word.removeprefix(LADDER): n for word, n in words if word.startswith(LADDER)},
        )

    def due(self, scene: SceneId, now_ms: int) -> NoteWaits | None:
        """Take the sums away, if it is time; a stretch in which nobody waited leaves no trace."""
        if now_ms - self._from_ms < STRETCH_MS:
            return None
        from_ms, self._from_ms = self._from_ms, now_ms
        sums, self._sums = self._sums, {}
        seen, self._seen = self._seen, []
        rest_ms, self._rest_ms = self._rest_ms, 0
        more = self._counted - self._noted
        self._noted = self._counted.copy()
        if not sums:
            return None
        kept = sorted(sums.items(), key=lambda item: (-item[1].total_ms, item[0][0], str(item[0])))
        kept = [item for item in kept[:SUMS_MAX] if item[1].total_ms >= SUM_MS_MIN]
        all_ms = sum(found.total_ms for found in sums.values())
        lasting = (
            CycleSeen(robots=robots, from_ms=ring.since_ms)
            for robots, ring in self._rings.items()
            if ring.counted
        )
        return NoteWaits(
            scene=scene,
            from_ms=from_ms,
            waits=tuple(_sum(*item) for item in kept),
            left_out_ms=rest_ms + all_ms - sum(found.total_ms for _, found in kept),
            cycles=(*seen, *lasting)[:CYCLES_MAX],
            pushes=more[PUSHES],
            plannings=_plannings(more),
        )


def _plannings(counted: Counter[str]) -> dict[str, int]:
    others = {word for word in counted if word in (PUSHES, BREACHES) or word.startswith(LADDER)}
    return {word: n for word, n in sorted(counted.items()) if word not in others}


def _sum(key: _Key, found: _Sum) -> WaitSum:
    robot, reason, blockers, place = key
    return WaitSum(
        robot=robot,
        reason=reason,
        blockers=blockers,
        place=place,
        times=found.times,
        total_ms=found.total_ms,
        longest_ms=found.longest_ms,
    )
