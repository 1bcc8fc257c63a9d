"""What operators have told a robot and it has not yet done: it is told until it says so."""

import msgspec

from ledger.ids import RobotKey, robot_key
from ledger.link import ONCE, Instruct, Report
from ledger.state import Robot

ONCE_MS_MAX = 60_000  # what is meant for the moment is not carried out after so long
TELL_EVERY_MS = 1_000


def due(robot: Robot, report: Report | None, now_ms: int) -> Instruct | None:
    """Give what its newest report has not confirmed; nothing for a robot that is not heard.

    It follows from the ledger and the report alone, so no restart of anyone loses any of it.
    """
    if report is None or not robot.online or not robot.instructions:
        return None
    left = tuple(
        instruction
        for instruction in robot.instructions
        if instruction.number > report.obeyed
        and not (instruction.kind in ONCE and now_ms - instruction.at_ms > ONCE_MS_MAX)
    )
    return Instruct(robot=robot.name, instructions=left) if left else None


class _Told(msgspec.Struct, frozen=True):
    number: int  # the last one
    at_ms: int


class Telling:
    """Remembers what was told when: news at once, the same again no oftener than every second."""

    def __init__(self) -> None:
        self._told: dict[RobotKey, _Told] = {}

    def to_tell(self, robot: Robot, report: Report | None, now_ms: int) -> Instruct | None:
        """Give the message if it is to be told now."""
        message = due(robot, report, now_ms)
        key = robot_key(robot.scene, robot.name)
        if message is None:
            self._told.pop(key, None)
            return None
        number = message.instructions[-1].number
        told = self._told.get(key)
        if told is not None and told.number == number and now_ms - told.at_ms < TELL_EVERY_MS:
            return None
        self._told[key] = _Told(number, now_ms)
        return message
