"""Reports and plans on their way in: shown always, written down where the scene lets them."""

import asyncio
import threading

import msgspec

from fleetledger.intake import Intake
from ledger.bus import MemoryBus, plans_key, report_key
from ledger.ids import RobotName, SceneId
from ledger.link import Plan, Report

KEPT, QUIET = SceneId("a" * 24), SceneId("b" * 24)
NAME = RobotName("R")


class Paper:
    """A telemetry log that keeps what it is given."""

    def __init__(self) -> None:
        self.reports: list[Report] = []
        self.plans: list[Plan] = []
        self.written = threading.Event()

    def write(self, reports: list[Report]) -> None:
        self.reports += reports

    def write_plans(self, plans: list[Plan]) -> None:
        self.plans += plans
        self.written.set()


async def test_a_scene_may_keep_the_messages_of_its_robots_out_of_the_log() -> None:
    bus, paper = MemoryBus(), Paper()
    shown: list[Report | Plan] = []
    intake = Intake(
        bus, asyncio.get_running_loop(), paper, shown.append, shown.append, lambda s: s != QUIET
    )
    for scene in (KEPT, QUIET):
        report = Report(
            scene=scene, robot=NAME, number=1, at_ms=1, area=1, x_m=0, y_m=0, heading_rad=0
        )
        plan = Plan(scene=scene, robot=NAME, at_ms=1, ready=True)
        bus.publish(report_key(scene, NAME), msgspec.json.encode(report))
        bus.publish(plans_key(scene), msgspec.json.encode([plan]))
    await asyncio.sleep(0)  # the loop's turn, not time
    intake.start()
    assert await asyncio.to_thread(paper.written.wait, 10)
    intake.stop()
    assert len(shown) == 4
    assert [r.scene for r in paper.reports] == [KEPT]
    assert [p.scene for p in paper.plans] == [KEPT]


async def test_a_report_that_no_robot_can_mean_is_not_shown() -> None:
    bus = MemoryBus()
    shown: list[Report | Plan] = []
    loop = asyncio.get_running_loop()
    Intake(bus, loop, Paper(), shown.append, shown.append, lambda s: True)
    report = Report(
        scene=KEPT, robot=NAME, number=1, at_ms=1, area=1, x_m=0, y_m=0, heading_rad=1e308
    )
    bus.publish(report_key(KEPT, NAME), msgspec.json.encode(report))
    good = msgspec.structs.replace(report, heading_rad=1.0)
    bus.publish(report_key(KEPT, NAME), msgspec.json.encode(good))
    await asyncio.sleep(0)  # the loop's turn, not time
    assert shown == [good]
