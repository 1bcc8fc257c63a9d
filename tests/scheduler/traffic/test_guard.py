import time

import msgspec
import pytest
import shapely

from ledger.link import Mark
from ledger.scene_config import SceneConfig
from scheduler.traffic.guard import Breach, BreachKind
from scheduler.traffic.judge import collisions
from tests.scheduler.traffic.floor import Floor, Robot
from tests.scheduler.traffic.maps import lattice, spread, warehouse
from tests.scheduler.traffic.test_traffic import GROUPS, R0, R1, send, until

TOUCH_M2 = 0.01  # of two that come to one spot at one instant; none was seen
BRAKE_MPS2 = 1.8  # of a soft stop


class Stoppable(Robot):
    """A robot with a soft stop, which brakes as hard as the simulator's."""

    stopped = False

    def step(self, dt, chance, late):
        if not self.stopped:
            super().step(dt, chance, late)
            return
        slower = abs(self.speed) - BRAKE_MPS2 * dt
        if slower <= 0.0:
            self.speed = 0.0
            return
        group, limits = self.group, self.group.kinematics
        limits = msgspec.structs.replace(limits, speed_mps_max=slower)
        self.group = msgspec.structs.replace(group, kinematics=limits)
        super().step(dt, chance, late)
        self.group = group


class Guarded(Floor):
    """The guard looks on, and whom it stops stops at its next step but one."""

    def __init__(self, *args, **given):
        super().__init__(*args, **given)
        for robot in self.robots.values():
            robot.__class__ = Stoppable
        self.breaches: list[Breach] = []
        self.seen: list[Breach] = []
        self.cpu_s = 0.0
        self.step_s = 0.0

    def tick(self, report_loss=0.0):
        for name, robot in self.robots.items():
            robot.stopped = any(name in breach.stopped for breach in self.breaches)
        began = time.process_time()
        super().tick(report_loss)
        ended = time.process_time()
        self.breaches = self.traffic.look(self.now_ms)
        self.cpu_s += time.process_time() - ended
        self.step_s += ended - began
        self.seen += [b for b in self.breaches if b not in self.seen]


def overlap_m2(made):
    bodies = made.bodies()
    return sum(bodies[a].intersection(bodies[b]).area for a, b in collisions(bodies))


def guarded(area, starts, **given):
    made = Guarded(area, GROUPS, starts, [], **given)
    made.idle = set(made.robots)
    return made


def blinded(made):
    """Have the conflict table forget conflicts between different cells: a bug as bad as can be."""
    made.traffic.grants._static = lambda cell: (cell,)


def test_a_healthy_floor_gives_no_alarm():
    area = warehouse(4, 6, 4)
    points = [p.name for p in area.points]
    made = Guarded(area, GROUPS, spread(area, points, 8), points, seed=3, late=0.1)
    made.run(120)
    assert made.traffic.breaches_so_far == 0
    assert sum(made.done.values()) > 12


def crowd(seed, *, watched):
    """Six robots on a small lattice whose conflict table is broken; the worst overlap, metres²."""
    area = lattice(4, 4, 1.4)
    points = [p.name for p in area.points]
    starts = spread(area, points, 6)
    made = Guarded(area, GROUPS, starts, points, seed=seed, late=0.1, service_s=0.0)
    blinded(made)
    if not watched:
        made.traffic.look = lambda now_ms: []
    worst_m2 = 0.0
    for _ in range(300):
        made.tick()
        worst_m2 = max(worst_m2, overlap_m2(made))
    return worst_m2, made


def test_a_broken_conflict_table_is_caught_before_bodies_overlap():
    seeds = range(3)
    assert max(crowd(seed, watched=False)[0] for seed in seeds) > 0.2, "nothing to catch"
    for seed in seeds:
        worst_m2, made = crowd(seed, watched=True)
        assert worst_m2 < TOUCH_M2
        assert BreachKind.TAKEN in {breach.kind for breach in made.seen}


def test_robots_that_overlap_are_named_held_and_let_go_when_they_are_apart():
    made = guarded(lattice(8, 1), {"R0": ("P0-0", 0.0), "R1": ("P5-0", 0.0)})
    made.tick()
    made.robots[R1].x = 0.6  # somebody has carried it there
    for _ in range(10):
        made.tick()
    breach = made.breaches[0]
    assert (breach.kind, breach.robots, breach.stopped) == (BreachKind.OVERLAP, (R0, R1), (R0, R1))
    assert 0.1 < breach.x_m < 0.5
    send(made, "R0", "P3-0")
    for _ in range(100):
        made.tick()
    assert made.robots[R0].x == 0.0, "it is held"
    assert made.robots[R0].authority == Mark(), "nor has it any ground to drive on"
    made.robots[R1].x = 10.0
    until(made, "R0", "P3-0")
    assert made.breaches == []
    assert made.traffic.breaches_so_far == 1


def test_who_is_sent_on_by_an_operator_goes_on_until_it_is_in_no_breach():
    made = guarded(lattice(8, 1), {"R0": ("P0-0", 0.0), "R1": ("P5-0", 0.0)})
    made.tick()
    guard = made.traffic._execution.guard
    made.robots[R1].x = 0.6
    for _ in range(10):
        made.tick()
    assert guard.held == {R0, R1}
    made.traffic.excuse(R0)
    assert guard.held == {R1}
    made.robots[R1].x = 10.0
    for _ in range(20):
        made.tick()
    assert guard.held == set()
    made.robots[R1].x = 0.6
    for _ in range(10):
        made.tick()
    assert guard.held == {R0, R1}, "that was for once"


def test_a_robot_driven_by_hand_into_the_way_of_another_is_not_run_into():
    made = guarded(lattice(10, 2), {"R0": ("P0-0", 0.0), "R1": ("P6-1", -1.57)})
    made.tick()
    send(made, "R0", "P9-0")
    by_hand = made.robots[R1]
    made.busy[R1] = made.now_ms + 10**9
    while made.robots[R0].x < 5.0:
        made.tick()
    for _ in range(200):  # slowly, sideways or not
        by_hand.y = max(by_hand.y - 0.05, 0.0)
        by_hand.number += 1
        made.tick()
        assert overlap_m2(made) == 0.0
    way = made.robots[R0]
    assert way.x < 11.4 or way.y == 2.0, "it waits, or goes round"
    by_hand.y = 3.5
    until(made, "R0", "P9-0")
    assert made.traffic.breaches_so_far <= 1


def test_a_robot_that_leaves_its_way_is_held_and_nobody_gets_the_ground_under_it():
    """It has a route, and somebody pulls it off it while it drives."""
    made = guarded(lattice(10, 3), {"R0": ("P0-1", 0.0), "R1": ("P9-0", 3.14)})
    made.tick()
    send(made, "R0", "P9-1")
    robot = made.robots[R0]
    while robot.x < 5.0:
        made.tick()
    robot.speed, robot.frozen_s = 0.0, 1e9
    robot.y, robot.heading = robot.y - 2.0, 1.0
    send(made, "R1", "P0-0")
    for _ in range(300):
        made.tick()
        assert overlap_m2(made) == 0.0
    assert made.breaches[0].kind is BreachKind.OFF
    assert made.breaches[0].stopped == (R0,)
    ground = next(p for p in made.traffic.plans(made.now_ms) if p.robot == R0).spaces
    held = shapely.union_all([shapely.Polygon(space.points) for space in ground])
    assert held.covers(made.bodies()[R0])
    robot.frozen_s = 0.0
    robot.y, robot.heading = robot.y + 2.0, 0.0
    until(made, "R0", "P9-1")
    assert made.breaches == []


@pytest.mark.parametrize("off_m", [0.1, 0.6])
def test_how_far_a_robot_may_be_off_its_ground_is_the_scenes_word(off_m):
    made = guarded(lattice(6, 1), {"R0": ("P0-0", 0.0)})
    made.traffic.tune(SceneConfig(path_distance_m=off_m))
    made.tick()
    send(made, "R0", "P5-0")
    while made.robots[R0].x < 3.0:
        made.tick()
    made.robots[R0].frozen_s = 1e9
    made.robots[R0].y += 0.4
    for _ in range(10):
        made.tick()
    assert bool(made.breaches) is (off_m < 0.4)


def test_who_is_held_gets_no_more_ground_until_it_is_over():
    made = guarded(lattice(14, 1), {"R0": ("P0-0", 0.0)})
    made.tick()
    send(made, "R0", "P13-0")
    robot, guard = made.robots[R0], made.traffic._execution.guard
    while robot.x < 3.0:
        made.tick()
    breach = Breach(kind=BreachKind.OFF, robots=(R0,), x_m=0.0, y_m=0.0)
    guard._breaches[breach.kind, breach.robots] = breach, made.now_ms + 5_000
    authority = robot.authority
    for _ in range(50):
        Floor.tick(made)  # it does not hear of the stop
    assert robot.authority == authority
    until(made, "R0", "P13-0")
