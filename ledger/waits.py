"""Who waits for whom: one wait of one robot, as traffic names it and everybody else shows it."""

from enum import StrEnum

from ledger.ids import PointName, RobotName
from ledger.scene import Value


class WaitReason(StrEnum):
    """Why a robot stands although it has somewhere to go."""

    # for others
    BEHIND_ROBOT = "BehindRobot"  # its next ground is another's, or another's turn comes before
    GOAL_BUSY = "GoalBusy"  # somebody stands on its goal who cannot be sent away
    ROBOT_FIXED = "RobotFixed"  # on its way somebody stands who cannot be sent away
    ROBOT_LOST = "RobotLost"  # on its way somebody stands who does not answer
    POCKET_TOKEN = "PocketToken"  # a dead end has to empty before it may enter
    YIELDING = "Yielding"  # its way is wanted by robots that come first
    PUSHED = "Pushed"  # it has made way, and stands where it was sent
    DOOR = "Door"  # a door is shut, or does not work
    RESERVED_GROUND = "ReservedGround"  # ground is reserved for somebody else
    # for nobody else
    NO_WAY = "NoWay"  # the map has no way to its goal
    NOT_ANSWERING = "NotAnswering"  # it is lost itself
    NOT_PLACED = "NotPlaced"  # it stands where traffic cannot move it
    STOPPED = "Stopped"  # by a person, its own guard, or whoever holds control of it
    LATE = "Late"  # it has been granted ground, and does not drive


class Wait(Value, frozen=True, kw_only=True):
    """One robot that waits. Blockers are named as in `link.Plan.blocked_by`: robots, and after
    EXTERNAL the owner of reserved ground, after DOOR the name of a door; empty = nobody else.
    """

    robot: RobotName
    since_ms: int  # it has stood from then on, for whatever reasons
    reason: WaitReason
    blockers: tuple[RobotName, ...] = ()
    place: PointName | None = None  # the point that it cannot get to next
