"""Strikes robots with what a fault mix says, each with one trouble at a time, and ends it again."""

import random
from collections.abc import Callable, Mapping

from ledger.ids import RobotKey
from ledger.link import DISPATCHER
from sim.faults import FaultMix
from sim.people import Hand, can_be_moved, push
from sim.placement import Ground
from sim.robot import Hears, SimRobot

FROZEN, JUMP, CUT, HAND = "frozen", "jump", "cut", "hand"
BRAKE_S = 1.0  # a robot that is to be taken over is held for as long as it rolls


class Trouble:
    """What one robot suffers, until when."""

    __slots__ = ("end_s", "hand", "kind", "pushed")

    def __init__(self, kind: str, end_s: float) -> None:
        self.kind = kind
        self.end_s = end_s
        self.hand: Hand | None = None  # nobody has got hold of it yet
        self.pushed: tuple[float, float, float] | None = None


class Troubles:
    """Draws its times from a generator of chance: the same calls, the same troubles.

    It has no memory over a restart of the simulator: chance has none, and who was driven by hand
    then stands where it was left and obeys again.
    """

    def __init__(self, rng: random.Random, mix: FaultMix) -> None:
        self._rng = rng
        self._rates = {
            FROZEN: (mix.frozen_per_h, mix.frozen_mean_s),
            JUMP: (mix.jump_per_h, mix.jump_mean_s),
            CUT: (mix.cut_per_h, mix.cut_mean_s),
            HAND: (mix.hand_per_h, mix.hand_mean_s),
        }
        self._due_s: dict[str, float] = {}  # when a kind strikes somebody next
        self._sessions = 0
        self.suffering: dict[RobotKey, Trouble] = {}
        self.struck: dict[str, int] = dict.fromkeys(self._rates, 0)

    def end(self, now_s: float) -> None:
        """Nothing strikes any more, and what has struck ends now."""
        self._rates.clear()
        for trouble in self.suffering.values():
            trouble.end_s = min(trouble.end_s, now_s)

    @property
    def moved(self) -> set[RobotKey]:
        """Robots that people have moved, or are about to."""
        return {key for key, trouble in self.suffering.items() if trouble.kind in (JUMP, HAND)}

    def step(
        self,
        now_s: float,
        dt_s: float,
        robots: Mapping[RobotKey, SimRobot],
        ground: Callable[[SimRobot], Ground],
    ) -> None:
        """Let troubles go on, end and begin."""
        for key in [key for key in self.suffering if key not in robots]:
            del self.suffering[key]
        for key, trouble in list(self.suffering.items()):
            if self._over(trouble, robots[key], now_s, dt_s, robots, ground):
                del self.suffering[key]
        for kind, (per_h, mean_s) in self._rates.items():
            if not per_h or not robots:
                continue
            every_s = 3600.0 / per_h / len(robots)
            due_s = self._due_s.get(kind)
            if due_s is not None and now_s >= due_s:
                self._strike(kind, now_s + self._rng.expovariate(1.0 / mean_s), robots)
            if due_s is None or now_s >= due_s:
                self._due_s[kind] = now_s + self._rng.expovariate(1.0 / every_s)

    def _strike(self, kind: str, end_s: float, robots: Mapping[RobotKey, SimRobot]) -> None:
        key = self._rng.choice(list(robots))
        robot, trouble = robots[key], Trouble(kind, end_s)
        if key in self.suffering or robot.hears is not Hears.ALL:
            return
        if robot.controller != DISPATCHER or (kind == HAND and robot.actions.running):
            return
        if kind == CUT:
            robot.hears = Hears.NOTHING
        elif kind == JUMP:
            trouble.pushed = push(robot, self._rng, self._session(key), robots.values())
            if trouble.pushed is None:
                return
        robot.changed = robot.awake = True
        self.suffering[key] = trouble
        self.struck[kind] += 1

    def _session(self, key: str) -> str:
        self._sessions += 1
        return f"{key}-{self._sessions}-{self._rng.getrandbits(32):08x}"

    def _over(
        self,
        trouble: Trouble,
        robot: SimRobot,
        now_s: float,
        dt_s: float,
        robots: Mapping[RobotKey, SimRobot],
        ground: Callable[[SimRobot], Ground],
    ) -> bool:
        over = now_s >= trouble.end_s
        if trouble.kind == FROZEN:
            robot.held_s = 0.0 if over else max(robot.held_s, dt_s)
            return over
        if trouble.kind == CUT:
            if over:
                robot.hears = Hears.ALL
                robot.changed = robot.awake = True
            return over
        if trouble.kind == JUMP and trouble.hand is None:
            if (robot.x, robot.y, robot.heading) != trouble.pushed or robot.legs:
                return True  # it has helped itself
            if not over:
                return False
        if trouble.hand is None:
            robot.held_s = max(robot.held_s, BRAKE_S)
            if not can_be_moved(robot):
                return False
            robot.held_s = 0.0
            trouble.hand = Hand(robot, self._session(robot.body.name))
        others = robots.values()
        return trouble.hand.step(dt_s, self._rng, ground(robot), others, home=over)
