"""Robots that are heard of long after the scheduler started anew: others have been sent meanwhile,
who did not know where their routes go.
"""

import pytest

from ledger.ids import PointName, RobotName
from ledger.scene import Group
from scheduler.goal import Goal
from tests.laws.routes import acyclic, connected
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice, spread

GROUP = Group(id=0, name="g")
CUT, OTHER = RobotName("A"), RobotName("B")


def to(floor, name, point):
    floor.goals[name] = Goal(point=PointName(point), rank=(0, 0, name))


def cut(robot):
    robot.tell, robot.report_news = (lambda _: None), (lambda *_: None)


def mend(robot):
    del robot.tell, robot.report_news
    robot.tells = True


def restart_without(floor, name):
    """A new scheduler knows of that robot only what ground it held."""
    rings = {plan.robot: plan.spaces for plan in floor.traffic.plans(floor.now_ms)}
    floor.restart()
    floor.traffic.remember(name, [space.points for space in rings[name]])
    floor.run(3.0)
    floor.traffic.lost(name)


def lawful(floor, seconds):
    for _ in range(round(seconds)):
        floor.run(1.0)
        connected(floor.traffic)
        acyclic(floor.traffic)


def test_a_route_whose_end_was_given_to_another_is_not_driven_on():
    """Found by two days of faults: each of the two waited for the other for ever."""
    floor = Floor(lattice(5, 2), (GROUP,), {"A": ("P2-0", 0.0), "B": ("P1-0", 0.0)}, [])
    floor.idle = set(floor.robots)
    floor.run(1.0)
    to(floor, OTHER, "P0-0")
    to(floor, CUT, "P1-0")
    while floor.traffic._tracks[CUT].commit == 0:
        floor.tick()
    assert floor.traffic._tracks[CUT].promised
    cut(floor.robots[CUT])
    restart_without(floor, CUT)
    floor.run(20.0)
    assert floor.done[OTHER] == 1
    to(floor, OTHER, "P1-0")
    there = floor.traffic.roadmap.place[PointName("P1-0")]
    while floor.traffic._tracks[OTHER].place != there:
        floor.tick()
    mend(floor.robots[CUT])
    lawful(floor, 15)
    to(floor, OTHER, "P2-0")
    lawful(floor, 60)
    assert floor.done == {CUT: 1, OTHER: 3}


@pytest.mark.parametrize("seed", range(12))
def test_whoever_is_heard_of_late_brings_no_ring(seed):
    area = lattice(4, 3)
    points = [point.name for point in area.points]
    floor = Floor(area, (GROUP,), spread(area, points, 5), points, seed)
    floor.run(10.0)
    name = floor.chance.choice(sorted(floor.robots))
    while not floor.traffic._tracks[name].promised:
        floor.tick()
    cut(floor.robots[name])
    restart_without(floor, name)
    lawful(floor, floor.chance.randrange(1, 20))
    mend(floor.robots[name])
    done = dict(floor.done)
    for _ in range(12):
        lawful(floor, 10)
        if all(floor.done[other] > done[other] for other in floor.robots):
            return
    raise AssertionError(floor.traffic.plans(floor.now_ms))
