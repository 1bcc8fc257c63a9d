from ledger.ids import PointName, RobotName
from scheduler.traffic.stalls import PATIENT_MS, STALL_MS, Stalls
from tests.scheduler.traffic.maps import warehouse
from tests.scheduler.traffic.stuck import CROSS, RING, roads, world_on

A, B = RobotName("A"), RobotName("B")
RING_ROADS, CROSS_ROADS = roads(RING), roads(CROSS)
AISLES = roads(warehouse(3, 5, 2, blind=(1,)))


def stuck(stalls, world, now_ms, lost=frozenset(), left=None):
    return [world.agents[k].name for k in stalls.look(world, lost, left or {}, now_ms)]


def test_who_has_got_no_nearer_for_a_while_is_stuck():
    stalls, world = Stalls(), world_on(RING_ROADS, {"A": "a"}, {"A": "d"})
    assert stuck(stalls, world, 0) == []
    assert stuck(stalls, world, STALL_MS - 1) == []
    assert stuck(stalls, world, STALL_MS) == ["A"]
    assert stalls.since_ms("A") == 0


def test_driving_to_and_fro_is_no_progress():
    """Nearer than before, but not nearer than ever."""
    stalls, now_ms = Stalls(), 0
    for at in ("a", "b", "a", "b", "a", "b"):
        world = world_on(RING_ROADS, {"A": at}, {"A": "d"})
        found = stuck(stalls, world, now_ms)
        now_ms += STALL_MS // 2
    assert found == ["A"]


def test_every_step_towards_the_goal_begins_the_wait_anew():
    stalls = Stalls()
    for k, at in enumerate(("a", "b", "c")):
        world = world_on(RING_ROADS, {"A": at}, {"A": "d"})
        assert stuck(stalls, world, k * (STALL_MS - 1)) == []


def test_another_goal_begins_the_wait_anew():
    stalls = Stalls()
    stuck(stalls, world_on(RING_ROADS, {"A": "a"}, {"A": "d"}), 0)
    assert stuck(stalls, world_on(RING_ROADS, {"A": "a"}, {"A": "e"}), STALL_MS) == []


def test_who_works_or_has_nowhere_to_go_or_has_arrived_is_not_stuck():
    stalls = Stalls()
    world = world_on(RING_ROADS, {"A": "a", "B": "b", "C": "c"}, {"A": "d", "C": "c"}, A=True)
    stuck(stalls, world, 0)
    assert stuck(stalls, world, 10 * STALL_MS) == []


def test_who_is_on_the_way_to_its_goal_gets_nearer_by_driving():
    stalls, world = Stalls(), world_on(RING_ROADS, {"A": "d"}, {"A": "d"})
    assert stuck(stalls, world, 0, left={A: 5.0}) == []
    assert stuck(stalls, world, STALL_MS, left={A: 3.0}) == []
    assert stuck(stalls, world, 2 * STALL_MS, left={A: 3.0}) == ["A"]


def test_who_waits_for_somebody_who_works_on_its_goal_is_left_in_peace_for_long():
    stalls = Stalls()
    world = world_on(RING_ROADS, {"A": "a", "B": "d"}, {"A": "d", "B": "d"}, B=True)
    stuck(stalls, world, 0)
    assert stuck(stalls, world, STALL_MS) == []
    assert stuck(stalls, world, PATIENT_MS) == ["A"]


def test_but_not_if_that_one_does_not_answer():
    stalls = Stalls()
    world = world_on(RING_ROADS, {"A": "a", "B": "d"}, {"A": "d"}, B=True)
    stuck(stalls, world, 0, frozenset({B}))
    assert stuck(stalls, world, STALL_MS, frozenset({B})) == ["A"]


def test_who_waits_for_a_dead_end_to_empty_is_patient_while_those_inside_get_on():
    roadmap, _ = AISLES
    pockets = roadmap.pockets.pocket
    inside = [n for n in ("B1-0", "B1-2", "B1-4") if roadmap.place[PointName(n)] < 99]
    assert len({pockets[roadmap.place[PointName(n)]] for n in inside}) == 1
    world = world_on(AISLES, {"A": "S0", "B": "B1-2"}, {"A": "B1-4", "B": "S2"})
    stalls = Stalls()
    stuck(stalls, world, 0)
    nearer = world_on(AISLES, {"A": "S0", "B": "B1-0"}, {"A": "B1-4", "B": "S2"})
    assert stuck(stalls, nearer, STALL_MS) == []
    assert stuck(stalls, nearer, 2 * STALL_MS) == ["A", "B"]
