"""TP2: what it proposes can be driven, is never less than PIBT's, and is the same every time."""

import math
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.ids import PointName, RobotName
from ledger.scene import Group, Kinematics, PointKind
from ledger.scene_config import SceneConfig, TrafficMethod
from scheduler.goal import Goal
from scheduler.traffic import pibt
from scheduler.traffic.ahead import Ahead
from scheduler.traffic.venus import Settings, Venus
from scheduler.traffic.world import room
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice, spread, warehouse
from tests.scheduler.traffic.test_pibt import worlds

GROUPS = (Group(id=0, name="g"),)
VENUS = SceneConfig(traffic_method=TrafficMethod.VENUS)
FEW = settings(max_examples=15, deadline=None)
VERY_FEW = settings(max_examples=4, deadline=None)


def looking_ahead(world, free_s=0.0):
    """Robots that stand where their moves end, or get there in so many seconds."""
    look = Ahead(footprint=0, limits=Kinematics(), near=True, free_s=free_s)
    world.ahead = {agent.name: look for agent in world.agents}
    return world


def floor(area, starts, goals=(), method=VENUS, **given_):
    made = Floor(area, GROUPS, starts, list(goals), config=method, **given_)
    if not goals:
        made.idle = set(made.robots)
    return made


def send(made, robot, point):
    made.goals[RobotName(robot)] = Goal(point=PointName(point), rank=(0, made.now_ms, robot))


def all_arrive(made, seconds):
    for _ in range(round(seconds * 10)):
        made.tick()
        if made.now_ms % 500 == 0:
            made.judge()
        if all(made.traffic.stands_at(name, goal.point) for name, goal in made.goals.items()):
            return True
    return False


@FEW
@given(worlds(), st.sampled_from((0.0, 1.5)))
def test_what_is_proposed_can_be_driven_one_after_another(world, free_s):
    position = {agent.name: agent.place for agent in world.agents}
    at = {agent.name: agent for agent in world.agents}
    for name, moves in Venus(Settings()).propose(looking_ahead(world, free_s)):
        agent = at[name]
        assert not agent.fixed
        need = room(world, agent.place, agent.heading_rad, moves, agent.goal)
        others = sum(1 << place for other, place in position.items() if other != name)
        assert not need & others & ~(1 << agent.place)
        for move in moves:
            assert world.roadmap.moves.start[move] == position[name]
            position[name] = world.roadmap.moves.end[move]


@VERY_FEW
@given(worlds())
def test_the_same_calls_give_the_same_proposals(world):
    first, second = (Venus(Settings()) for _ in range(2))
    looking_ahead(world)
    for world.now_ms in (0, 400, 3_000):
        assert first.propose(world) == second.propose(world)


@FEW
@given(worlds())
def test_without_a_plan_for_everybody_it_proposes_what_pibt_does(world):
    venus = Venus(Settings(interval_ms=1))  # time for hardly anything
    proposal = venus.propose(looking_ahead(world))
    if venus.counted.incomplete:
        assert proposal == pibt.propose(world)


def test_while_it_thinks_pibt_proposes_and_a_plan_that_comes_late_is_taken():
    class Later:
        def __init__(self, work):
            self.work, self.ready = work, False

        def done(self):
            return self.ready

        def result(self):
            return self.work()

    asked = []

    def think(work):
        asked.append(Later(work))
        return asked[-1]

    made = Floor(lattice(4, 4), GROUPS, {"R0": ("P0-0", 0.0), "R1": ("P3-0", 0.0)}, [])
    made.idle = set(made.robots)
    made.traffic._think = think
    made.traffic.tune(VENUS)
    send(made, "R0", "P3-3")
    for _ in range(30):
        made.tick()
    venus = made.traffic._planner
    assert len(asked) == 1, "one search at a time"
    assert venus.counted.by_pibt == venus.counted.proposals > 0
    assert made.robots[RobotName("R0")].x > 0.0, "nobody waits for the search"
    asked[0].ready = True  # of a moment that is long past
    made.tick()
    for _ in range(400):
        made.tick()
        asked[-1].ready = True
    made.judge()
    assert venus.counted.plans > 1
    assert made.traffic.stands_at(RobotName("R0"), PointName("P3-3"))


def test_a_thread_may_search_and_nobody_waits_for_it():
    made = floor(lattice(5, 5), {"R0": ("P0-0", 0.0), "R1": ("P4-4", 0.0)})
    with ThreadPoolExecutor(max_workers=1) as thinker:
        made.traffic._think = thinker.submit
        made.traffic.tune(SceneConfig())
        made.traffic.tune(VENUS)
        send(made, "R0", "P4-4")
        send(made, "R1", "P0-0")
        assert all_arrive(made, 90)
    assert made.traffic._planner.counted.plans > 1


def test_a_switch_on_the_way_loses_nothing():
    area = lattice(5, 5)
    names = [point.name for point in area.points]
    made = floor(area, spread(area, names, 6), names, seed=4, service_s=1.0)
    for method in (TrafficMethod.DISTRIBUTED, TrafficMethod.VENUS) * 3:
        promised = {name: (t.place, len(t.promised)) for name, t in made.traffic._tracks.items()}
        made.traffic.tune(SceneConfig(traffic_method=method))
        after = {name: (t.place, len(t.promised)) for name, t in made.traffic._tracks.items()}
        assert after == promised
        made.run(10)
    assert min(made.done.values()) >= 1


def test_other_settings_are_heeded_and_the_same_keep_the_plan():
    made = floor(lattice(3, 3), {"R0": ("P0-0", 0.0)})
    before = made.traffic._planner
    made.traffic.tune(VENUS)
    assert made.traffic._planner is before
    made.traffic.tune(
        SceneConfig(
            traffic_method=TrafficMethod.VENUS,
            cbs_high_w=2.0,
            cbs_low_w=1.0,
            traffic_plan_interval_ms=900,
        )
    )
    assert made.traffic._planner.settings == Settings(high_w=2.0, low_w=1.0, interval_ms=900)


def test_in_a_single_lane_who_is_in_the_way_comes_out_first():
    made = floor(warehouse(2, 6, 2), {"R0": ("B0-1", math.pi / 2), "R1": ("S0", 0.0)})
    send(made, "R0", "S1")
    send(made, "R1", "B0-4")
    assert all_arrive(made, 90)


@pytest.mark.parametrize("turned", [False, True])
def test_two_robots_swap_their_places_in_a_corridor_with_a_bay(turned):
    area = lattice(5, 2)  # a lane and the bays beside it
    made = floor(area, {"R0": ("P0-0", 0.0), "R1": ("P4-0", math.pi)})
    send(made, "R1" if turned else "R0", "P4-0" if not turned else "P0-0")
    send(made, "R0" if turned else "R1", "P0-0" if not turned else "P4-0")
    assert all_arrive(made, 60)


def aisles(seed, robots=5):
    area = warehouse(4, 8, 4, blind=(1,))
    ends = [point.name for point in area.points if point.kind is not PointKind.WAYPOINT]
    return floor(area, spread(area, ends, robots), ends, seed=seed, late=0.1)


def test_aisles_and_dead_ends_keep_going():
    made = aisles(seed=2)
    made.run(120)
    assert min(made.done.values()) >= 1
    assert made.traffic._planner.counted.plans > 0


def stage(seed):
    """For the soak: aisles with dead ends, and a switch of planners now and then."""
    made = aisles(seed, robots=8)
    for k in range(6):
        method = TrafficMethod.DISTRIBUTED if k % 3 == 2 else TrafficMethod.VENUS
        made.traffic.tune(SceneConfig(traffic_method=method))
        made.run(120)
    assert min(made.done.values()) >= 1
