from ledger.ids import PointName, RobotName
from ledger.scene import Group
from scheduler.traffic.traffic import Goal
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice

R0, R1 = RobotName("R0"), RobotName("R1")


def test_a_restart_gives_nobody_ground_that_was_only_promised() -> None:
    """R1 has been told to go on but stands still, and R0, committed behind it, waits for that."""
    starts = {"R0": ("P0-0", 0.0), "R1": ("P3-0", 0.0)}
    made = Floor(lattice(6, 1, 1.4), (Group(id=0, name="g"),), starts, [])
    made.idle = {R0, R1}
    made.tick()
    made.robots[R1].frozen_s = 30.0
    for robot, point in ((R1, "P5-0"), (R0, "P4-0")):
        made.goals[robot] = Goal(point=PointName(point), rank=(0, 0, robot))
    for _ in range(150):
        made.tick()
    waiting = made.robots[R0]
    authority = waiting.authority
    assert max(waiting.pieces) > authority.piece, "all that it knows of is granted already"
    made.restart()
    for _ in range(100):
        made.tick()
        made.judge()
    assert waiting.authority == authority
    for _ in range(600):
        made.tick()
        made.judge()
    assert R0 not in made.goals, "it never got there"
