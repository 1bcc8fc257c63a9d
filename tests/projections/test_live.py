"""The present: read-your-writes, waiting for a position, and what robots report."""

import asyncio

from ledger.events import RobotRemoved, SceneRemoved, stamped
from ledger.evolve import fold
from ledger.ids import CommandId, RobotName, robot_key
from ledger.link import Plan, Report
from ledger.state import Fleet
from projections.live import REPORTS_KEPT, Live
from tests.projections.past import all_orders, long_log
from tests.strategies import SCENE

LOG = long_log()


def report(at_ms: int) -> Report:
    return Report(
        scene=SCENE, robot=RobotName("R1"), number=0, at_ms=at_ms, area=0, x_m=0.0, y_m=0.0,
        heading_rad=0.0,
    )  # fmt: skip


def test_live_is_the_fold_and_keeps_what_ended_until_told_otherwise() -> None:
    live = Live(Fleet())
    live.apply(LOG.events)
    assert live.fleet == fold(Fleet(), LOG.events)
    assert live.fleet.orders | live.finished == all_orders(LOG)
    live.forget(LOG.events[-1].position)
    assert not live.finished


def test_what_the_projector_has_already_is_not_kept_twice() -> None:
    live = Live(Fleet())
    live.apply(LOG.events[:300])
    live.forget(600)
    live.apply(LOG.events[300:])
    assert not live.finished
    ended = {o.id for o in all_orders(LOG).values() if o.terminal}
    assert {order.id for order in live.now().newest} == ended


async def test_waiting_ends_when_the_position_is_readable() -> None:
    live = Live(LOG.fleet_at(10))
    assert await live.wait(10)
    waiting = asyncio.create_task(live.wait(20))
    later = asyncio.create_task(live.wait(30, timeout_s=0.01))
    await asyncio.sleep(0)
    live.apply(LOG.events[10:25])
    assert await waiting
    assert not await later
    assert await live.wait(25)


def test_a_report_that_was_overtaken_is_dropped() -> None:
    live = Live(LOG.fleet_at(10))
    for at_ms in (5, 7, 6):
        live.observe(report(at_ms))
    key = robot_key(SCENE, RobotName("R1"))
    assert live.reports[key].at_ms == 7
    assert [r.at_ms for r in live.recent[key]] == [5, 7]
    for at_ms in range(8, 100):
        live.observe(report(at_ms))
    assert len(live.recent[key]) == REPORTS_KEPT


def test_what_robots_said_that_have_left_is_forgotten() -> None:
    r1 = RobotName("R1")
    for gone in (RobotRemoved(scene=SCENE, robot=r1), SceneRemoved(scene=SCENE)):
        live = Live(fold(Fleet(), LOG.events[:7]))
        live.observe(report(1))
        live.intend(Plan(scene=SCENE, robot=r1, at_ms=1, ready=True))
        live.apply([stamped(gone, live.position + 1, LOG.events[6].at_ms, "a", CommandId("c"))])
        assert not live.reports and not live.plans and not live.recent
