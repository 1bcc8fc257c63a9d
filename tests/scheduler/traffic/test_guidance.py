import random

import numpy as np
import pytest

from ledger.ids import PointName
from ledger.scene import Group
from scheduler.traffic.compile import compile_area
from scheduler.traffic.costs import Costs
from scheduler.traffic.guidance import AGAINST, WAYS_OUT_MAX, Load, guided, learned, priced
from tests.scheduler.traffic.maps import lattice

GROUP = Group(id=0, name="g")
ROADMAP = compile_area(lattice(12, 2), [GROUP])  # two long lanes, tied together at every point
PLAIN = Costs(ROADMAP, GROUP.kinematics)
EVERYWHERE = range(ROADMAP.places.stops)
ENDS = [ROADMAP.place[PointName(f"P{x}-{y}")] for x in (0, 11) for y in (0, 1)]


def driven(costs, ways=200):
    """How often each move is driven on the cheapest ways from end to end."""
    chance, flow = random.Random(1), np.zeros(ROADMAP.moves.count)
    for _ in range(ways):
        place, goal = chance.choice(ENDS), chance.choice(ENDS)
        heading_rad = 0.0
        while place != goal:
            _, move = min(costs.ways(place, heading_rad, goal))
            flow[move] += 1
            place, heading_rad = ROADMAP.moves.end[move], ROADMAP.heading_end[move]
    return flow


def head_on(flow):
    """Share of the flow that has as much against it."""
    moves = ROADMAP.moves
    between = dict(zip(zip(moves.start, moves.end, strict=True), flow, strict=True))
    met = [min(n, between.get((b, a), 0.0)) for (a, b), n in between.items()]
    return sum(met) / sum(flow)


def test_two_way_lanes_sort_themselves_by_direction():
    load = Load(sources=ENDS, goals=ENDS, share=0.3)
    guided = Costs(ROADMAP, GROUP.kinematics, learned(PLAIN, load))
    before, after = driven(PLAIN), driven(guided)
    assert head_on(after) < head_on(before) / 2
    assert after.sum() < before.sum() * 1.3, "the detours must stay small"


def test_the_fewer_robots_the_less_guidance():
    few, many = (
        sum(learned(PLAIN, Load(sources=EVERYWHERE, goals=EVERYWHERE, share=share)))
        for share in (0.02, 0.2)
    )
    assert 0 < few < many / 5


def test_the_same_load_gives_the_same_guidance():
    load = Load(sources=EVERYWHERE, goals=EVERYWHERE, share=0.1)
    assert learned(PLAIN, load) == learned(PLAIN, load)


@pytest.mark.parametrize(("sources", "goals"), [((), EVERYWHERE), (EVERYWHERE, ()), ((3,), (3,))])
def test_without_a_load_there_is_no_guidance(sources, goals):
    found = learned(PLAIN, Load(sources=sources, goals=goals, share=0.1))
    assert len(found) == ROADMAP.moves.count
    assert not any(found)


def test_what_is_counted_on_the_floor_makes_the_other_way_dearer():
    moves = ROADMAP.moves
    flow = np.zeros(moves.count)
    flow[0] = 10.0
    extra = priced(ROADMAP, flow, share=0.1)
    (back,) = (
        k
        for k in range(moves.count)
        if (moves.start[k], moves.end[k]) == (moves.end[0], moves.start[0])
    )
    assert extra[back] >= 0.1 * AGAINST * moves.count
    assert extra[0] < extra[back]
    assert sum(extra > 0) <= 1 + sum(end == moves.end[0] for end in moves.end)


def test_guidance_can_be_switched_off():
    assert guided(ROADMAP, 0.0)[0].move_s == PLAIN.move_s
    assert guided(ROADMAP)[0].move_s != PLAIN.move_s


def test_where_stops_have_many_ways_out_there_is_no_guidance():
    """It sent robots on detours: on an open grid they did half of what they did without."""
    grid = compile_area(lattice(14, 14, 0.7), [GROUP])
    assert grid.moves.count > WAYS_OUT_MAX * grid.places.stops
    assert guided(grid)[0].move_s == Costs(grid, GROUP.kinematics).move_s
