import math
from collections import Counter
from collections.abc import Mapping

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.ids import PointName, RobotName
from ledger.link import DOOR, EXTERNAL
from ledger.scene import Area, Door, Group
from ledger.scene_config import SceneConfig
from ledger.waits import Wait, WaitReason, chains
from scheduler.goal import Goal
from scheduler.traffic.doors import DoorNow
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import area_of, both, lattice, spread, warehouse
from tests.scheduler.traffic.test_safe import GOALS, STANDS, TRAP

GROUPS = (Group(id=0, name="g"),)
R0, R1, R2 = RobotName("R0"), RobotName("R1"), RobotName("R2")
LOOK_MS = 400  # as often as traffic looks


def floor(area: Area, starts: Mapping[str, tuple[str, float]], **given: object) -> Floor:
    made = Floor(area, GROUPS, starts, [], **given)  # type: ignore[arg-type]
    made.idle = set(made.robots)
    return made


def send(made: Floor, robot: RobotName, point: str) -> None:
    made.goals[robot] = Goal(point=PointName(point), rank=(0, 0, robot))


def looked(made: Floor, seconds: float) -> Mapping[RobotName, Wait]:
    """Let time pass, looking all the while."""
    found: Mapping[RobotName, Wait] = {}
    until_ms = made.now_ms + round(seconds * 1000)
    while made.now_ms < until_ms:
        made.tick()
        if made.now_ms % LOOK_MS == 0:
            found = made.traffic.waits(made.now_ms)
    return found


def why(found: Mapping[RobotName, Wait], robot: RobotName) -> tuple[WaitReason, tuple[str, ...]]:
    return found[robot].reason, found[robot].blockers


def test_who_drives_waits_for_nobody():
    made = floor(lattice(6, 1), {"R0": ("P0-0", 0.0)})
    send(made, R0, "P5-0")
    while not made.traffic.stands_at(R0, PointName("P5-0")):
        assert looked(made, 0.4) == {}
    assert looked(made, 5) == {}, "and nobody waits who is where it is to be"


def test_a_robot_behind_a_late_one_waits_for_it_and_the_late_one_for_nobody():
    made = floor(lattice(8, 1), {"R0": ("P0-0", 0.0), "R1": ("P2-0", 0.0)})
    send(made, R0, "P6-0")
    send(made, R1, "P7-0")
    looked(made, 2)
    made.robots[R1].frozen_s = 12.0
    begun_ms = made.now_ms
    found = looked(made, 11)
    assert why(found, R1) == (WaitReason.LATE, ())
    assert why(found, R0) == (WaitReason.BEHIND_ROBOT, (R1,))
    assert begun_ms <= found[R1].since_ms <= begun_ms + LOOK_MS + 100 < found[R0].since_ms
    assert {found[R0].place, found[R1].place} <= made.points.keys()
    [chain] = chains(found.values())
    assert ([wait.robot for wait in chain.waits], chain.root) == ([R0, R1], None)
    assert looked(made, 15) == {}, "it dissolves"


def test_a_goal_where_somebody_works_is_waited_for_by_name():
    made = floor(lattice(3, 2), {"R0": ("P0-0", 0.0), "R1": ("P2-0", 0.0)})
    made.busy[R1] = 10**12
    send(made, R1, "P2-0")
    send(made, R0, "P2-0")
    found = looked(made, 20)
    assert why(found, R0) == (WaitReason.GOAL_BUSY, (R1,))
    assert R1 not in found
    assert found[R0].place == "P2-0"


def test_who_cannot_be_sent_away_and_who_does_not_answer_are_told_apart():
    made = floor(lattice(3, 1), {"R0": ("P0-0", 0.0), "R1": ("P1-0", 0.0)})
    made.tick()
    made.busy[R1] = 10**12
    send(made, R0, "P2-0")
    assert why(looked(made, 5), R0) == (WaitReason.ROBOT_FIXED, (R1,))
    made.traffic.lost(R1)
    tick = made.traffic.observe
    made.traffic.observe = lambda report: None if report.robot == R1 else tick(report)  # type: ignore[method-assign]
    found = looked(made, 5)
    assert why(found, R0) == (WaitReason.ROBOT_LOST, (R1,))
    assert why(found, R1) == (WaitReason.NOT_ANSWERING, ()), "for it is in somebody's way"


def test_reserved_ground_is_waited_for_by_its_owners_name():
    made = floor(lattice(4, 1), {"R0": ("P0-0", 0.0)})
    made.tick()
    ring = ((3.5, -0.5), (4.5, -0.5), (4.5, 0.5), (3.5, 0.5))
    made.traffic.claim("c1", "lift maintenance", [ring])
    send(made, R0, "P3-0")
    assert looked(made, 0.9) == {}, "it has not stood for a second"
    owner = f"{EXTERNAL}lift maintenance"
    assert why(looked(made, 8), R0) == (WaitReason.RESERVED_GROUND, (owner,))
    made.traffic.unclaim("c1")
    assert looked(made, 8) == {}


@pytest.mark.parametrize("now", [DoorNow(), DoorNow(works=False)], ids=["shut", "broken"])
def test_a_door_is_waited_for_by_its_name(now: DoorNow):
    made = floor(lattice(4, 1), {"R0": ("P0-0", 0.0)})
    paths = tuple(path.key for path in both("P1-0", "P2-0"))
    made.traffic.lay_doors([Door(id=1, name="D1", area=0, paths=paths)])
    made.traffic.follow_doors({1: now})
    send(made, R0, "P3-0")
    assert why(looked(made, 10), R0) == (WaitReason.DOOR, (f"{DOOR}D1",))
    made.traffic.follow_doors({1: DoorNow(enter=True, leave=True)})
    assert looked(made, 8) == {}


def test_who_may_drive_at_last_is_late_from_then_on():
    made = floor(lattice(4, 1), {"R0": ("P0-0", 0.0)})
    paths = tuple(path.key for path in both("P1-0", "P2-0"))
    made.traffic.lay_doors([Door(id=1, name="D1", area=0, paths=paths)])
    made.traffic.follow_doors({1: DoorNow()})
    send(made, R0, "P3-0")
    assert why(looked(made, 10), R0)[0] is WaitReason.DOOR
    made.robots[R0].frozen_s = 10.0
    made.traffic.follow_doors({1: DoorNow(enter=True, leave=True)})
    opened_ms = made.now_ms
    assert looked(made, 2.8) == {}
    late = looked(made, 1.6)[R0]
    assert late.reason is WaitReason.LATE
    assert late.since_ms >= opened_ms


def test_a_dead_end_that_has_to_empty_is_waited_for():
    area = warehouse(3, 9, 0, blind=(1,))
    made = floor(area, {"R0": ("S0", 0.0), "R1": ("B1-5", math.pi / 2)})
    made.tick()
    made.busy[R1] = 10**12
    send(made, R1, "B1-5")
    send(made, R0, "B1-8")
    found = looked(made, 20)
    assert why(found, R0) == (WaitReason.POCKET_TOKEN, (R1,))


def test_who_has_no_way_says_so():
    points = list(lattice(3, 1).points)
    one_way = [path for path in lattice(3, 1).paths if path.key != "P1-0->P2-0"]
    made = floor(area_of(points, one_way), {"R0": ("P0-0", 0.0)})
    send(made, R0, "P2-0")
    found = looked(made, 3)
    assert why(found, R0) == (WaitReason.NO_WAY, ())
    assert found[R0].place == "P2-0"


@pytest.mark.parametrize("stop", [{"emergency_stop": True}, {"paused": True}, {"controller": "X"}])
def test_a_robot_that_was_stopped_says_so_as_long_as_it_should_drive(stop: dict[str, object]):
    made = floor(lattice(5, 1), {"R0": ("P0-0", 0.0)})
    robot = made.robots[R0]
    report = robot.report
    robot.report = lambda at_ms, area: msgspec.structs.replace(  # type: ignore[method-assign]
        report(at_ms, area), **stop
    )
    assert looked(made, 3) == {}, "it is to go nowhere"
    robot.frozen_s = 1e9
    send(made, R0, "P4-0")
    assert why(looked(made, 5), R0) == (WaitReason.STOPPED, ())


def test_a_robot_that_stands_where_it_cannot_be_moved_says_so():
    made = floor(lattice(3, 3), {"R0": ("P0-0", 0.0)})
    made.robots[R0].x, made.robots[R0].y = 60.0, 60.0
    send(made, R0, "P2-2")
    assert why(looked(made, 3), R0) == (WaitReason.NOT_PLACED, ())


def test_a_pushed_robot_makes_way_for_who_pushed_it():
    made = floor(lattice(4, 1), {"R0": ("P0-0", 0.0), "R1": ("P1-0", 0.0)})
    send(made, R0, "P2-0")
    seen = Counter[tuple[WaitReason, tuple[str, ...]]]()
    while not made.traffic.stands_at(R0, PointName("P2-0")):
        found = looked(made, 0.4)
        if R1 in found:
            seen[why(found, R1)] += 1
    assert set(seen) == {(WaitReason.PUSHED, (R0,))}
    assert made.traffic.pushes >= 1
    assert R1 not in looked(made, 8), "it is out of the way, and has nowhere to go"


def test_who_drives_ahead_on_its_own_way_was_not_pushed():
    made = floor(lattice(8, 1), {"R0": ("P0-0", 0.0), "R1": ("P1-0", 0.0)})
    send(made, R0, "P6-0")
    send(made, R1, "P7-0")
    looked(made, 25)
    assert made.traffic.stands_at(R0, PointName("P6-0"))
    assert made.traffic.pushes == 0


def test_what_makes_planning_due_is_counted():
    made = floor(lattice(4, 1), {"R0": ("P0-0", 0.0)})
    looked(made, 1)
    before = dict(made.traffic.plannings)
    assert before["Robots"] >= 1
    send(made, R0, "P3-0")
    made.tick()
    assert made.traffic.plannings["Goals"] == before.get("Goals", 0) + 1
    looked(made, 8)
    assert made.traffic.plannings["Progress"] >= 2
    made.traffic.claim("c1", "crane", [((9.0, 9.0), (9.5, 9.0), (9.5, 9.5))])
    made.tick()
    assert made.traffic.plannings["Ground"] == 1


UNTOLD_MS = 4_200  # a grant that it does not follow is told of last


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["lattice", "aisles"]))
def test_nobody_stands_without_a_reason_and_reasons_name_others(seed: int, kind: str):
    area = lattice(5, 5) if kind == "lattice" else warehouse(4, 5, 2, blind=(1,))
    names = [point.name for point in area.points]
    made = Floor(area, GROUPS, spread(area, names, 8), names, seed=seed, late=0.15, service_s=4.0)
    stood_ms = dict.fromkeys(made.robots, made.now_ms)
    seen = {name: (robot.x, robot.y, robot.heading) for name, robot in made.robots.items()}
    for _ in range(150):
        found = looked(made, 0.4)
        for name, robot in made.robots.items():
            here = robot.x, robot.y, robot.heading
            wants = name in made.goals and name not in made.busy
            if here != seen[name] or not wants or name in found:
                seen[name], stood_ms[name] = here, made.now_ms
            assert made.now_ms - stood_ms[name] < UNTOLD_MS, name
        for name, wait in found.items():
            assert wait.robot == name
            assert wait.since_ms <= made.now_ms
            assert name not in wait.blockers
            assert set(wait.blockers) <= made.robots.keys()
            assert wait.reason is WaitReason.PUSHED or name not in made.busy


def test_who_is_between_stops_is_named_by_those_whose_way_it_closes_and_nobody_else_is():
    spots = {"R0": ("P0-0", 0.0), "R1": ("P2-0", 0.0), "R2": ("P3-0", 0.0)}
    made = floor(lattice(4, 1), spots)
    across, away = made.robots[R1], made.robots[R2]
    across.x, across.y, across.heading = 3.0, 0.2, math.pi / 2
    away.x, away.y = 20.0, 20.0
    made.tick()
    made.busy[R1] = 10**12  # people have it in hand
    send(made, R0, "P2-0")
    assert why(looked(made, 8), R0) == (WaitReason.ROBOT_FIXED, (R1,))


def test_so_it_is_by_those_who_only_need_a_stop_that_it_stands_too_near_to():
    """Where stops are nearer to each other than a robot is long; found by faults in aisles."""
    made = floor(lattice(13, 1, pitch_m=0.5), {"R0": ("P0-0", 0.0), "R1": ("P9-0", 0.0)})
    between = made.robots[R1]
    between.x, between.y, between.heading = 4.75, 0.2, math.pi / 2
    made.tick()
    made.busy[R1] = 10**12
    send(made, R0, "P12-0")
    assert why(looked(made, 15), R0) == (WaitReason.ROBOT_FIXED, (R1,))


def test_who_is_to_make_way_waits_for_those_who_stand_where_it_is_to_go():
    """Not for the one that it would drive to if it were not pushed: that one waits for it."""
    at = {"R0": "P0-0", "R1": "P1-0", "R2": "P2-0", "R3": "P4-0"}
    made = floor(lattice(5, 1), {name: (point, 0.0) for name, point in at.items()})
    r3 = RobotName("R3")
    made.goals[r3] = Goal(point=PointName("P0-0"), rank=(0, 9, r3))
    while made.robots[r3].speed == 0.0:
        made.tick()
    made.robots[r3].frozen_s = math.inf
    send(made, R0, "P4-0")
    made.goals[R1] = Goal(point=PointName("P0-0"), rank=(0, 1, R1))
    found = looked(made, 5)
    assert why(found, R0) == (WaitReason.BEHIND_ROBOT, (R1,))
    assert why(found, R1) == (WaitReason.BEHIND_ROBOT, (R2,))
    assert why(found, R2) == (WaitReason.BEHIND_ROBOT, (r3,))
    assert why(found, r3) == (WaitReason.LATE, ())


def test_who_would_close_a_ring_waits_for_those_in_it():
    made = floor(TRAP, {name: (at, 0.0) for name, at in STANDS.items()})
    made.traffic.tune(SceneConfig(deadlock_prevention=True))
    made.tick()
    for name in "BCDEF":
        made.robots[RobotName(name)].frozen_s = math.inf
        made.goals[RobotName(name)] = Goal(point=PointName(GOALS[name]), rank=(0, 1, name))
    send(made, RobotName("G"), GOALS["G"])
    found = looked(made, 5)
    assert why(found, RobotName("G")) == (WaitReason.YIELDING, ("B", "C", "D", "E"))
