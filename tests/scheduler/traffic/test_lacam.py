import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scheduler.traffic.costs import INFINITE
from scheduler.traffic.lacam import Search
from scheduler.traffic.world import World, room
from tests.scheduler.traffic.stuck import AREAS, MAPS, crowded, random_world, world_of

RING, LOOP, CROSS = 1, 2, 3


def movers(world: World) -> list[int]:
    return [k for k, agent in enumerate(world.agents) if not agent.fixed]


def replayed(world: World, way) -> dict[str, int]:
    """Drive a way move by move; every one must find its room empty."""
    at = {agent.name: agent for agent in world.agents}
    stands = {agent.name: (agent.place, agent.heading_rad) for agent in world.agents}
    roadmap = world.roadmap
    for name, moves in way:
        agent, (place, heading) = at[name], stands[name]
        assert not agent.fixed
        need = room(world, place, heading, moves, agent.goal) & ~(1 << place)
        assert not any(need >> other & 1 for n, (other, _) in stands.items() if n != name)
        for move in moves:
            assert roadmap.moves.start[move] == place
            place, heading = roadmap.moves.end[move], roadmap.heading_end[move]
            assert place < roadmap.places.stops or place == agent.goal
        stands[name] = place, heading
    return {name: place for name, (place, _) in stands.items()}


def is_possible(world: World, states_max: int) -> bool | None:
    """Look at everything that single moves can lead to; None = too much."""
    roadmap, goal = world.roadmap, world.agents[0].goal
    start = tuple((agent.place, agent.heading_rad) for agent in world.agents)
    seen, todo = {start}, [start]
    while todo:
        stands = todo.pop()
        if stands[0][0] == goal:
            return True
        if len(seen) > states_max:
            return None
        for k in movers(world):
            (place, heading), agent = stands[k], world.agents[k]
            taken = sum(1 << other for n, (other, _) in enumerate(stands) if n != k)
            for move in roadmap.leaving[place]:
                end = roadmap.moves.end[move]
                if agent.costs.departure_s(place, heading, move) == INFINITE:
                    continue
                if end >= roadmap.places.stops and not (k == 0 and end == goal):
                    continue
                if room(world, place, heading, (move,), agent.goal) & ~(1 << place) & taken:
                    continue
                after = (*stands[:k], (end, roadmap.heading_end[move]), *stands[k + 1 :])
                if after not in seen:
                    seen.add(after)
                    todo.append(after)
    return False


@settings(max_examples=60, deadline=None)
@given(st.integers(0, len(AREAS) - 1), st.integers(0, 10_000))
def test_it_finds_a_way_exactly_where_there_is_one(which, seed):
    """Law: complete, and proven if it says so; what it finds can be driven move by move."""
    world = random_world(which, seed, 4)
    found = Search(world, movers(world)).run(20_000)
    if found.way is not None:
        assert replayed(world, found.way)["R0"] == world.agents[0].goal
    else:
        assert found.proven
    possible = is_possible(world, 10_000)
    if possible is not None:
        assert possible == (found.way is not None)


@settings(deadline=None)
@given(st.integers(0, len(AREAS) - 1), st.integers(0, 10_000))
def test_the_same_world_gives_the_same_way(which, seed):
    found = [
        Search(world, movers(world)).run(500)
        for world in (random_world(which, seed, 5) for _ in range(2))
    ]
    assert found[0] == found[1]


def test_two_that_want_each_others_stop_in_a_blind_lane_pass_at_its_only_place():
    world = world_of(0, {"A": "c", "B": "d"}, {"A": "d", "B": "c"})
    found = Search(world, [0, 1]).run(1_000)
    assert found.way is not None
    ends = replayed(world, found.way)
    assert ends["A"] == world.agents[0].goal


def test_a_ring_with_one_hole_turns_until_the_stuck_one_is_where_it_wants():
    stands = {"A": "a", "B": "b", "C": "c", "D": "d", "E": "e"}
    world = world_of(RING, stands, {"A": "d"})
    found = Search(world, range(5)).run(1_000)
    assert found.way is not None
    assert replayed(world, found.way)["A"] == world.agents[0].goal


def test_a_one_way_loop_with_one_hole_turns_too():
    stands = {"A": "b", "B": "c", "C": "d", "D": "e", "E": "f"}
    world = world_of(LOOP, stands, {"A": "a"})
    found = Search(world, range(5)).run(1_000)
    assert found.way is not None
    assert len(found.way) >= 5 * 4, "everybody has to go round"


def test_a_ring_without_a_hole_is_proven_to_have_no_way():
    stands = {"A": "a", "B": "b", "C": "c", "D": "d", "E": "e", "F": "f"}
    found = Search(world_of(RING, stands, {"A": "b"}), range(6)).run(1_000)
    assert found.way is None
    assert found.proven


def test_who_is_fixed_is_driven_round():
    world = world_of(CROSS, {"A": "a", "B": "s", "C": "c"}, {"A": "d"}, B=True)
    found = Search(world, [0, 2]).run(1_000)
    assert found.way is not None
    assert {name for name, _ in found.way} == {"A", "C"}
    assert replayed(world, found.way)["C"] == MAPS[CROSS].place["t"]


def test_nobody_gets_past_one_who_never_moves_in_a_single_lane():
    world = world_of(CROSS, {"A": "a", "B": "b"}, {"A": "d"}, B=True)
    found = Search(world, [0]).run(1_000)
    assert found.way is None
    assert found.proven


def test_nobody_is_pushed_further_than_may_be():
    world = world_of(0, {"A": "c", "B": "d"}, {"A": "d"})
    world.push_m_max = 1.0
    found = Search(world, [0, 1]).run(1_000)
    assert found.way is None
    assert found.proven


@pytest.mark.parametrize("robots", [20, 34])
def test_a_lattice_with_two_holes_left_is_no_trouble(robots):
    """Bounded work: nearly full is where PIBT alone goes to and fro."""
    for seed in range(5):
        world = crowded(seed, robots)
        found = Search(world, range(robots)).run(500)
        assert found.way is not None
        assert replayed(world, found.way)["R00"] == world.agents[0].goal
