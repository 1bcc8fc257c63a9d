"""What a simulated robot does with an operator's instructions."""

from typing import assert_never

from ledger.link import DISPATCHER, Instruct, Instruction, InstructionKind
from sim.robot import SimRobot


def obey(robot: SimRobot, message: Instruct) -> None:
    """Carry out what is new, in ascending order: whatever is told again changes nothing."""
    for instruction in sorted(message.instructions, key=lambda i: i.number):
        if instruction.number > robot.obeyed:
            robot.obeyed = instruction.number
            _obey(robot, instruction)


def _obey(robot: SimRobot, instruction: Instruction) -> None:
    match instruction.kind:
        case InstructionKind.SOFT_STOP:
            robot.soft_stop = instruction.on
        case InstructionKind.PAUSE:
            robot.paused = instruction.on
        case InstructionKind.CONTROL:
            _control(robot, instruction)
        case InstructionKind.CLEAR_ALARMS:
            robot.alarms.clear()  # what persists comes again by itself
        case _:
            assert_never(instruction.kind)


def _control(robot: SimRobot, instruction: Instruction) -> None:
    """Letting go lets go of our own control only; taking it gently disturbs nobody else's."""
    if not instruction.on:
        if robot.controller == DISPATCHER:
            robot.controller = ""
    elif not instruction.gently or not robot.controller:
        robot.controller = DISPATCHER
