"""Proposals that change nothing come again, but more and more seldom."""

from itertools import pairwise

from ledger.events import OrderPrioritised
from ledger.proposals import FaultOrder
from scheduler.backoff import LONGEST_MS, REMEMBERED_MAX, Backoff
from tests.scheduler.small_core import SmallCore
from tests.scheduler.small_site import SCENE, carry, imported


def test_the_pauses_double_up_to_a_limit() -> None:
    core = SmallCore()
    core.happen(imported(), carry(1, "B1", "B2"))
    (id_,) = core.fleet.orders
    proposal = FaultOrder(scene=SCENE, order=id_, reason="r")
    backoff = Backoff()
    moments = [t for t in range(0, 200_000, 100) if backoff.fit(core.fleet, [proposal], t)]
    pauses = [b - a for a, b in pairwise(moments)]
    assert pauses[:5] == [1_000, 2_000, 4_000, 8_000, 16_000]
    assert set(pauses[5:]) == {LONGEST_MS}


def test_a_changed_order_is_asked_about_at_once() -> None:
    core = SmallCore()
    core.happen(imported(), carry(1, "B1", "B2"))
    (id_,) = core.fleet.orders
    proposal = FaultOrder(scene=SCENE, order=id_, reason="r")
    backoff = Backoff()
    assert backoff.fit(core.fleet, [proposal], 0)
    assert not backoff.fit(core.fleet, [proposal], 1)
    core.happen(OrderPrioritised(scene=SCENE, order=id_, priority=1))
    assert backoff.fit(core.fleet, [proposal], 2)


def test_what_it_remembers_is_bounded() -> None:
    core = SmallCore()
    backoff = Backoff()
    for n in range(REMEMBERED_MAX + 10):
        backoff.fit(core.fleet, [FaultOrder(scene=SCENE, order=f"O{n}", reason="r")], 0)  # type: ignore[arg-type]
    assert len(backoff._until) == REMEMBERED_MAX
