"""Reaching again for robots that do not answer: so often in a row, then a person must ask.

The count is remembered here only: a new scheduler counts from nothing, which only delays.
"""

import msgspec

from ledger.ids import RobotKey, robot_key
from ledger.link import Reconnect
from ledger.proposals import GiveUpRobot
from ledger.scene_config import SceneConfig
from ledger.state import Robot
from scheduler.observe import lost_after_ms

FIRST_MS = 2_000  # who has just gone may be on its way back


class _Attempts(msgspec.Struct):
    made: int = 0
    next_ms: int = 0
    asked: bool = False  # for: then at least one is made, whatever the setting


class Reconnects:
    """The attempts made for each robot since it was last heard, or since somebody asked."""

    def __init__(self) -> None:
        self._attempts: dict[RobotKey, _Attempts] = {}

    def ask(self, key: RobotKey) -> None:
        """Somebody asks for it: begin anew, and at once."""
        self._attempts[key] = _Attempts(asked=True)

    def due(self, robot: Robot, config: SceneConfig, now_ms: int) -> Reconnect | GiveUpRobot | None:
        """Give what to tell the robot, or to propose, now; nothing while it is not missed."""
        missed = not (robot.online or robot.given_up or robot.config.disabled)
        if not missed and not self._attempts:
            return None  # nearly always
        key = robot_key(robot.scene, robot.name)
        if not missed:
            self._attempts.pop(key, None)
            return None
        attempts = self._attempts.setdefault(key, _Attempts(next_ms=now_ms + FIRST_MS))
        if now_ms < attempts.next_ms:
            return None
        if attempts.made >= config.reconnects_max and not attempts.asked:
            return GiveUpRobot(scene=robot.scene, robot=robot.name)
        attempts.made, attempts.asked = attempts.made + 1, False
        attempts.next_ms = now_ms + lost_after_ms(config)
        return Reconnect(robot=robot.name)
