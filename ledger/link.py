"""What robots report and are told: the one vocabulary that every robot link translates to.

A robot drives a *route*: pieces numbered from 1 for as long as its session lasts, appended to and
never changed. It may move up to its *authority*, a mark on that route, and stops there by itself.
"""

from enum import StrEnum
from typing import TypeAlias

from ledger.ids import OrderId, PathKey, PointName, RobotName, SceneId
from ledger.scene import XY, Value
from ledger.waits import Wait


class Mark(Value, frozen=True, kw_only=True, order=True):
    """A place on a route: `along_m` metres into piece number `piece` (radians, if it is a turn)."""

    piece: int = 0  # 0 = before the first piece
    along_m: float = 0.0


class Piece(Value, frozen=True, kw_only=True):
    """One entry of a route: a turn in place, or one path or a part of it: exactly its `curve`."""

    number: int
    commit: int  # order in which traffic committed it; lower goes first wherever they meet
    move: int  # index of the compiled move it is part of, of the map with `plan` as its digest
    plan: str
    path: PathKey | None  # None = a turn in place
    area: int
    heading_rad: float  # at the end of the piece
    curve: tuple[XY, ...]  # all Bezier control points, ends included; one point for a turn
    length_m: float  # radians turned, if it is a turn
    inside: bool = False  # it ends inside the path, where the robot stands on no point
    backward: bool = False
    speed_mps_max: float | None = None
    acceleration_mps2_max: float | None = None
    from_rest: bool = False  # before it there is ground to rest on, and others may count on that


class Drive(Value, frozen=True, kw_only=True, tag=True):
    """Append pieces to the route and move the authority forward; never shortens either."""

    robot: RobotName
    session: str
    authority: Mark
    pieces: tuple[Piece, ...] = ()


class Act(Value, frozen=True, kw_only=True, tag=True):
    """Do something where you stand. A repeated id is the same action and is not done twice."""

    robot: RobotName
    id: str
    name: str  # bin task or operation as the client named it, or Charge
    bin: int = 0  # the robot's own storage place
    order: OrderId | None = None
    arguments: str = "{}"  # JSON object text


class Cancel(Value, frozen=True, kw_only=True, tag=True):
    """Stop an action that is running, if it can be stopped."""

    robot: RobotName
    id: str


class TellRoute(Value, frozen=True, kw_only=True, tag=True):
    """Put the outstanding route into the next report: the dispatcher has restarted."""

    robot: RobotName


class InstructionKind(StrEnum):
    """What an operator can tell a robot, beside orders."""

    SOFT_STOP = "SoftStop"  # on: stop at once and stay
    PAUSE = "Pause"  # on: stop smoothly and stay, route and all
    CONTROL = "Control"  # on: obey the dispatcher; off: obey it no more
    CLEAR_ALARMS = "ClearAlarms"  # once


ONCE = frozenset({InstructionKind.CLEAR_ALARMS})  # stale after a minute; the others stand


class Instruction(Value, frozen=True, kw_only=True):
    """An instruction of an operator: the newest of each kind counts."""

    kind: InstructionKind
    number: int  # position of its event: a robot obeys each number once, in ascending order
    at_ms: int
    on: bool = True
    gently: bool = False  # CONTROL: only if nobody else holds it
    reason: str = ""  # SOFT_STOP: what our guard saw that must not be; empty = a person's


class Instruct(Value, frozen=True, kw_only=True, tag=True):
    """Told until `Report.obeyed` has reached the last number."""

    robot: RobotName
    instructions: tuple[Instruction, ...]  # ascending numbers


class Reconnect(Value, frozen=True, kw_only=True, tag=True):
    """Connect anew and report: the dispatcher has not heard of this robot for too long."""

    robot: RobotName


ToRobot: TypeAlias = Drive | Act | Cancel | TellRoute | Instruct | Reconnect

DISPATCHER = "fleetledger"  # the holder of control when we hold it


class AlarmLevel(StrEnum):
    """How bad an alarm is (spec/m4.md, RobotAlarmLevel)."""

    INFO = "Info"
    WARNING = "Warning"
    ERROR = "Error"
    FATAL = "Fatal"


class Alarm(Value, frozen=True, kw_only=True):
    """Trouble that the robot itself reports."""

    level: AlarmLevel
    code: str
    message: str
    times: int = 1
    at_ms: int = 0


class ActionPhase(StrEnum):
    """How far an action is."""

    RUNNING = "Running"
    DONE = "Done"
    FAILED = "Failed"


class ActionReport(Value, frozen=True, kw_only=True):
    """The last action that the robot was told."""

    id: str
    phase: ActionPhase
    message: str = ""


class Load(Value, frozen=True, kw_only=True):
    """What lies in one storage place of the robot."""

    bin: int
    container: str


class Report(Value, frozen=True, kw_only=True):
    """What a robot says of itself, about ten times a second."""

    scene: SceneId
    robot: RobotName
    number: int  # grows with each report; an older one is dropped
    at_ms: int
    area: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float = 0.0  # along its own x axis; negative = backwards
    turn_radps: float = 0.0
    point: PointName | None = None  # the point it stands on
    battery_ratio: float = 1.0
    charging: bool = False
    emergency_stop: bool = False
    soft_stop: bool = False
    paused: bool = False
    controller: str = DISPATCHER  # who holds control of it; empty = nobody
    obeyed: int = 0  # number of the newest instruction that it has carried out
    blocked: bool = False
    blocked_reason: int | None = None  # codes of spec/m4.md, RobotSelfReportMain.blockedReason
    confidence: float = 1.0
    odometer_m: float = 0.0
    odometer_today_m: float = 0.0
    map_name: str = ""
    map_digest: str = ""
    alarms: tuple[Alarm, ...] = ()
    loads: tuple[Load, ...] = ()
    action: ActionReport | None = None
    session: str = ""  # of the route; a new one means that the robot has forgotten the old route
    progress: Mark = Mark()
    authority: Mark = Mark()
    route: tuple[Piece, ...] | None = None  # outstanding pieces, only when asked by TellRoute


PLACE_M_MAX, ANGLE_RAD_MAX, RATE_MAX = 1e6, 1e3, 1e3  # of what a robot can mean
AT_MS_MAX = 2**42  # the year 2109; later instants do not fit where nanoseconds are counted


def implausible(report: Report) -> str | None:
    """Name what no robot can mean by its report, however well the message is formed; or None."""
    bounds = (
        ("x_m", report.x_m, PLACE_M_MAX),
        ("y_m", report.y_m, PLACE_M_MAX),
        ("heading_rad", report.heading_rad, ANGLE_RAD_MAX),
        ("speed_mps", report.speed_mps, RATE_MAX),
        ("turn_radps", report.turn_radps, RATE_MAX),
    )
    for name, value, most in bounds:
        if not -most <= value <= most:
            return f"{name} {value} is not within {most:g}"
    if not 0 <= report.at_ms <= AT_MS_MAX:
        return f"at_ms {report.at_ms} is not between 0 and {AT_MS_MAX}"
    return None


class Turn(Value, frozen=True, kw_only=True):
    """A turn in place that a robot has still to make, and the number of the move it is made for."""

    at_m: XY
    commit: int


class Space(Value, frozen=True, kw_only=True):
    """Ground that a robot holds: a polygon in the scene's frame."""

    points: tuple[XY, ...]


DOOR = "door:"  # before the name of a door, where robots' names stand too
EXTERNAL = "external:"  # before the owner of reserved ground, where robots' names stand too


STUCK = "TrafficStuck"  # code of the alarm of a robot that cannot get on without a person


class Plan(Value, frozen=True, kw_only=True):
    """What the scheduler intends with a robot just now, for those who look on; not a command."""

    scene: SceneId
    robot: RobotName
    at_ms: int
    ready: bool  # traffic knows where the robot is and may move it
    target: PointName | None = None
    untravelled: tuple[PathKey, ...] = ()  # paths still to be driven
    commits: tuple[int, ...] = ()  # and for each the number of the move that it is driven for
    turns: tuple[Turn, ...] = ()  # before, between and behind these
    spaces: tuple[Space, ...] = ()  # cells it holds now
    blocked_by: tuple[RobotName, ...] = ()  # and EXTERNAL with its owner, DOOR with its name
    commit: int = 0  # number of its newest committed move, 0 = none
    moving: bool = False
    wait: Wait | None = None  # why it stands, if it should not
    alarm: Alarm | None = None  # STUCK, or what the guard of traffic holds it for

    @property
    def stuck(self) -> Alarm | None:
        """Why it cannot get on without a person, if it cannot."""
        return self.alarm if self.alarm is not None and self.alarm.code == STUCK else None


class DoorStatus(StrEnum):
    """State of a door, or of a lift's door (spec/m4.md, DoorMainStatus and LiftDoorStatus)."""

    UNKNOWN = "Unknown"
    CLOSED = "Closed"
    CLOSING = "Closing"
    OPENING = "Opening"
    OPENED = "Opened"


class DoorReport(Value, frozen=True, kw_only=True):
    """What a door says of itself, once a second and at every change."""

    scene: SceneId
    door: int
    at_ms: int
    status: DoorStatus
    fault: str | None = None  # in words; None = none
    obeyed: int = 0  # number of the TellDoor by which it is, or will be, open; 0 = by none


class LiftReport(Value, frozen=True, kw_only=True):
    """What a lift says of itself, once a second and at every change."""

    scene: SceneId
    lift: int
    at_ms: int
    floor: str  # name of the LiftFloor it is at, or was last
    target: str | None = None  # floor that it goes to
    doors: tuple[DoorStatus, ...] = (DoorStatus.UNKNOWN,)
    automatic: bool = True  # False = driven by hand, obeys nobody
    people: bool = False
    fault: str | None = None


class TellDoor(Value, frozen=True, kw_only=True, tag=True):
    """Be open, or be closed; told again every second, and a door that hears nothing closes.

    The number stays the same while it is wanted open without a break. A door that reports both
    Opened and this number cannot have begun to close when it said so: robots may enter.
    """

    door: int
    open: bool
    number: int = 0
    robots: tuple[RobotName, ...] = ()  # for whom


class TellLift(Value, frozen=True, kw_only=True, tag=True):
    """Go to a floor and keep the doors open there; None = go your own ways."""

    lift: int
    floor: str | None


ToDevice: TypeAlias = TellDoor | TellLift


class DoorState(Value, frozen=True, kw_only=True):
    """A door as the scheduler uses it, for those who look on."""

    door: int
    robots: tuple[RobotName, ...] = ()  # for whom it is open or being opened
