from ledger.ids import PointName, RobotName
from ledger.scene import Group
from scheduler.goal import Goal
from scheduler.traffic.track import START
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice

GROUPS = (Group(id=0, name="g"),)
R0 = RobotName("R0")


def test_the_ground_a_robot_was_found_on_is_no_leave_to_drive():
    """R0 stands askew and has to turn before it can drive; a forklift is too near for that."""
    floor = Floor(lattice(3, 1), GROUPS, {"R0": ("P0-0", 0.8)}, [])
    floor.idle = {R0}
    floor.tick()
    traffic, track = floor.traffic, floor.traffic._tracks[R0]
    disc = traffic.roadmap.disc(0, 0)
    shape = traffic.grants.add_shape(((-0.9, 0.3), (-0.5, 0.3), (-0.5, 0.9)), [disc])
    traffic.grants.take(shape, "forklift")
    floor.goals[R0] = Goal(point=PointName("P2-0"), rank=(0, 0, "R0"))
    for _ in range(20):
        floor.tick()
        assert track.authority == floor.robots[R0].authority == START
    assert track.promised
    traffic.grants.release(shape, "forklift")
    traffic._freed = True
    for _ in range(100):
        floor.tick()
        floor.judge()
    assert traffic.stands_at(R0, PointName("P2-0"))


def test_progress_neither_falls_nor_runs_ahead_of_what_was_committed():
    floor = Floor(lattice(4, 1), GROUPS, {"R0": ("P0-0", 0.0)}, [])
    floor.idle = {R0}
    floor.goals[R0] = Goal(point=PointName("P3-0"), rank=(0, 0, "R0"))
    track = floor.traffic._tracks[R0]
    last = START
    for _ in range(60):
        floor.tick()
        assert track.progress >= last
        assert track.progress <= track.end
        last = track.progress
    boast = floor.robots[R0].report(floor.now_ms + 1, 0)
    assert boast.progress <= track.end


def test_one_move_is_committed_at_a_time_and_nobody_halts_for_want_of_the_next():
    floor = Floor(lattice(5, 1), GROUPS, {"R0": ("P0-0", 0.0)}, [])
    floor.idle = {R0}
    floor.goals[R0] = Goal(point=PointName("P4-0"), rank=(0, 0, "R0"))
    track, robot = floor.traffic._tracks[R0], floor.robots[R0]
    for _ in range(10):  # it has not set out, or has barely
        floor.tick()
    assert floor.traffic.roadmap.place[PointName("P1-0")] == track.place
    slowest = []
    while robot.x < 7.0:
        floor.tick()
        slowest.append(robot.speed if robot.x > 1.3 else 1.2)
    assert min(slowest) > 1.0
