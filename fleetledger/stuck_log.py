"""Tells the log once that a robot cannot get on without a person, and once that it can again."""

from collections.abc import Iterable

import structlog

from ledger.ids import RobotKey, robot_key
from ledger.link import Plan

STUCK_MAX = 10_000  # robots remembered; some of them have been taken away since

log = structlog.get_logger()


class StuckLog:
    """Remembers what the log has been told."""

    def __init__(self) -> None:
        self._told: dict[RobotKey, str] = {}

    def look(self, plans: Iterable[Plan]) -> None:
        """Tell what is new in these plans; robots without one are as they were."""
        for plan in plans:
            key = robot_key(plan.scene, plan.robot)
            text = None if plan.stuck is None else plan.stuck.message
            if text == self._told.get(key):
                continue
            if text is None:
                del self._told[key]
                log.info("robot is no longer stuck", scene=plan.scene, robot=plan.robot)
                continue
            self._told[key] = text
            if len(self._told) > STUCK_MAX:
                del self._told[next(iter(self._told))]
            log.warning("robot is stuck", scene=plan.scene, robot=plan.robot, reason=text)
