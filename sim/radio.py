"""The air between robots and fleet: reports get lost, come twice, or come after newer ones."""

import random
from collections.abc import Container

from ledger.ids import RobotKey, robot_key
from ledger.link import Report
from sim.faults import FaultMix

LATE_MAX = 1_000  # reports on their way; more are lost


class Radio:
    """Passes reports on, round by round."""

    def __init__(self, rng: random.Random, mix: FaultMix) -> None:
        self._rng = rng
        self._lost = mix.lost_ratio
        self._repeated = self._lost + mix.repeated_ratio
        self._reordered = self._repeated + mix.reordered_ratio
        self._late: list[Report] = []

    def pass_on(self, reports: list[Report], moved: Container[RobotKey]) -> list[Report]:
        """Give what arrives of these, and behind them what is late of the round before.

        Of a robot that people have moved all arrives: nobody but they keep others off it until the
        fleet knows where it is, and how they do that is not what is tried here.
        """
        arriving, late = [], self._late
        self._late = []
        for report in reports:
            key = robot_key(report.scene, report.robot)
            chance = 1.0 if key in moved else self._rng.random()
            if chance < self._lost:
                continue
            if chance >= self._repeated and chance < self._reordered:
                self._late.append(report)
                continue
            arriving.append(report)
            if chance < self._repeated:
                self._late.append(report)
        del self._late[LATE_MAX:]
        return arriving + late
