from scheduler.traffic.safe import Safe
from tests.scheduler.traffic.stuck import drawn, roads, world_on

# A one-way loop a-b-c-d-e-f with a one-way lane g-a into it, and nothing that leads out.
TRAP = drawn(
    {
        "a": (0, 0),
        "b": (2, 0),
        "c": (4, 0),
        "d": (4, 2),
        "e": (2, 2),
        "f": (0, 2),
        "g": (-2, 0),
    },
    "",
    "ab bc cd de ef fa ga",
)
STANDS = {"B": "b", "C": "c", "D": "d", "E": "e", "F": "f", "G": "g"}
GOALS = {"B": "a", "C": "b", "D": "c", "E": "d", "F": "e", "G": "c"}


def move(world, start, end):
    moves, place = world.roadmap.moves, world.roadmap.place
    return (min(m for m in world.roadmap.leaving[place[start]] if moves.end[m] == place[end]),)


def test_a_loop_is_not_filled_up_to_its_last_stop():
    world = world_on(roads(TRAP), STANDS, GOALS)
    assert not Safe(world).take("G", move(world, "g", "a"))


def test_its_own_robots_go_on_round_it():
    world = world_on(roads(TRAP), STANDS, GOALS)
    safe = Safe(world)
    assert safe.take("F", move(world, "f", "a"))
    assert safe.take("E", move(world, "e", "f"))


def test_where_two_stops_are_free_one_may_be_taken():
    stands = {name: at for name, at in STANDS.items() if name != "F"}
    world = world_on(roads(TRAP), stands, GOALS)
    assert Safe(world).take("G", move(world, "g", "a"))


def test_who_follows_a_way_that_was_found_is_excused():
    world = world_on(roads(TRAP), STANDS, GOALS)
    assert Safe(world, {"G"}).take("G", move(world, "g", "a"))


def test_nobody_joins_those_who_wait_for_a_jam():
    """A jam has to be dissolved, and for that there has to be room around it."""
    at = {point.name: (point.x_m, point.y_m) for point in TRAP.points} | {"h": (-4.0, 0.0)}
    longer = drawn(at, "", "ab bc cd de ef fa ga hg")
    stands = {"A": "a", **{name: p for name, p in STANDS.items() if name != "G"}, "H": "h"}
    world = world_on(roads(longer), stands, {**GOALS, "A": "f", "H": "c"})
    assert not Safe(world).take("H", move(world, "h", "g"))
