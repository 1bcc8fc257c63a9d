"""The last rungs of liveness, on floors with robots that drive: nobody hangs without a word."""

import math
import random
from functools import partial

import pytest

from ledger.ids import PointName, RobotName
from ledger.scene import Group
from scheduler.goal import Goal
from scheduler.traffic.halts import HALTED_MS
from scheduler.traffic.ladder import ALARM_MS, IN_WAY, RETRY_MS, WORKING_MS, Ladder
from scheduler.traffic.planner import Distributed
from scheduler.traffic.stalls import STALL_MS
from tests.scheduler.traffic.floor import Floor
from tests.scheduler.traffic.maps import lattice, warehouse
from tests.scheduler.traffic.stuck import CROSS, LOOP, PASSING_PLACE, RING, drawn

GROUPS = (Group(id=0, name="g"),)
BOUND_S = (STALL_MS + RETRY_MS + ALARM_MS) / 1000 + 5


def floor(area, at, goals, **given):
    made = Floor(area, GROUPS, {name: (p, 0.0) for name, p in at.items()}, [], **given)
    made.idle = set(made.robots)
    for k, (name, point) in enumerate(goals.items()):
        made.goals[RobotName(name)] = Goal(point=PointName(point), rank=(0, k, name))
    return made


def until_done(made, limit_s=300):
    """Everybody has been where it was to go, and worked there."""
    for _ in range(limit_s * 10):
        made.tick()
        if not made.goals:
            return
    raise AssertionError(made.traffic.plans(0))


def stuck(made):
    return made.traffic.stuck(made.now_ms)


@pytest.mark.parametrize(
    ("area", "at", "goals"),
    [
        pytest.param(
            PASSING_PLACE,
            {"A": "c", "B": "d"},
            {"A": "d", "B": "c"},
            id="two that want each other's stop in a blind lane",
        ),
        pytest.param(
            RING,
            {"A": "a", "B": "b", "C": "c", "D": "d", "E": "e"},
            {"A": "d", "B": "e", "C": "a", "D": "b", "E": "c"},
            id="a ring with one hole",
        ),
        pytest.param(
            LOOP,
            {"A": "b", "B": "c", "C": "d", "D": "e", "E": "f"},
            {"A": "a", "D": "c"},
            id="a one-way loop with one hole",
        ),
        pytest.param(
            CROSS,
            {"A": "a", "B": "b", "D": "d"},
            {"A": "d", "D": "a", "B": "c"},
            id="a lane with two places to pass",
        ),
        pytest.param(
            lattice(3, 3),
            {f"R{k}": f"P{k // 3}-{k % 3}" for k in range(8)},
            {f"R{k}": f"P{2 - k // 3}-{2 - k % 3}" for k in range(8)},
            id="eight robots on nine stops",
        ),
        pytest.param(
            warehouse(2, 4, 1, blind=(1,)),
            {"A": "B1-2", "B": "B1-0", "C": "S0"},
            {"C": "B1-3"},
            id="robots parked in a blind aisle that somebody wants to the end of",
        ),
    ],
)
def test_named_situations_dissolve(area, at, goals):
    made = floor(area, at, goals, service_s=2.0)
    until_done(made)
    made.judge()
    assert not stuck(made)


def alarm(made, robots, bound_s):
    """Wait for the alarm of one of these robots; it must come within its bound."""
    for _ in range(int(bound_s * 10)):
        made.tick()
        for name in robots:
            if RobotName(name) in stuck(made):
                return stuck(made)[RobotName(name)]
    raise AssertionError(made.traffic.plans(0))


def test_more_robots_than_a_region_has_room_for_are_told_of_until_one_is_taken_away():
    made = floor(CROSS, {"A": "a", "B": "s", "C": "t", "D": "d", "E": "c"}, {"A": "d", "D": "a"})
    told = alarm(made, "AD", BOUND_S)  # each wants to where the other is
    assert "there is no way" in told.text
    assert {told.robot, *told.robots} == {"A", "B", "C", "D", "E"}
    for name in ("B", "E"):
        made.robots.pop(RobotName(name))
        made.traffic.remove(RobotName(name))
    until_done(made)
    assert not stuck(made)


def test_who_does_not_answer_is_named_by_those_it_blocks():
    made = floor(CROSS, {"A": "a", "B": "b"}, {"A": "d"})
    made.tick()
    made.traffic.lost(RobotName("B"))
    silent = made.robots.pop(RobotName("B"))
    told = alarm(made, "A", BOUND_S)
    assert told.robots == ("B",)
    assert "does not answer" in told.text
    assert told.goal == "d"
    made.robots[silent.name] = silent
    until_done(made)
    assert not stuck(made)


def test_reserved_ground_in_the_way_is_named_by_its_owner():
    made = floor(CROSS, {"A": "a"}, {"A": "d"})
    made.tick()
    made.traffic.claim("1", "crane", [((3.5, -0.5), (4.5, -0.5), (4.5, 0.5), (3.5, 0.5))])
    told = alarm(made, "A", WORKING_MS / 1000 + 5)
    assert told.claims == ("crane",)
    made.traffic.unclaim("1")
    until_done(made)
    assert not stuck(made)


def test_who_only_works_in_the_way_is_given_time_for_it():
    made = floor(CROSS, {"A": "a", "B": "b"}, {"A": "d"}, service_s=1.0)
    made.busy[RobotName("B")] = made.now_ms + 100_000
    made.goals[RobotName("B")] = Goal(point=PointName("b"), rank=(0, 9, "B"))
    for _ in range(950):
        made.tick()
        assert not stuck(made)
    until_done(made)


def test_a_robot_that_has_leave_to_drive_and_does_not_is_named():
    made = floor(CROSS, {"A": "a", "B": "b"}, {"B": "d", "A": "c"})
    for _ in range(20):
        made.tick()
    made.robots[RobotName("B")].frozen_s = math.inf
    told = alarm(made, "A", (STALL_MS + STALL_MS + WORKING_MS) / 1000 + 10)
    assert told.robots == ("B",)
    assert "has leave to drive" in told.text
    made.robots[RobotName("B")].frozen_s = 0.0
    until_done(made)
    assert not stuck(made)


def test_one_without_a_route_is_not_said_to_have_leave_to_drive():
    """People had pushed one on to the route of another."""
    made = floor(CROSS, {"A": "a", "B": "b"}, {})
    made.tick()
    tracks = made.traffic._tracks
    held_up = partial(Ladder()._held_up, tracks, tracks[RobotName("A")])
    assert held_up(lambda track: "B" if track.name == "A" else "", 0) is None
    why = held_up(lambda track: "B" if track.name == "A" else "", STALL_MS)
    assert why.text == f"B {IN_WAY}"


class Sends(Distributed):
    """A planner that is wrong: it has one robot drive one move, and nobody else."""

    def __init__(self, robot, start, end):
        self.robot, self.start, self.end = robot, start, end

    def propose(self, world):
        roadmap, place = world.roadmap, world.roadmap.place
        here = [a for a in world.agents if (a.name, a.place) == (self.robot, place[self.start])]
        return [
            (agent.name, (move,))
            for agent in here
            for move in roadmap.leaving[agent.place]
            if roadmap.moves.end[move] == place[self.end]
        ]


def test_a_way_that_would_need_a_frozen_robot_to_move_keeps_nobody_else_from_theirs():
    """It was found, followed in vain and found again, for minutes, and nobody was after it."""
    two_lanes = drawn(
        {"a": (0, 0), "b": (2, 0), "c": (4, 0), "s": (2, 2), "x": (0, 9), "y": (2, 9)},
        "ab bc bs xy",
    )
    made = floor(two_lanes, {"A": "a", "B": "b", "C": "x"}, {"A": "c"}, service_s=1.0)
    made.traffic._planner = Sends("B", "b", "c")
    while made.robots[RobotName("B")].speed == 0.0:
        made.tick()
    made.robots[RobotName("B")].frozen_s = math.inf
    for _ in range(50):
        made.tick()
    made.goals[RobotName("C")] = Goal(point=PointName("y"), rank=(0, 1, "C"))
    for _ in range((STALL_MS + 2 * HALTED_MS) // 100):
        made.tick()
    assert RobotName("C") not in made.goals
    assert RobotName("A") in made.goals
    made.robots[RobotName("B")].frozen_s = 0.0
    until_done(made)


class Astray(Distributed):
    """A planner that is wrong: it keeps robots where they are farthest from their goals."""

    def propose(self, world):
        found = []
        for agent in world.agents:
            if agent.fixed or agent.goal is None:
                continue
            ends = world.roadmap.moves.end
            ways = [
                (-agent.costs.cost_s(ends[move], world.roadmap.heading_end[move], agent.goal), move)
                for move in world.roadmap.leaving[agent.place]
                if move not in agent.costs.closed_moves
            ]
            found.append((agent.name, (min(ways)[1],)))
        return found


def test_a_robot_that_is_driven_to_and_fro_for_ever_is_brought_to_its_goal():
    made = floor(RING, {"A": "a"}, {"A": "c"})
    made.traffic._planner = Astray()
    until_done(made, 150)


def crowd(seed):
    """Nearly as many robots as there is room for, on a small map, bound for anywhere."""
    chance = random.Random(seed)
    area = chance.choice((PASSING_PLACE, RING, LOOP, CROSS, lattice(3, 3), lattice(2, 5)))
    names = [point.name for point in area.points]
    robots = chance.randint(len(names) // 2, len(names) - 1)
    starts = {f"R{k}": (p, 0.0) for k, p in enumerate(chance.sample(names, robots))}
    return Floor(area, GROUPS, starts, names, seed=seed, late=0.1, service_s=2.0)


def hangs_unsaid(made, seconds):
    """Run; the first robot that stands for long without an alarm for it or for who is with it."""
    waits = dict.fromkeys(made.robots, 0)
    for k in range(round(seconds * 10)):
        done = dict(made.done)
        made.tick()
        if k % 20 == 0:
            made.judge()
        told = {name for s in stuck(made).values() for name in (s.robot, *s.robots)}
        for name in made.robots:
            rests = made.done[name] > done[name] or name in told or name not in made.goals
            waits[name] = 0 if rests else waits[name] + 1
            if waits[name] > 4 * WORKING_MS / 100:
                return name
    return None


def test_a_search_in_vain_is_repeated_ever_more_seldom():
    stands = {"A": "a", "B": "b", "C": "c", "D": "d", "E": "e", "F": "f"}
    made = floor(RING, stands, {"A": "b"})
    for _ in range(STALL_MS // 100 + 2_000):
        made.tick()
    assert 3 <= made.traffic.ladder["searches"] <= 7  # every ten seconds it would be twenty
    made.robots.pop(RobotName("F"))
    made.traffic.remove(RobotName("F"))
    until_done(made)


def test_on_crowded_small_maps_nobody_hangs_without_a_word():
    for seed in (3, 11):  # a way out in one, an alarm in the other
        assert hangs_unsaid(crowd(seed), 400) is None


def stage(seed):
    """For the soak: half an hour on a crowded small map."""
    assert hangs_unsaid(crowd(seed), 1_800) is None
