"""Robots whose route was taken back, over a restart of the scheduler: they have not heard of that
and report the route still, but others may have been sent over it.
"""

import pytest

from ledger.ids import PointName, RobotName
from ledger.scene import Group
from scheduler.goal import Goal
from tests.laws.routes import acyclic, connected
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice, spread

GROUP = Group(id=0, name="g")
HALTED, OTHER = RobotName("A"), RobotName("B")
REUSED = 23  # one was put back into the session that it was to leave, and got its numbers twice
RING = 26  # three took back each other's ways in turn for ever


def to(floor, name, point):
    floor.goals[name] = Goal(point=PointName(point), rank=(0, 0, name))


def track_of(floor, name):
    return floor.traffic._tracks[name]


def halt(floor, name):
    """As is done for one that could not get on else."""
    floor.traffic._admission.halt(track_of(floor, name))


def lawful(floor, seconds):
    for _ in range(round(seconds * 10)):
        floor.tick()
        floor.judge()
        connected(floor.traffic)
        acyclic(floor.traffic)


def tick_until(floor, holds, seconds=60):
    for _ in range(seconds * 10):
        if holds():
            return
        floor.tick()
    raise AssertionError(floor.traffic.plans(floor.now_ms))


def between_stops():
    """A on its way from P0-0 to P2-0, behind B, which stands still half way on the next path."""
    floor = Floor(lattice(4, 2), (GROUP,), {"A": ("P0-0", 0.0), "B": ("P2-0", 0.0)}, [])
    floor.idle = set(floor.robots)
    floor.run(1.0)
    to(floor, OTHER, "P3-0")
    tick_until(floor, lambda: floor.robots[OTHER].x > 4.5)
    floor.robots[OTHER].frozen_s = 1_000.0
    to(floor, HALTED, "P2-0")
    tick_until(floor, lambda: track_of(floor, HALTED).promised and floor.robots[HALTED].x > 1.0)
    return floor


def test_a_route_that_was_taken_back_is_not_driven_on_after_a_restart():
    floor = between_stops()
    halt(floor, HALTED)
    session = floor.robots[HALTED].session
    plans = floor.traffic.plans(floor.now_ms)
    assert not any(plan.untravelled for plan in plans if plan.robot == HALTED)
    floor.restart(plans)
    lawful(floor, 20.0)
    assert floor.robots[HALTED].session != session, "it begins anew"
    floor.robots[OTHER].frozen_s = 0.0
    lawful(floor, 30.0)
    assert floor.done == {HALTED: 1, OTHER: 1}


@pytest.mark.parametrize("seed", [*range(10), REUSED, RING])
def test_what_others_were_granted_meanwhile_stays_theirs(seed):
    """Found on a lattice with 40 robots: one that stood halted between stops had its old route
    again after a restart, and with it ground that the one behind it had been granted.
    """
    area = lattice(4, 3)
    points = [point.name for point in area.points]
    floor = Floor(area, (GROUP,), spread(area, points, 6), points, seed)
    floor.run(10.0)
    for _ in range(4):
        for name in floor.chance.sample(sorted(floor.robots), 2):
            if track_of(floor, name).pieces and track_of(floor, name).trouble is None:
                halt(floor, name)
        lawful(floor, floor.chance.uniform(0.1, 4.0))
        floor.restart(floor.traffic.plans(floor.now_ms))
        lawful(floor, 4.0)
    done = dict(floor.done)
    tick_until(
        floor,
        lambda: all(floor.done[n] > done[n] for n in done) or floor.traffic.stuck(floor.now_ms),
        seconds=200,
    )  # two that were halted nose to nose need a person, who is told
