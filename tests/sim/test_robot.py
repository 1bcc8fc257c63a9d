"""Laws of motion of a simulated robot."""

from math import pi

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.link import Drive, Mark, Piece
from sim.curves import wrapped
from sim.robot import SimRobot, drive, has_way, place, stands_on, step
from tests.sim.routes import (
    KINEMATICS,
    distance,
    path,
    robot_at_origin,
    routes,
    straight,
    told,
    turn,
)

LONG_S = 600.0
DUST = 2e-9  # a nanometre short of a piece's end counts as its end


def run(robot: SimRobot, dt_s: float = 0.1, until_s: float = LONG_S) -> float:
    """Step until the robot sleeps; give the time it took."""
    spent_s = 0.0
    while robot.awake and spent_s < until_s:
        step(robot, dt_s)
        spent_s += dt_s
    assert not robot.awake
    return spent_s


def driven(mark: Mark, pieces: list[Piece]) -> float:
    return sum(p.length_m for p in pieces if p.number < mark.piece) + mark.along_m


def limits(piece: Piece) -> tuple[float, float]:
    if piece.path is None:
        return KINEMATICS.turn_radps_max, KINEMATICS.turn_radps2_max
    return (
        min(KINEMATICS.speed_mps_max, piece.speed_mps_max or 9.0),
        min(KINEMATICS.acceleration_mps2_max, piece.acceleration_mps2_max or 9.0),
    )


@given(pieces=routes(), data=st.data(), dt_s=st.sampled_from([0.05, 0.1, 0.2]))
def test_a_robot_never_passes_its_authority_however_it_grows(
    pieces: list[Piece], data: st.DataObject, dt_s: float
) -> None:
    robot = robot_at_origin()
    authority = Mark()
    told_to = 0
    for _ in range(20):
        told_to = data.draw(st.integers(told_to, len(pieces)))
        if told_to:
            piece = pieces[told_to - 1]
            along = data.draw(st.floats(0.0, 1.0)) * piece.length_m
            authority = max(authority, Mark(piece=told_to, along_m=along))
        drive(robot, told(pieces, authority))
        for _ in range(data.draw(st.integers(0, 30))):
            step(robot, dt_s)
            assert driven(robot.progress, pieces) <= driven(authority, pieces) + DUST
    run(robot)
    assert robot.speed == 0.0
    assert driven(robot.progress, pieces) == pytest.approx(driven(authority, pieces), abs=DUST)


@given(pieces=routes(), dt_s=st.sampled_from([0.05, 0.1, 0.2]))
def test_speed_and_acceleration_stay_within_their_limits(pieces: list[Piece], dt_s: float) -> None:
    robot = robot_at_origin()
    drive(robot, told(pieces))
    before = 0.0
    odometer = 0.0
    while robot.awake:
        number = robot.legs[0].piece.number
        step(robot, dt_s)
        touched = [p for p in pieces if number <= p.number <= robot.progress.piece + 1]
        speeds, accelerations = zip(*(limits(p) for p in touched), strict=True)
        assert robot.speed <= max(speeds) + 1e-9
        if all(p.path is not None for p in touched):
            assert abs(robot.speed - before) <= max(accelerations) * dt_s + 1e-6
        assert robot.odometer_m - odometer <= KINEMATICS.speed_mps_max * dt_s + 1e-6
        before, odometer = robot.speed, robot.odometer_m


def test_a_robot_whose_route_ends_inside_a_path_stands_on_no_point() -> None:
    robot = robot_at_origin()
    first, rest = straight(1, 0.0, 2.0), straight(2, 2.0, 3.0)
    drive(robot, told([msgspec.structs.replace(first, inside=True)]))
    run(robot)
    assert stands_on(robot) is None
    drive(robot, told([msgspec.structs.replace(rest, path=first.path)]))
    run(robot)
    assert stands_on(robot) == "P1"


@given(pieces=routes())
def test_a_robot_arrives_exactly_where_its_route_ends(pieces: list[Piece]) -> None:
    robot = robot_at_origin()
    drive(robot, told(pieces))
    run(robot)
    x, y, heading, turning = place(robot)
    assert (x, y) == pieces[-1].curve[-1]
    assert abs(wrapped(heading - pieces[-1].heading_rad)) < 1e-9
    assert turning == 0.0
    assert not has_way(robot)
    length_m = sum(p.length_m for p in pieces if p.path is not None)
    assert robot.odometer_m == pytest.approx(length_m)


@given(pieces=routes(), dt_s=st.sampled_from([0.1, 0.2]))
def test_a_robot_moves_without_jumps(pieces: list[Piece], dt_s: float) -> None:
    robot = robot_at_origin()
    drive(robot, told(pieces))
    x, y, heading, _ = place(robot)
    while robot.awake:
        step(robot, dt_s)
        new_x, new_y, new_heading, _ = place(robot)
        assert distance((x, y), (new_x, new_y)) <= KINEMATICS.speed_mps_max * dt_s + 1e-6
        assert abs(wrapped(new_heading - heading)) <= KINEMATICS.turn_radps_max * dt_s + 0.25
        x, y, heading = new_x, new_y, new_heading


def test_a_joint_that_bends_little_is_driven_through() -> None:
    pieces = [straight(n, 2.0 * (n - 1), 2.0 * n) for n in (1, 2, 3, 4)]
    robot = robot_at_origin()
    drive(robot, told(pieces))
    spent_s = run(robot)
    # 8 m: 2 s and 1.2 m to speed up and to slow down each, 5.6 m at 1.2 m/s in between
    assert spent_s == pytest.approx(2 + 2 + 5.6 / 1.2, abs=0.3)


def test_a_robot_stops_before_it_turns_in_place() -> None:
    pieces = [straight(1, 0.0, 2.0), turn(2, (2.0, 0.0), 0.0, pi / 2)]
    robot = robot_at_origin()
    drive(robot, told(pieces))
    while robot.progress < Mark(piece=1, along_m=2.0):
        assert place(robot)[2] == 0.0
        step(robot, 0.05)
    run(robot)
    assert place(robot)[2] == pytest.approx(pi / 2)
    assert robot.point == "P1"


def test_a_robot_slows_down_ahead_of_a_slow_path() -> None:
    pieces = [straight(1, 0.0, 5.0), straight(2, 5.0, 8.0, speed_mps_max=0.3)]
    robot = robot_at_origin()
    drive(robot, told(pieces))
    fastest = 0.0
    while robot.awake:
        step(robot, 0.1)
        fastest = max(fastest, robot.speed)
        if robot.progress.piece == 2:
            assert robot.speed <= 0.3 + 1e-9
    assert fastest == pytest.approx(KINEMATICS.speed_mps_max)


def test_a_path_that_starts_in_another_heading_makes_the_robot_turn_first() -> None:
    robot = robot_at_origin()
    drive(robot, told([path(1, ((0.0, 0.0), (0.0, 3.0)))]))
    for _ in range(8):
        step(robot, 0.1)
    assert place(robot)[:2] == (0.0, 0.0)
    assert robot.progress == Mark()
    run(robot)
    assert place(robot)[:2] == (0.0, 3.0)


def test_pieces_told_twice_are_driven_once() -> None:
    pieces = [straight(1, 0.0, 2.0), straight(2, 2.0, 4.0)]
    robot = robot_at_origin()
    drive(robot, told(pieces))
    drive(robot, told(pieces))
    assert len(robot.legs) == 2
    run(robot)
    drive(robot, told(pieces))
    assert not has_way(robot)


def test_authority_never_shrinks() -> None:
    pieces = [straight(1, 0.0, 4.0)]
    robot = robot_at_origin()
    drive(robot, told(pieces))
    drive(robot, told(pieces, Mark(piece=1, along_m=1.0)))
    assert robot.authority == Mark(piece=1, along_m=4.0)


def of_session(session: str, drive: Drive) -> Drive:
    return msgspec.structs.replace(drive, session=session)


def test_a_new_session_begins_a_new_route_where_the_robot_stands() -> None:
    robot = robot_at_origin()
    drive(robot, told([straight(1, 0.0, 2.0)], Mark(piece=1, along_m=0.5)))
    run(robot)
    drive(robot, of_session("newer", told([straight(1, 0.5, 2.0)])))
    assert (robot.progress, robot.session) == (Mark(), "newer")
    run(robot)
    assert place(robot)[:3] == (2.0, 0.0, 0.0)
    assert robot.point == "P1"


def test_a_moving_robot_keeps_its_session() -> None:
    robot = robot_at_origin()
    drive(robot, told([straight(1, 0.0, 4.0)]))
    step(robot, 0.1)
    drive(robot, of_session("newer", told([straight(1, 0.0, 2.0)])))
    run(robot)
    assert (robot.progress, robot.session) == (Mark(piece=1, along_m=4.0), "session")


def test_a_late_message_of_a_past_session_is_not_heard() -> None:
    robot = robot_at_origin()
    drive(robot, of_session("newer", told([straight(1, 0.0, 2.0)])))
    run(robot)
    drive(robot, told([straight(1, 2.0, 4.0)]))
    assert (robot.session, has_way(robot)) == ("newer", False)


@pytest.mark.parametrize(
    ("piece", "word"),
    [(straight(2, 0.0, 2.0), "due"), (straight(1, 1.0, 2.0), "starts 1.00 m")],
)
def test_a_route_that_does_not_fit_raises_an_alarm(piece: Piece, word: str) -> None:
    robot = robot_at_origin()
    drive(robot, told([piece]))
    assert not robot.legs
    assert word in robot.alarms["RouteBroken"].message


def test_a_held_robot_brakes_and_goes_on_later() -> None:
    robot = robot_at_origin()
    drive(robot, told([straight(1, 0.0, 9.0)]))
    for _ in range(25):
        step(robot, 0.1)
    robot.held_s = 5.0
    for _ in range(40):
        step(robot, 0.1)
    assert robot.speed == 0.0
    assert 2.0 < robot.progress.along_m < 4.0
    run(robot)
    assert robot.progress == Mark(piece=1, along_m=9.0)


def test_pieces_that_were_lost_are_told_again_and_the_alarm_goes() -> None:
    robot = robot_at_origin()
    route = [straight(1, 0.0, 2.0), straight(2, 2.0, 4.0)]
    drive(robot, told(route[1:]))
    drive(robot, Drive(robot=robot.body.name, session=robot.session, authority=Mark(piece=2)))
    assert robot.authority == Mark(), "it may not claim what it cannot drive: that is told once"
    drive(robot, told(route))
    run(robot)
    assert (robot.progress, robot.alarms) == (Mark(piece=2, along_m=2.0), {})
