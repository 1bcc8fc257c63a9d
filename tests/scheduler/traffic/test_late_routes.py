"""Robots that are heard of long after the scheduler started anew: others have been sent meanwhile,
who did not know where their routes go.
"""

import math
from functools import partial
from itertools import pairwise

import msgspec
import pytest

from ledger.ids import PointName, RobotName
from ledger.link import Space
from ledger.scene import Group, Point
from scheduler.goal import Goal
from scheduler.traffic.routes import Builder, Leg, granted
from tests.laws.routes import acyclic, connected
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import area_of, both, lattice, spread

GROUP = Group(id=0, name="g")
CUT, OTHER = RobotName("A"), RobotName("B")


def to(floor, name, point):
    floor.goals[name] = Goal(point=PointName(point), rank=(0, 0, name))


def cut(robot):
    robot.tell, robot.report_news = (lambda _: None), (lambda *_: None)


def mend(robot):
    del robot.tell, robot.report_news
    robot.tells = True


def restart_without(floor, *names, route_known):
    """A new scheduler knows of them what ground they held, and perhaps where they were to go."""
    plans = [plan for plan in floor.traffic.plans(floor.now_ms) if plan.robot in names]
    if not route_known:
        plans = [msgspec.structs.replace(plan, untravelled=()) for plan in plans]
    floor.restart(plans)
    floor.run(3.0)
    for name in names:
        floor.traffic.lost(name)


def plan_of(floor, name):
    return next(plan for plan in floor.traffic.plans(floor.now_ms) if plan.robot == name)


def lawful(floor, seconds):
    for _ in range(round(seconds)):
        floor.run(1.0)
        connected(floor.traffic)
        acyclic(floor.traffic)


def crowded(seed):
    area = lattice(4, 3)
    points = [point.name for point in area.points]
    floor = Floor(area, (GROUP,), spread(area, points, 5), points, seed)
    floor.run(10.0)
    return floor


def tick_until(floor, holds):
    for _ in range(600):
        if holds():
            return
        floor.tick()


def under_way(floor, *names):
    """With ground before them, if possible, that they may not drive on yet."""
    tick_until(floor, lambda: all(floor.traffic._tracks[name].promised for name in names))


def all_get_on(floor):
    done = dict(floor.done)
    for _ in range(12):
        lawful(floor, 10)
        if all(floor.done[name] > done[name] for name in floor.robots):
            return
    raise AssertionError(floor.traffic.plans(floor.now_ms))


def test_a_route_whose_end_was_given_to_another_is_not_driven_on():
    """Found by two days of faults: each of the two waited for the other for ever."""
    floor = Floor(lattice(5, 2), (GROUP,), {"A": ("P2-0", 0.0), "B": ("P1-0", 0.0)}, [])
    floor.idle = set(floor.robots)
    floor.run(1.0)
    to(floor, OTHER, "P0-0")
    to(floor, CUT, "P1-0")
    under_way(floor, CUT)
    assert floor.traffic._tracks[CUT].promised
    cut(floor.robots[CUT])
    restart_without(floor, CUT, route_known=False)
    floor.run(20.0)
    assert floor.done[OTHER] == 1
    to(floor, OTHER, "P1-0")
    there = floor.traffic.roadmap.place[PointName("P1-0")]
    tick_until(floor, lambda: floor.traffic._tracks[OTHER].place == there)
    assert floor.traffic._tracks[OTHER].place == there
    mend(floor.robots[CUT])
    lawful(floor, 15)
    to(floor, OTHER, "P2-0")
    lawful(floor, 60)
    assert floor.done == {CUT: 1, OTHER: 3}


@pytest.mark.parametrize("route_known", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_whoever_is_heard_of_late_brings_no_ring(seed, route_known):
    floor = crowded(seed)
    name = floor.chance.choice(sorted(floor.robots))
    under_way(floor, name)
    cut(floor.robots[name])
    restart_without(floor, name, route_known=route_known)
    lawful(floor, floor.chance.randrange(1, 20))
    mend(floor.robots[name])
    if route_known:  # nobody was sent over it, so it is driven on as it was
        floor.tick()
        floor.tick()
        assert floor.traffic._tracks[name].trouble is None
    all_get_on(floor)


def test_nor_if_the_scheduler_starts_twice_meanwhile():
    floor = crowded(0)
    name = RobotName("R03")
    under_way(floor, name)
    cut(floor.robots[name])
    left = plan_of(floor, name).untravelled
    assert left
    for _ in range(2):
        restart_without(floor, name, route_known=True)
        assert plan_of(floor, name).untravelled == left
    promised = len(floor.traffic._tracks[name].promised)
    lawful(floor, 20)
    assert len(floor.traffic._tracks[name].promised) == promised > 0, "nobody drops it meanwhile"
    mend(floor.robots[name])
    all_get_on(floor)


@pytest.mark.parametrize("seed", [3, 5, 11])
def test_nor_do_two_of_them_who_come_back_one_after_the_other(seed):
    floor = crowded(seed)
    for _ in range(3):
        names = floor.chance.sample(sorted(floor.robots), 2)
        under_way(floor, *names)
        for name in names:
            cut(floor.robots[name])
        restart_without(floor, *names, route_known=True)
        lawful(floor, floor.chance.randrange(1, 20))
        for name in names:
            mend(floor.robots[name])
            lawful(floor, floor.chance.randrange(1, 6))
        all_get_on(floor)


def reports_short(robot, metres):
    """It has come to the end of a cell, but for what its progress was rounded down by."""
    report = robot.report

    def short(*when):
        told = report(*when)
        at = msgspec.structs.replace(told.progress, along_m=told.progress.along_m - metres)
        return msgspec.structs.replace(told, progress=at)

    robot.report = short


@pytest.mark.parametrize("metres", [0.0, 0.0005])
def test_what_it_was_granted_without_hearing_of_it_stays_its_own(metres):
    """Found by faults with a restart a minute: it took back the ground that it had left, which
    another had by then, and gave up what it had been granted since. So did one whose progress was a
    hair short of the end of that ground.
    """
    starts = {"A": ("P0-0", 0.0), "B": ("P2-0", 0.0), "C": ("P0-1", 0.0)}
    floor = Floor(lattice(5, 2), (GROUP,), starts, [])
    floor.idle = set(floor.robots)
    floor.run(1.0)
    to(floor, OTHER, "P4-0")
    tick_until(floor, lambda: floor.robots[OTHER].x > 4.5)
    floor.robots[OTHER].frozen_s = 20.0
    to(floor, CUT, "P2-0")
    under_way(floor, CUT)
    floor.run(10.0)
    robot = floor.robots[CUT]
    assert robot.speed == 0.0
    robot.tell = lambda _: None
    tick_until(floor, lambda: floor.traffic._tracks[CUT].authority > robot.authority)
    floor.run(1.0)
    held = plan_of(floor, CUT).spaces
    floor.restart(floor.traffic.plans(floor.now_ms))
    del robot.tell
    reports_short(robot, metres)
    unheard = floor.robots[RobotName("C")]
    cut(unheard)  # until all are heard nobody is granted anything
    tick_until(floor, lambda: floor.traffic._tracks[CUT].placed)
    assert plan_of(floor, CUT).spaces == held
    mend(unheard)
    lawful(floor, 30)
    assert floor.done == {CUT: 1, OTHER: 1, "C": 0}


def test_a_way_to_and_fro_has_the_same_ground_twice_and_only_one_was_granted():
    floor = Floor(lattice(2, 1), (GROUP,), {"A": ("P0-0", 0.0)}, [])
    roadmap = floor.traffic.roadmap
    footprint = roadmap.footprint_of[GROUP.id]
    number = {p.key: k for k, p in enumerate(roadmap.net.paths) if not p.backward}
    there, back = number["P0-0->P1-0"], number["P1-0->P0-0"]
    build = Builder(roadmap, footprint, roadmap.net.start[there], 0.0, 1)
    build.drive([Leg(path=there)], 0, 1)
    count = len(build.slots)
    build.drive([Leg(path=back)], 1, 2)
    build.rest()
    held = [Space(points=roadmap.ring(slot.cell)) for slot in build.slots]
    turn, first = count, count + 1
    assert held[first] == held[count - 1] != held[turn]
    known = partial(granted, roadmap)
    assert known(build.slots[turn:], 0, held[count - 1 : count]) == 0, "it has not turned yet"
    assert known(build.slots, 0, held[:3]) == 3
    assert known(build.slots[1:], 0, held[:3]) == 2, "one is left behind since"
    assert known(build.slots, 2, held[2:4]) == 4
    assert known(build.slots, 1, held[2:4]) == 0
    assert known(build.slots, 0, []) == 0


def crossing():
    """A lane and one that ends on it, with a point each half a metre: a robot is longer."""
    lane = [Point(name=PointName(f"r{k}"), x_m=k / 2, y_m=0.0) for k in range(13)]
    side = [Point(name=PointName(f"c{k}"), x_m=3.0, y_m=k / 2) for k in range(1, 7)]
    ways = (*pairwise(lane), *pairwise([lane[6], *side]))
    return area_of([*lane, *side], [path for a, b in ways for path in both(a.name, b.name)])


def test_a_silent_robot_keeps_the_ground_to_turn_on():
    """Found by faults with a restart a minute: its route began with a turn, which the last plan did
    not name. Another was let so near to it that it could not turn, and each waited for the other.
    """
    ahead = RobotName("C")
    starts = {"A": ("c5", -math.pi / 2), "B": ("r0", 0.0), "C": ("r4", 0.0)}
    floor = Floor(crossing(), (GROUP,), starts, [])
    floor.idle = set(floor.robots)
    to(floor, ahead, "r12")
    tick_until(floor, lambda: floor.robots[ahead].x > 4.0)
    floor.robots[ahead].frozen_s = math.inf  # too near to turn beside it
    to(floor, CUT, "r6")
    tick_until(floor, lambda: floor.done[CUT])
    to(floor, CUT, "c5")
    to(floor, OTHER, "r9")
    floor.run(3.0)
    assert plan_of(floor, CUT).turns
    cut(floor.robots[CUT])
    for _ in range(2):
        restart_without(floor, CUT, route_known=True)
        lawful(floor, 10)
    floor.robots[ahead].frozen_s = 0.0
    lawful(floor, 20)
    mend(floor.robots[CUT])
    lawful(floor, 40)
    assert floor.done == {CUT: 2, OTHER: 1, ahead: 1}
