import random

from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import PointName
from ledger.scene import Group
from scheduler.traffic.compile import compile_area
from scheduler.traffic.costs import Costs
from scheduler.traffic.pibt import propose
from scheduler.traffic.world import Agent, World, has_token, room
from tests.scheduler.traffic.maps import lattice, warehouse

GROUPS = [Group(id=0, name="g")]
MAPS = [
    compile_area(area, GROUPS)
    for area in (lattice(4, 4), lattice(8, 8, 0.5), warehouse(3, 5, 2, blind=(1,)))
]
COSTS = [Costs(roadmap, GROUPS[0].kinematics) for roadmap in MAPS]


@st.composite
def worlds(draw):
    which = draw(st.integers(0, len(MAPS) - 1))
    roadmap, chance = MAPS[which], random.Random(draw(st.integers(0, 10_000)))
    count = draw(st.integers(1, max(1, roadmap.places.stops * 2 // 3)))
    places = chance.sample(range(roadmap.places.stops), count)
    agents = [
        Agent(
            name=f"R{k:02d}",
            place=place,
            heading_rad=chance.choice((0.0, 1.57, 3.14, -1.57)),
            costs=COSTS[which],
            goal=None if chance.random() < 0.2 else chance.randrange(len(roadmap.place)),
            fixed=chance.random() < 0.1,
        )
        for k, place in enumerate(places)
    ]
    world = World(roadmap=roadmap, agents=agents)
    if draw(st.booleans()):  # as if ground were reserved, and bodies stood where none is foreseen
        stops, moves = range(roadmap.places.stops), range(roadmap.moves.count)
        world.closed_moves = frozenset(chance.sample(moves, 3))
        world.closed_turns = frozenset(chance.sample(roadmap.places.point, 2))
        world.closed_places = 1 << chance.choice(stops) | 1 << chance.choice(places)
        world.more_need = {chance.choice(moves): 1 << chance.choice(places) for _ in range(9)}
        points = roadmap.places.point
        world.more_turning = {chance.choice(points): 1 << chance.choice(places) for _ in range(9)}
    return world


@given(worlds())
def test_what_is_proposed_can_be_driven_one_after_another(world):
    """Law: replayed in its order, every operation finds the room it needs empty."""
    at = {agent.name: agent for agent in world.agents}
    position = {agent.name: agent.place for agent in world.agents}
    moved = set()
    for name, moves in propose(world):
        agent = at[name]
        assert name not in moved and not agent.fixed
        moved.add(name)
        need = room(world, agent.place, agent.heading_rad, moves, agent.goal)
        others = sum(1 << place for other, place in position.items() if other != name)
        assert not need & others
        assert not need & world.closed_places & ~(1 << agent.place)
        for move in moves:
            assert move not in world.closed_moves
            assert world.roadmap.moves.start[move] == position[name]
            position[name] = world.roadmap.moves.end[move]


@given(worlds())
def test_the_same_world_gives_the_same_proposal(world):
    assert propose(world) == propose(world)


@given(worlds())
def test_goal_only_stops_are_entered_only_by_who_has_its_goal_there(world):
    goals = {agent.name: agent.goal for agent in world.agents}
    for name, moves in propose(world):
        for move in moves:
            end = world.roadmap.moves.end[move]
            assert end < world.roadmap.places.stops or end == goals[name]


def agent(which, name, at, goal=None, **given_):
    place = MAPS[which].place
    return Agent(
        name=name,
        place=place[PointName(at)],
        heading_rad=0.0,
        costs=COSTS[which],
        goal=None if goal is None else place[PointName(goal)],
        **given_,
    )


def test_who_has_a_goal_takes_the_cheapest_way_and_pushes_the_idle():
    world = World(roadmap=MAPS[0], agents=[agent(0, "A", "P0-0", "P2-0"), agent(0, "B", "P1-0")])
    first, second = propose(world)
    assert (first[0], second[0]) == ("B", "A")


def test_nobody_pushes_a_robot_that_works():
    world = World(
        roadmap=MAPS[0],
        agents=[agent(0, "A", "P0-0", "P1-0"), agent(0, "B", "P1-0", fixed=True)],
    )
    assert all(name == "A" for name, _ in propose(world))
    assert all(
        MAPS[0].moves.end[move] != world.agents[1].place
        for _, moves in propose(world)
        for move in moves
    )


def test_an_idle_robot_that_nobody_needs_stays():
    assert propose(World(roadmap=MAPS[0], agents=[agent(0, "A", "P0-0")])) == []


def test_a_robot_on_its_goal_stays():
    world = World(roadmap=MAPS[0], agents=[agent(0, "A", "P0-0", "P0-0")])
    assert propose(world) == []


def test_closed_moves_are_not_proposed():
    world = World(roadmap=MAPS[0], agents=[agent(0, "A", "P0-0", "P3-0")])
    ((_, (move,)),) = propose(world)
    world.closed_moves = frozenset({move})
    assert all(move not in moves for _, moves in propose(world))


def test_a_dead_end_is_entered_past_nobody():
    roadmap = MAPS[2]
    place = roadmap.place
    shallow, deep = place[PointName("B1-0")], place[PointName("B1-4")]
    pocket = roadmap.pockets.pocket[deep]
    assert has_token(roadmap, pocket, shallow, [])
    assert has_token(roadmap, pocket, shallow, [deep])
    assert not has_token(roadmap, pocket, deep, [shallow])
    assert not has_token(roadmap, pocket, shallow, [deep, place[PointName("S0")]])


def test_who_is_pushed_at_the_mouth_of_a_dead_end_is_not_pushed_into_it():
    """The one that pushes wants in, and would have the other in front of itself for ever."""
    roadmap = MAPS[2]
    pockets, moves = roadmap.pockets, roadmap.moves
    deep = roadmap.place[PointName("B1-4")]
    aisle = pockets.pocket[deep]
    (mouth,) = {
        place
        for place in range(roadmap.places.stops)
        if pockets.pocket[place] != aisle
        and any(pockets.pocket[moves.end[move]] == aisle for move in roadmap.leaving[place])
    }
    beside = min(
        moves.end[move] for move in roadmap.leaving[mouth] if pockets.pocket[moves.end[move]] < 0
    )
    costs = COSTS[2]
    wants_in = Agent(name="A", place=beside, heading_rad=0.0, costs=costs, goal=deep)
    # its own way leads past the one that wants in, and the dead end is the nearest place to evade
    into = min(m for m in roadmap.leaving[mouth] if pockets.pocket[moves.end[m]] == aisle)
    heading_rad = roadmap.heading_start[into]
    came_out = Agent(name="B", place=mouth, heading_rad=heading_rad, costs=costs, goal=beside)

    found = dict(propose(World(roadmap=roadmap, agents=[wants_in, came_out])))

    assert found["B"], "it must make way"
    assert all(pockets.pocket[moves.end[move]] != aisle for move in found["B"])


def test_who_is_pushed_evades_aside_and_not_along_the_way_of_the_one_that_pushes():
    roadmap = compile_area(lattice(5, 2), GROUPS)
    costs = Costs(roadmap, GROUPS[0].kinematics)
    at = {name: roadmap.place[PointName(name)] for name in ("P0-0", "P1-0", "P1-1", "P4-0")}
    world = World(
        roadmap=roadmap,
        agents=[
            Agent(name="A", place=at["P0-0"], heading_rad=0.0, costs=costs, goal=at["P4-0"]),
            Agent(name="B", place=at["P1-0"], heading_rad=0.0, costs=costs),
        ],
    )
    found = dict(propose(world))
    assert roadmap.moves.end[found["B"][-1]] == at["P1-1"]
