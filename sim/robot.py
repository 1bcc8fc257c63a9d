"""One simulated robot: it drives its route by real kinematics, and stops at its authority itself.

Pure but mutable: a robot is stepped millions of times, so it is a plain class with slots and pose,
battery and reports are worked out only when somebody asks. Units of a turn in place are radians
wherever those of a path are metres.
"""

from collections import deque
from enum import Enum, auto
from itertools import pairwise
from math import hypot, pi, sqrt

from ledger.ids import PointName
from ledger.link import DISPATCHER, Alarm, AlarmLevel, Drive, Mark, Piece
from sim.actions import Actions
from sim.curves import pose, wrapped
from sim.legs import ALIGN_RAD, Body, Leg, joined

JOIN_M = 0.05  # a route may jump by this much between two pieces, for maps are not exact
PIECES_MAX = 1000  # outstanding ones
LEGS_PER_STEP_MAX = 100
PAST_MAX = 16  # former sessions remembered
SOFT_STOP_FACTOR = 3.0  # as hard as it can, against how it brakes on its way

DRIVE_PER_M = 1.0 / 25_000  # share of the battery: about eight hours of steady driving
REST_PER_S = 1.0 / 86_400  # electronics alone: a day
CHARGE_PER_S = 1.0 / 3_600


class Hears(Enum):
    """What reaches a robot; it is heard itself only where everything does."""

    ALL = auto()
    RECONNECT = auto()  # its link is cut: only the call to connect anew
    NOTHING = auto()  # and not even that


class SimRobot:
    """The whole state of one robot. `along` and `speed` are in the units of the current leg."""

    __slots__ = (
        "actions",
        "alarms",
        "along",
        "authority",
        "awake",
        "battery",
        "body",
        "changed",
        "commit",
        "controller",
        "done",
        "hand_mps",
        "heading",
        "hears",
        "held_s",
        "legs",
        "number",
        "obeyed",
        "odometer_m",
        "past",
        "paused",
        "point",
        "session",
        "settled_m",
        "settled_s",
        "soft_stop",
        "speed",
        "tell_route",
        "today",
        "today_m",
        "x",
        "y",
    )

    def __init__(self, body: Body, session: str, place: tuple[float, float, float]) -> None:
        self.body = body
        self.session = session
        self.past: deque[str] = deque(maxlen=PAST_MAX)  # sessions before this one
        self.x, self.y, self.heading = place  # at the end of the newest whole leg
        self.point: PointName | None = None  # likewise
        self.legs: deque[Leg] = deque()  # outstanding ones, the current one first
        self.done = Mark()  # end of the newest whole piece
        self.along = 0.0
        self.speed = 0.0
        self.authority = Mark()  # as told, perhaps beyond the pieces that we have
        self.held_s = 0.0  # a disturbance: stands still, or brakes, that long
        self.commit = 0  # of the newest move that could have been disturbed
        self.actions = Actions()
        self.battery = 1.0
        self.odometer_m = 0.0
        self.settled_m = 0.0  # odometer and time up to which the battery is worked out
        self.settled_s = 0.0
        self.today = 0  # day since the epoch, and the odometer at its beginning
        self.today_m = 0.0
        self.number = 0  # of the newest report
        self.alarms: dict[str, Alarm] = {}
        self.tell_route = False
        self.soft_stop = False  # stands still, whatever it has been told
        self.paused = False  # likewise, but what it does where it stands goes on
        self.controller = DISPATCHER  # whom it obeys; empty = nobody
        self.obeyed = 0  # number of the newest instruction that it has carried out
        self.hears = Hears.ALL
        self.hand_mps = 0.0  # speed at which people move it
        self.changed = True  # since the last report
        self.awake = True  # has something to do: a sleeping robot costs nothing

    @property
    def charging(self) -> bool:
        """Battery rises."""
        return self.actions.charging

    @property
    def progress(self) -> Mark:
        """How far it has driven its route."""
        if self.along > 0.0 and not own(self, self.legs[0]):
            return Mark(piece=self.legs[0].piece.number, along_m=self.along)
        return self.done


def own(robot: SimRobot, leg: Leg) -> bool:
    """Tell whether it is the robot's own turn before a piece, which is not on the route."""
    return leg.piece.number <= robot.done.piece


def drive(robot: SimRobot, message: Drive) -> None:
    """Append to the route and move the authority forward; what is known already is harmless.

    A new session begins a new route where the robot stands; see `_new_session`.
    """
    if message.session != robot.session and not _new_session(robot, message.session):
        return
    last = robot.legs[-1].piece if robot.legs else None
    number = max(robot.done.piece, last.number if last is not None else 0)
    for piece in message.pieces:
        if piece.number <= number:
            continue
        problem = _problem(robot, piece, number)
        if problem is not None:
            robot.alarms["RouteBroken"] = Alarm(
                level=AlarmLevel.ERROR, code="RouteBroken", message=problem
            )
            break
        robot.alarms.pop("RouteBroken", None)
        leg = Leg(piece, robot.body.kinematics)
        leg.joined = bool(robot.legs) and joined(robot.legs[-1], leg)
        robot.legs.append(leg)
        number = piece.number
    if message.authority.piece <= number:  # else pieces are missing, and must be told again
        robot.authority = max(robot.authority, message.authority)
    look_ahead(robot)
    robot.changed = robot.awake = True


def _new_session(robot: SimRobot, session: str) -> bool:
    """Forget the route for a new one that the dispatcher opens.

    Not for a session of the past, whose messages may come late, and not while there is ground
    ahead that may be driven: nobody but the robot knows where in it that would make it stop.
    """
    if session in robot.past or robot.speed > 0.0 or has_way(robot):
        return False
    robot.point = stands_on(robot)
    robot.x, robot.y, robot.heading, _ = place(robot)
    robot.past.append(robot.session)
    robot.session = session
    robot.legs.clear()
    robot.along = 0.0
    robot.done = robot.authority = Mark()
    robot.commit = 0
    return True


def _problem(robot: SimRobot, piece: Piece, number: int) -> str | None:
    if piece.number != number + 1:
        return f"piece {piece.number} came where {number + 1} was due"
    if len(robot.legs) >= PIECES_MAX:
        return f"more than {PIECES_MAX} outstanding pieces"
    if len(piece.curve) != 1 if piece.path is None else len(piece.curve) < 2:
        return f"piece {piece.number} has {len(piece.curve)} control points"
    end = robot.legs[-1].piece.curve[-1] if robot.legs else (robot.x, robot.y)
    gap_m = hypot(piece.curve[0][0] - end[0], piece.curve[0][1] - end[1])
    if gap_m > JOIN_M:
        return f"piece {piece.number} starts {gap_m:.2f} m from where the route ends"
    return None


def resume_joins(robot: SimRobot) -> None:
    """Find out again which legs are entered without a stop, for a route taken from memory."""
    for before, leg in pairwise(robot.legs):
        leg.joined = joined(before, leg)


def look_ahead(robot: SimRobot) -> None:
    """Work out backwards, from where the authority ends, how fast each leg may be left."""
    authority = robot.authority
    entry = 0.0
    for leg in reversed(robot.legs):
        here_m = authority.along_m if leg.piece.number == authority.piece else 0.0
        leg.whole = leg.piece.number < authority.piece or (
            leg.piece.number == authority.piece and here_m > leg.length - 1e-9
        )
        leg.stop = leg.length if leg.whole else here_m
        leg.exit = min(entry, leg.speed_max) if leg.whole else 0.0
        entry = 0.0
        if leg.joined and leg.stop > 0.0:
            reachable = sqrt(leg.exit * leg.exit + 2.0 * leg.acceleration * leg.stop)
            entry = min(leg.speed_max, reachable)


def has_way(robot: SimRobot) -> bool:
    """Tell whether the authority reaches beyond where it is."""
    return bool(robot.legs) and (robot.legs[0].whole or robot.legs[0].stop > robot.along)


def step(robot: SimRobot, dt_s: float) -> None:
    """Let time pass: work, or drive as far as the authority goes, and fall asleep if done."""
    robot.changed = True
    actions = robot.actions
    stopped = robot.soft_stop or robot.paused
    if actions.charging and has_way(robot) and not stopped:
        actions.stop_charging()  # a way to go ends it
    if actions.running:
        if not robot.soft_stop:
            actions.work(dt_s)
    elif robot.legs:
        _follow(robot, dt_s)
    robot.held_s = max(0.0, robot.held_s - dt_s)
    working = actions.running and not actions.charging and not robot.soft_stop
    robot.awake = working or robot.speed > 0.0 or (has_way(robot) and not stopped)


def _follow(robot: SimRobot, dt_s: float) -> None:
    left_s = dt_s
    for _ in range(LEGS_PER_STEP_MAX):
        if left_s <= 0.0 or not robot.legs:
            return
        leg = robot.legs[0]
        if robot.along == 0.0 and robot.speed == 0.0 and leg.stop > 0.0:
            leg = _aligned(robot, leg)
        if leg.stop > robot.along:
            left_s = _advance(robot, leg, left_s)
        if leg.whole and robot.along >= leg.length:
            _complete(robot, leg)
        elif robot.along >= leg.stop:
            robot.speed = 0.0
            return


def _aligned(robot: SimRobot, leg: Leg) -> Leg:
    """Turn towards a path that does not begin in our heading, if nobody has told us to.

    A real robot does the same; that the ground for it was granted is the sender's business.
    """
    if leg.track is None:
        return leg
    off_rad = wrapped(leg.heading_at_start() - robot.heading)
    if abs(off_rad) <= ALIGN_RAD:
        return leg
    turn = Piece(
        number=robot.done.piece,
        commit=leg.piece.commit,
        move=leg.piece.move,
        plan=leg.piece.plan,
        path=None,
        area=leg.piece.area,
        heading_rad=wrapped(leg.heading_at_start()),
        curve=((robot.x, robot.y),),
        length_m=abs(off_rad),
    )
    first = Leg(turn, robot.body.kinematics)
    first.stop, first.whole = first.length, True
    robot.legs.appendleft(first)
    return first


def _advance(robot: SimRobot, leg: Leg, left_s: float) -> float:
    """Move within one leg at constant acceleration; give the time that is left at its end.

    The new speed is the greatest from which one can still slow down to `exit` at `stop`:
    w²/2a + (v+w)/2·t <= room + exit²/2a. As authority only grows this always stays possible.
    """
    speed, limit = robot.speed, leg.acceleration
    room = leg.stop - robot.along
    span_s = left_s
    if robot.soft_stop or robot.paused or robot.held_s > 0.0:
        brake = limit * SOFT_STOP_FACTOR if robot.soft_stop else limit
        span_s = min(left_s, speed / brake)
        wanted = speed - brake * span_s
    else:
        reserve = room + leg.exit * leg.exit / (2.0 * limit) - speed * left_s / 2.0
        under = left_s * left_s / 4.0 + 2.0 * reserve / limit
        wanted = limit * (sqrt(under) - left_s / 2.0) if under > 0.0 else 0.0
        wanted = min(wanted, speed + limit * left_s, leg.speed_max)
        if wanted <= 0.0:  # the end comes within this time: brake just so
            last = min(speed, leg.exit)
            used_s = 2.0 * room / (speed + last) if speed > 0.0 else 0.0
            _move(robot, leg, leg.stop, last)
            return max(0.0, left_s - used_s)
        wanted = max(wanted, speed - limit * left_s)
    way = (speed + wanted) / 2.0 * span_s
    if way < room:
        _move(robot, leg, min(robot.along + way, leg.stop), wanted)
        return 0.0
    slope = (wanted - speed) / span_s
    last = min(sqrt(max(0.0, speed * speed + 2.0 * slope * room)), leg.exit)
    used_s = 2.0 * room / (speed + last) if speed + last > 0.0 else span_s
    _move(robot, leg, leg.stop, last)
    return max(0.0, left_s - used_s)


def _move(robot: SimRobot, leg: Leg, along: float, speed: float) -> None:
    if leg.track is not None:
        robot.odometer_m += along - robot.along
    robot.along = along
    robot.speed = speed


def _complete(robot: SimRobot, leg: Leg) -> None:
    robot.legs.popleft()
    piece = leg.piece
    robot.x, robot.y = piece.curve[-1]
    robot.heading = wrapped(piece.heading_rad)
    robot.along = 0.0
    if piece.number > robot.done.piece:
        robot.done = Mark(piece=piece.number, along_m=leg.length)
    if piece.path is not None:
        robot.point = None if piece.inside else PointName(piece.path.rpartition("->")[2])
    if not robot.legs or not robot.legs[0].joined:
        robot.speed = 0.0


def place(robot: SimRobot) -> tuple[float, float, float, float]:
    """Work out position, heading and signed rotation speed."""
    if not robot.legs or robot.along == 0.0:
        return robot.x, robot.y, robot.heading, 0.0
    leg = robot.legs[0]
    if leg.track is None:
        turn = wrapped(leg.piece.heading_rad - robot.heading)
        if leg.length > pi + ALIGN_RAD:  # told to go the long way round
            turn -= 2 * pi if turn > 0.0 else -2 * pi
        heading = robot.heading + turn * robot.along / leg.length
        return robot.x, robot.y, wrapped(heading), robot.speed if turn > 0.0 else -robot.speed
    x, y, heading, bend = pose(leg.track, robot.along * leg.track.length_m / leg.length)
    if leg.piece.backward:
        return x, y, wrapped(heading + pi), -robot.speed * bend
    return x, y, wrapped(heading), robot.speed * bend


def stands_on(robot: SimRobot) -> PointName | None:
    """Name the point that it is on; none on the way along a path."""
    on_path = robot.along > 0.0 and robot.legs[0].track is not None
    return None if on_path else robot.point


def settle(robot: SimRobot, now_s: float) -> None:
    """Bring the battery up to date; call it before charging begins or ends, and before asking."""
    rest_s = now_s - robot.settled_s
    drain = (robot.odometer_m - robot.settled_m) * DRIVE_PER_M + rest_s * REST_PER_S
    gain = rest_s * CHARGE_PER_S if robot.charging else 0.0
    robot.battery = min(1.0, max(0.0, robot.battery + gain - drain))
    robot.settled_s, robot.settled_m = now_s, robot.odometer_m
