"""Whoever follows gets every event once and in order, whatever is lost on the way, and whoever
stalls or starts anew; and is told where the core's history is not the one it followed.

`stage` does it with many more stories than a test run has time for.
"""

import random

import msgspec
import pytest

from fleetledger.shift import Shift
from ledger.bus import EVENTS_AFTER_KEY, EVENTS_KEY, MemoryBus
from ledger.errors import LedgerDiverged
from ledger.events import AnyEvent
from ledger.evolve import fold
from ledger.feed import FeedFollower, FeedServer, Mark, mark_of
from ledger.ids import CommandId
from ledger.state import Fleet
from ledger.store import MemoryLedger
from sim.warehouses import generate
from tests.histories import history
from tests.laws.onlooker import bins_of, load, unload

EVENTS = history(77, 1200)
STEPS = 120
STORIES = 60  # of a test run
SOAK_STORIES = 4_000  # of one stage: some 40 s
SMALL_BUFFER = 4_000  # bytes, so that it overflows


class BadBus(MemoryBus):
    """Loses, doubles, keeps back and shuffles messages, and is sometimes cut."""

    def __init__(self, chance: random.Random) -> None:
        super().__init__()
        self.cut = False
        self._chance = chance
        self._held: list[bytes] = []

    def publish(self, key: str, payload: bytes) -> None:
        assert key == EVENTS_KEY
        if self.cut:
            return
        for _ in range(self._chance.choice((0, 1, 1, 1, 1, 2))):
            if self._chance.random() < 0.2:
                self._held.append(payload)
            else:
                super().publish(key, payload)

    def release(self) -> None:
        """Deliver late, in any order."""
        self._chance.shuffle(self._held)
        for payload in self._held:
            super().publish(EVENTS_KEY, payload)
        self._held.clear()

    def broken(self) -> None:
        """Lose what is under way, as a connection does that ends."""
        self._held.clear()

    def ask(self, key: str, payload: bytes = b"", timeout_s: float = 5.0) -> list[bytes]:
        if self.cut:
            raise TimeoutError("nobody answers")
        answers = super().ask(key, payload, timeout_s)
        if key == EVENTS_AFTER_KEY and len(answers) > 1 and self._chance.random() < 0.2:
            del answers[self._chance.randrange(len(answers))]  # a part of it is lost too
        return answers


class Story:
    """A core and a follower, and what happens to them."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.bus = BadBus(self.chance)
        self.history: list[AnyEvent] = list(EVENTS[: self.chance.randrange(5)])
        self.others: list[list[AnyEvent]] = []  # histories before a backup was restored
        self.start_core()
        self.follower = FeedFollower(self.bus, buffer_bytes=SMALL_BUFFER)
        if self.chance.random() < 0.5:
            self.base = self.follower.start()
        else:
            self.base = Fleet()
            self.follower.start_behind(Mark())
        self.first = self.base.position
        self.got: list[AnyEvent] = []
        self.told = False  # that the histories differ

    def start_core(self) -> None:
        self.ledger = MemoryLedger(self.history)
        self.feed = FeedServer(self.bus, self.ledger, lambda: fold(Fleet(), self.history))

    def happen(self) -> None:
        first = len(self.history)
        few = EVENTS[first : first + self.chance.choice((1, 1, 2, 5, 30))]
        if self.others:  # the life after a backup is another one
            few = [msgspec.structs.replace(e, command=CommandId("again")) for e in few]
        self.history += few
        self.ledger.append(few, first)

    def feed_beats(self) -> None:
        self.feed.beat()

    def listen(self) -> None:
        try:
            self.got += self.follower.drain()
        except TimeoutError:
            pass
        except LedgerDiverged:
            self.told = True

    def look_after(self) -> None:
        try:
            self.follower.catch_up()
        except TimeoutError:
            pass
        except LedgerDiverged:
            self.told = True

    def restart_core(self) -> None:
        """What was published is on disk, so the new one has it."""
        self.bus.broken()
        self.start_core()

    def restart_follower(self) -> None:
        newest = self.got[-1] if self.got else None
        self.follower = FeedFollower(self.bus, buffer_bytes=SMALL_BUFFER)
        mark = Mark(position=self.base.position, at_ms=self.base.at_ms)
        try:
            self.follower.start_behind(mark if newest is None else mark_of(newest))
        except TimeoutError:
            pass
        except LedgerDiverged:
            self.told = True

    def restore_backup(self) -> None:
        if self.others:
            return
        self.others.append(list(self.history))
        del self.history[self.chance.randrange(len(self.history) + 1) :]
        self.restart_core()

    def cut(self) -> None:
        self.bus.cut = not self.bus.cut
        self.bus.broken()

    def whole(self) -> None:
        """Nothing was lost, doubled or mixed."""
        lives = (self.history, *self.others)
        assert any(self.got == h[self.first : self.first + len(self.got)] for h in lives)

    def end(self) -> None:
        """At rest, all is known, or it is known that the histories differ."""
        self.bus.cut = False
        self.bus.release()
        for _ in range(3):
            if not self.told:
                BadBus.broken(self.bus)
                MemoryBus.publish(self.bus, EVENTS_KEY, self._beat())
                self.look_after()
                self.listen()
        self.whole()
        ours = self.base.position + len(self.got)
        same = self.got == self.history[self.first : ours] and self.base.position <= len(
            self.history
        )
        if self.told:
            assert self.others
            return
        assert same
        assert ours == len(self.history)
        state = fold(self.base, self.got)
        assert state.canonical() == fold(Fleet(), self.history).canonical()

    def _beat(self) -> bytes:
        beats: list[bytes] = []
        ear = MemoryBus()
        ear.subscribe(EVENTS_KEY, lambda key, payload: beats.append(payload))
        FeedServer(ear, self.ledger, Fleet).beat()
        return beats[0]


def live(seed: int, *, backups: bool = True) -> Story:
    """One story, to its end; the same each time."""
    story = Story(seed)
    deeds = [story.happen] * 6 + [story.listen] * 4 + [story.bus.release, story.feed_beats]
    deeds += [story.restart_core, story.restart_follower, story.cut, story.look_after]
    for _ in range(STEPS):
        if story.told:
            break
        if backups and story.chance.random() < 0.01:
            story.restore_backup()
        story.chance.choice(deeds)()
        story.whole()
    story.end()
    return story


@pytest.mark.parametrize("backups", [False, True])
def test_nothing_is_lost_doubled_or_mixed(backups: bool) -> None:
    told = sum(live(seed, backups=backups).told for seed in range(STORIES))
    assert (told > STORIES // 10) is backups


class Switch(MemoryBus):
    """Can be turned off for the feed alone."""

    off = False

    def publish(self, key: str, payload: bytes) -> None:
        if not (self.off and key == EVENTS_KEY):
            super().publish(key, payload)

    def ask(self, key: str, payload: bytes = b"", timeout_s: float = 5.0) -> list[bytes]:
        if self.off and key == EVENTS_AFTER_KEY:
            raise TimeoutError("the feed is off")
        return super().ask(key, payload, timeout_s)


def test_the_scheduler_knows_of_nothing_but_by_the_feed() -> None:
    shift = Shift(generate(aisles=2, bays=2, robots=2, seed=1), bus=Switch())
    shift.run(20.0)
    assert isinstance(shift.bus, Switch)
    shift.bus.off = True
    source, target = bins_of(generate(aisles=2, bays=2, robots=2, seed=1))[:2]
    order = shift.order(load(source), unload(target))
    shift.run(10.0)
    assert shift.fleet.orders[order].robot is None
    shift.bus.off = False
    shift.order(load(target), unload(source))  # shows that something was missed
    shift.run(10.0)
    assert shift.fleet.orders[order].robot is not None


def stage(seed: int) -> None:
    """Part of the soak."""
    for number in range(SOAK_STORIES):
        live(seed * SOAK_STORIES + number)
