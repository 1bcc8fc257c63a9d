"""Routes for robots under test: pieces made as traffic would make them."""

from math import cos, hypot, pi, sin

from hypothesis import strategies as st

from ledger.ids import PathKey, PointName, RobotName, SceneId
from ledger.link import Drive, Mark, Piece
from ledger.scene import XY, Kinematics
from sim.curves import track, wrapped
from sim.legs import Body
from sim.robot import SimRobot

ROBOT = RobotName("AMB-01")
KINEMATICS = Kinematics()


def body() -> Body:
    return Body(
        scene=SceneId("s"),
        name=ROBOT,
        area=0,
        map_name="m",
        map_digest="d",
        kinematics=KINEMATICS,
        radius_m=0.61,
        chargers=frozenset({PointName("P0")}),
    )


def robot_at_origin() -> SimRobot:
    robot = SimRobot(body(), "session", (0.0, 0.0, 0.0))
    robot.point = PointName("P0")
    return robot


def turn(number: int, at: XY, start_rad: float, end_rad: float) -> Piece:
    return Piece(
        number=number,
        commit=number,
        move=0,
        plan="p",
        path=None,
        area=0,
        heading_rad=wrapped(end_rad),
        curve=(at,),
        length_m=abs(wrapped(end_rad - start_rad)),
    )


def path(number: int, curve: tuple[XY, ...], *, backward: bool = False, **limits: float) -> Piece:
    table = track(curve)
    return Piece(
        number=number,
        commit=number,
        move=0,
        plan="p",
        path=PathKey(f"P{number - 1}->P{number}"),
        area=0,
        heading_rad=wrapped(table.headings_rad[-1] + (pi if backward else 0.0)),
        curve=curve,
        length_m=table.length_m,
        backward=backward,
        **limits,
    )


def straight(number: int, start_m: float, end_m: float, **limits: float) -> Piece:
    return path(number, ((start_m, 0.0), (end_m, 0.0)), **limits)


def told(pieces: list[Piece], authority: Mark | None = None) -> Drive:
    end = Mark(piece=pieces[-1].number, along_m=pieces[-1].length_m)
    return Drive(robot=ROBOT, session="session", authority=authority or end, pieces=tuple(pieces))


@st.composite
def routes(draw: st.DrawFn) -> list[Piece]:
    """Connected routes from the origin: straight runs, bends, turns in place, and reversing."""
    pieces: list[Piece] = []
    x, y, heading = 0.0, 0.0, 0.0
    for _ in range(draw(st.integers(1, 6))):
        number = len(pieces) + 1
        kind = draw(st.sampled_from(["straight", "straight", "bend", "turn", "reverse"]))
        length = draw(st.floats(0.2, 4.0))
        if kind == "turn":
            end = heading + draw(st.floats(-3.0, 3.0))
            pieces.append(turn(number, (x, y), heading, end))
            heading = end
            continue
        limits: dict[str, float] = {}
        if draw(st.booleans()):
            limits["speed_mps_max"] = draw(st.floats(0.2, 2.0))
        if draw(st.booleans()):
            limits["acceleration_mps2_max"] = draw(st.floats(0.2, 1.0))
        backward = kind == "reverse"
        away = heading + (pi if backward else 0.0)
        one = (x + length * cos(away) / 3, y + length * sin(away) / 3)
        bend = draw(st.floats(-1.2, 1.2)) if kind == "bend" else 0.0
        two = (
            one[0] + length * cos(away + bend / 2) / 3,
            one[1] + length * sin(away + bend / 2) / 3,
        )
        end_xy = (two[0] + length * cos(away + bend) / 3, two[1] + length * sin(away + bend) / 3)
        curve = ((x, y), one, two, end_xy) if kind == "bend" else ((x, y), end_xy)
        pieces.append(path(number, curve, backward=backward, **limits))
        x, y = end_xy
        heading = away + bend - (pi if backward else 0.0)
    return pieces


def distance(a: XY, b: XY) -> float:
    return hypot(a[0] - b[0], a[1] - b[1])
