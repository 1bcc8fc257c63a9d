"""From the batches of a telemetry file back to reports and plans: followed forwards, one by one.

A batch that is missing, for its chunk is damaged, costs what was stated by steps from it until each
robot is next stated whole; nothing wrong is ever given.
"""

from operator import add
from typing import Generic, Protocol, TypeVar

import msgspec

from ledger.ids import PointName, RobotName
from ledger.link import Plan, Report, Space
from ledger.telemetry_format import Head, Moved, PlanBatch, ReportBatch
from ledger.telemetry_motion import AT, Numbers, moved, numbers

Item = TypeVar("Item", Report, Plan)


class Fold(Protocol, Generic[Item]):
    """What `telemetry_read` follows batches with."""

    def feed(self, batch: Head, until_ms: int) -> list[RobotName]:
        """Take one batch in, nothing later than a moment; give the robots it told of."""

    def at_ms(self, robot: RobotName) -> int:
        """Tell when a robot was last told of."""

    def item(self, robot: RobotName) -> Item:
        """Give the newest of a robot."""

    def newest(self) -> dict[RobotName, Item]:
        """Give the newest of all."""


class ReportFold:
    """Reports."""

    def __init__(self) -> None:
        """Know nothing."""
        self._stated: dict[RobotName, Report] = {}
        self._motion: dict[RobotName, Numbers] = {}  # without, steps lead nowhere
        self._point: dict[RobotName, PointName | None] = {}
        self._stepped: set[RobotName] = set()  # since they were stated
        self._last = (0, 0)  # when it was whole, batches since

    def feed(self, batch: Head, until_ms: int) -> list[RobotName]:
        """Take one batch in, nothing later than a moment; give the robots it told of."""
        assert isinstance(batch, ReportBatch)
        whole_ms, since = self._last
        self._last = (batch.whole_ms, batch.since)
        if not batch.whole and self._last != (whole_ms, since + 1):
            self._settle()
        told = []
        for report in batch.items:
            if report.at_ms <= until_ms and self._is_new(report):
                self._state(report)
                told.append(report.robot)
            else:
                self._leave(report.robot)
        if batch.moved is not None:
            told += self._step(batch.moved, until_ms)
        return told

    def _is_new(self, report: Report) -> bool:
        known = self._stated.get(report.robot)
        return known is None or self.at_ms(report.robot) <= report.at_ms

    def _state(self, report: Report) -> None:
        robot = report.robot
        self._stated[robot] = report
        self._stepped.discard(robot)
        motion = numbers(report)
        if motion is None:
            self._motion.pop(robot, None)
        else:
            self._motion[robot] = motion
            self._point[robot] = report.point

    def _settle(self) -> None:
        """Keep what is known, for a batch is missing: no step can be counted from it."""
        for robot in tuple(self._motion):
            self._leave(robot)

    def _leave(self, robot: RobotName) -> None:
        """Follow no more steps of a robot until it is stated whole."""
        if robot in self._stepped:
            self._stated[robot] = self.item(robot)
            self._stepped.discard(robot)
        self._motion.pop(robot, None)

    def _step(self, columns: Moved, until_ms: int) -> list[RobotName]:
        told = []
        steps = zip(*columns.steps, strict=True)
        for robot, step, point in zip(columns.robots, steps, columns.points, strict=True):
            last = self._motion.get(robot)
            if last is None:
                continue
            motion = tuple(map(add, last, step))
            if motion[AT] > until_ms:
                self._leave(robot)  # what follows is later still
                continue
            self._motion[robot], self._point[robot] = motion, point
            self._stepped.add(robot)
            told.append(robot)
        return told

    def at_ms(self, robot: RobotName) -> int:
        """Tell when a robot was last told of."""
        if robot in self._stepped:
            return self._motion[robot][AT]
        return self._stated[robot].at_ms

    def item(self, robot: RobotName) -> Report:
        """Give the newest of a robot."""
        stated = self._stated[robot]
        if robot not in self._stepped:
            return stated
        return moved(stated, self._motion[robot], self._point[robot])

    def newest(self) -> dict[RobotName, Report]:
        """Give the newest of all."""
        return {robot: self.item(robot) for robot in self._stated}


class PlanFold:
    """Plans."""

    def __init__(self) -> None:
        """Know nothing."""
        self._plans: dict[RobotName, Plan] = {}
        self._spaces: dict[int, Space] = {}
        self._whole_ms = 0

    def feed(self, batch: Head, until_ms: int) -> list[RobotName]:
        """Take one batch in, nothing later than a moment; give the robots it told of."""
        assert isinstance(batch, PlanBatch)
        if batch.whole or batch.whole_ms != self._whole_ms:
            self._spaces.clear()
            self._whole_ms = batch.whole_ms
        self._spaces.update(enumerate(batch.spaces, start=batch.first_space))
        told = []
        for number, plan in enumerate(batch.items):
            known = self._plans.get(plan.robot)
            if plan.at_ms > until_ms or (known is not None and known.at_ms > plan.at_ms):
                continue
            if batch.held:
                spaces = [self._spaces.get(space) for space in batch.held[number]]
                if None in spaces:
                    continue  # stated in a batch that is missing
                plan = msgspec.structs.replace(plan, spaces=tuple(spaces))
            self._plans[plan.robot] = plan
            told.append(plan.robot)
        return told

    def at_ms(self, robot: RobotName) -> int:
        """Tell when a robot was last told of."""
        return self._plans[robot].at_ms

    def item(self, robot: RobotName) -> Plan:
        """Give the newest of a robot."""
        return self._plans[robot]

    def newest(self) -> dict[RobotName, Plan]:
        """Give the newest of all."""
        return dict(self._plans)
