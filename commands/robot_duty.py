"""Robots at work or not: disabled, off duty, and cleared of left-over loads (spec/m4.md §4)."""

from commands.command import Decision, Events, scene_of
from commands.robot_names import OfRobots, for_each, known_robots
from ledger.events import (
    RobotBinsCleared,
    RobotDisabled,
    RobotEnabled,
    RobotWentOffDuty,
    RobotWentOnDuty,
)
from ledger.state import BinStatus, Fleet, Robot


class DisableRobots(OfRobots, frozen=True, kw_only=True):
    """Take robots out of dispatch, or put them back; all of them, or none."""

    disabled: bool


def disable(fleet: Fleet, command: DisableRobots) -> Decision:
    """Orders stay with a disabled robot until they are withdrawn or cancelled."""
    scene = scene_of(fleet, command.scene)
    event = RobotDisabled if command.disabled else RobotEnabled
    return Decision(
        events=tuple(
            event(scene=scene.id, robot=robot.name)
            for robot in known_robots(fleet, scene, command.robots)
            if robot.config.disabled is not command.disabled
        )
    )


class SendRobotsOffDuty(OfRobots, frozen=True, kw_only=True):
    """Let robots take no more orders, or let them take some again; each on its own."""

    off_duty: bool


def send_off_duty(fleet: Fleet, command: SendRobotsOffDuty) -> Decision:
    """True = takes no orders (spec/m4.md, C1); it finishes those it has."""
    event = RobotWentOffDuty if command.off_duty else RobotWentOnDuty

    def one(robot: Robot) -> Events:
        if robot.off_duty is command.off_duty:
            return ()
        return (event(scene=robot.scene, robot=robot.name),)

    return for_each(fleet, command, one)


class ClearRobotBins(OfRobots, frozen=True, kw_only=True):
    """State that left-over loads of cancelled orders were taken off by hand; each on its own."""


def clear_bins(fleet: Fleet, command: ClearRobotBins) -> Decision:
    """Only what a cancelled order left behind goes; a live order's load stays on the books."""

    def one(robot: Robot) -> Events:
        if all(content.status is not BinStatus.CANCELLED for content in robot.bins):
            return ()
        return (RobotBinsCleared(scene=robot.scene, robot=robot.name),)

    return for_each(fleet, command, one)
