"""Reports and plans on their way in: shown always, written down where the scene lets them."""

import asyncio
import threading
from pathlib import Path

import msgspec

from fleetledger.config import Settings
from fleetledger.intake import FETCH_MAX, Intake, telemetry_log
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

    def write(self, reports: list[Report], now_ms: int | None = None) -> None:
        self.reports += reports

    def write_plans(self, plans: list[Plan], now_ms: int | None = None) -> None:
        self.plans += plans
        self.written.set()

    def close(self) -> None:
        """Keep the paper."""


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


async def test_a_flood_is_taken_in_turns_and_nonsense_is_passed_over() -> None:
    bus = MemoryBus()
    shown: list[Report | Plan] = []
    loop = asyncio.get_running_loop()
    intake = Intake(bus, loop, Paper(), shown.append, shown.append)
    for number in range(3 * FETCH_MAX):
        report = Report(
            scene=KEPT, robot=NAME, number=number, at_ms=number, area=1, x_m=0, y_m=0, heading_rad=0
        )
        bus.publish(report_key(KEPT, NAME), msgspec.json.encode(report))
        bus.publish(report_key(KEPT, NAME), b"\xff{")
    await asyncio.sleep(0)
    assert len(shown) <= FETCH_MAX
    async with asyncio.timeout(30):
        while len(shown) < 3 * FETCH_MAX:
            await asyncio.sleep(0)
    intake.stop()


async def test_no_telemetry_is_written_where_nothing_is_to_be_kept(tmp_path: Path) -> None:
    for kept in ({"telemetry_keep_mb": 0}, {"telemetry_keep_days": 0}, {}):
        settings = Settings.load(tmp_path, **kept)
        log = telemetry_log(settings)
        report = Report(
            scene=KEPT, robot=NAME, number=1, at_ms=1, area=1, x_m=0, y_m=0, heading_rad=0
        )
        log.write([report])
        log.close()
        assert settings.telemetry.exists() == (kept == {})
