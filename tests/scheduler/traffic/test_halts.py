from types import SimpleNamespace

from ledger.link import Mark
from scheduler.traffic.halts import HALTED_MS, Halts
from scheduler.traffic.world import standing_still
from tests.scheduler.traffic.stuck import RING, roads, world_on

ROADS = roads(RING)


def on_its_way(name, along_m, driven=False):
    return SimpleNamespace(name=name, progress=Mark(along_m=along_m), driven=driven)


def test_who_gets_no_further_on_its_way_has_halted_until_it_does():
    halts = Halts()
    assert halts.look([on_its_way("A", 1.0), on_its_way("B", 1.0)], 0) == set()
    assert halts.look([on_its_way("A", 1.0), on_its_way("B", 1.5)], HALTED_MS) == {"A"}
    assert halts.look([on_its_way("A", 1.1), on_its_way("B", 1.5)], HALTED_MS + 1) == set()


def test_who_rests_at_the_end_of_its_way_has_not_halted():
    halts = Halts()
    for now_ms in (0, HALTED_MS, 2 * HALTED_MS):
        assert halts.look([on_its_way("A", 1.0, driven=True)], now_ms) == set()
    assert halts.look([on_its_way("A", 1.0)], 3 * HALTED_MS) == set()


def test_those_who_have_halted_stay_where_they_are_for_a_search():
    world = standing_still(world_on(ROADS, {"A": "a", "B": "b"}, {"A": "d"}), {"B"})
    assert [agent.fixed for agent in world.agents] == [False, True]
