import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from scheduler.traffic.lacam import Search
from scheduler.traffic.pibt import propose
from scheduler.traffic.rescue import IDLE_MS_MAX, Rescue
from scheduler.traffic.world import World, room
from tests.scheduler.traffic.stuck import AREAS, random_world, world_of

ALL = {f"R{k}" for k in range(9)} | {"A", "B"}


def found(world: World) -> Rescue | None:
    """A way out for the first robot."""
    movers = [k for k, agent in enumerate(world.agents) if not agent.fixed]
    way = Search(world, movers).run(5_000).way
    goal = world.agents[0].goal
    return None if not way else Rescue(robot="R0", goal=goal, way=list(way), since_ms=0)


def drive(world: World, name: str, moves: tuple[int, ...]) -> None:
    """Commit an operation; its room must be empty."""
    agent = next(agent for agent in world.agents if agent.name == name)
    need = room(world, agent.place, agent.heading_rad, moves, agent.goal) & ~(1 << agent.place)
    assert not any(need >> a.place & 1 for a in world.agents if a is not agent)
    for move in moves:
        agent.place = world.roadmap.moves.end[move]
        agent.heading_rad = world.roadmap.heading_end[move]


@settings(max_examples=50)
@given(st.integers(0, len(AREAS) - 1), st.integers(0, 10_000), st.randoms(use_true_random=False))
def test_whoever_is_late_and_whatever_others_plan_the_way_is_driven_to_its_end(which, seed, chance):
    """Law: moves of a way are only put before others if that changes nothing."""
    world = random_world(which, seed, 4)
    rescue = found(world)
    assume(rescue is not None)
    for _ in range(40 * len(rescue.way)):
        if not rescue.way:
            break
        assert rescue.holds(world, (), 0)
        near = {agent.name for agent in world.agents if chance.random() < 0.5}
        due = rescue.due(world, near)
        others = propose(rescue.shielded(world))
        assert not rescue.robots() & {name for name, _ in others}
        for name, moves in due:
            drive(world, name, moves)
        rescue.note({name for name, _ in due}, 0)
    assert not rescue.way
    assert world.agents[0].place == world.agents[0].goal


def two() -> tuple[World, Rescue]:
    world = world_of(0, {"A": "c", "B": "d"}, {"A": "d", "B": "c"})
    way = Search(world, [0, 1]).run(1_000).way
    assert way
    return world, Rescue(robot="A", goal=world.agents[0].goal, way=way, since_ms=0)


def test_what_is_not_committed_is_due_again():
    world, rescue = two()
    due = rescue.due(world, ALL)
    assert due
    rescue.note((), 0)
    assert rescue.due(world, ALL) == due


@pytest.mark.parametrize("what", ["goal", "lost", "gone", "closed", "late"])
def test_a_way_is_given_up_when_it_cannot_be_driven_or_is_not_wanted(what):
    world, rescue = two()
    assert rescue.holds(world, (), 0)
    lost: tuple[str, ...] = ()
    now_ms = 0
    if what == "goal":
        world.agents[0].goal = None
    elif what == "lost":
        lost = ("B",)
    elif what == "gone":
        del world.agents[1]
    elif what == "closed":
        world.closed_moves = frozenset(move for _, moves in rescue.way for move in moves)
    else:
        now_ms = IDLE_MS_MAX + 1
    assert not rescue.holds(world, lost, now_ms)


def test_others_are_kept_off_the_ground_of_its_next_moves():
    world, rescue = two()
    shielded = rescue.shielded(world)
    for _, moves in rescue.way[:1]:
        assert shielded.closed_places >> world.roadmap.moves.end[moves[0]] & 1
    assert all(agent.fixed for agent in shielded.agents)
    assert not any(agent.fixed for agent in world.agents)
