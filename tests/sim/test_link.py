"""The simulator on the bus: robots come, listen, report and go, on virtual time."""

import random
from pathlib import Path

import msgspec

from ledger.bus import MemoryBus, tell_key
from ledger.events import (
    AnyEvent,
    RobotAdded,
    RobotDisabled,
    RobotEnabled,
    RobotReconfigured,
    RobotRemoved,
    SceneConfigured,
    SceneDisabled,
    SceneEnabled,
    SceneRemoved,
)
from ledger.events.scenes import SceneImported, SceneMapReplaced
from ledger.evolve import fold
from ledger.ids import CommandId, RobotName
from ledger.link import Act, Drive, Mark, Reconnect, Report, ToRobot
from ledger.scene import Group, Kinematics, RobotConfig
from ledger.scene_config import SceneConfig
from ledger.state import Fleet
from sim.link import SimRole
from sim.warehouses import generate
from sim.world import World
from tests.sim.fleets import SCENE, configs, drive_on, leaving, random_drives

WAREHOUSE = generate(aisles=3, bays=3, robots=4, seed=1)
AREA = WAREHOUSE.areas[0]
A, B = RobotName("AMB-01"), RobotName("AMB-02")


class Script:
    """A feed that a test writes: events happen when it says so."""

    def __init__(self) -> None:
        self.position = 0
        self.news: list[AnyEvent] = []
        self.past: list[AnyEvent] = []

    def happen(self, *events: AnyEvent) -> None:
        for event in events:
            self.position += 1
            self.news.append(msgspec.structs.replace(event, position=self.position))

    def start(self) -> Fleet:
        self.drain()
        return fold(Fleet(), self.past)

    def drain(self) -> list[AnyEvent]:
        news, self.news = self.news, []
        self.past += news
        return news


HEAD = {"at_ms": 0, "scene": SCENE, "by": "test", "command": CommandId("")}


def imported() -> SceneImported:
    return SceneImported(
        **HEAD,
        name=WAREHOUSE.name,
        digest="1",
        areas=WAREHOUSE.areas,
        groups=WAREHOUSE.groups,
    )


def added(config: RobotConfig) -> RobotAdded:
    return RobotAdded(**HEAD, config=config)


class Site:
    """A bus with a simulator on it, and somebody who takes down what he hears."""

    def __init__(self, script: Script, memory: Path | None = None, seed: int = 1) -> None:
        self.bus = MemoryBus()
        self.alive: dict[str, bool] = {}
        self.reports: list[Report] = []
        self.raw: list[bytes] = []
        self.bus.watch("scenes/**", self._see)
        self.bus.subscribe("scenes/*/robots/*/report", self._hear)
        self.role = SimRole(self.bus, script, World(random.Random(seed)), memory=memory)

    def _see(self, key: str, alive: bool) -> None:
        self.alive[key.split("/")[3]] = alive

    def _hear(self, key: str, payload: bytes) -> None:
        self.raw.append(payload)
        self.reports.append(msgspec.json.decode(payload, type=Report))

    def tell(self, message: ToRobot) -> None:
        self.bus.publish(tell_key(SCENE, message.robot), msgspec.json.encode(message))

    def newest(self, robot: RobotName = A) -> Report:
        return next(r for r in reversed(self.reports) if r.robot == robot)

    def run(self, from_ms: int, to_ms: int, every_ms: int = 100) -> None:
        for now_ms in range(from_ms, to_ms + 1, every_ms):
            self.role.tick(now_ms)


def with_robots(count: int) -> Script:
    script = Script()
    script.happen(imported(), *[added(config) for config in configs(count)])
    return script


def test_simulated_robots_of_the_fleet_connect_and_others_do_not() -> None:
    script = with_robots(1)
    script.happen(added(RobotConfig(name=B)))
    site = Site(script)
    site.run(0, 1_000)
    assert site.alive == {A: True}
    assert {r.robot for r in site.reports} == {A}


def test_robots_join_leave_and_come_back_while_it_runs() -> None:
    script = with_robots(1)
    site = Site(script)
    site.run(0, 500)
    script.happen(added(configs(2)[1]))
    site.run(600, 1_000)
    assert site.alive == {A: True, B: True}
    script.happen(RobotDisabled(**HEAD, robot=A), RobotRemoved(**HEAD, robot=B))
    site.run(1_100, 2_000)
    assert site.alive == {A: False, B: False}
    said = len(site.reports)
    site.run(2_100, 4_000)
    assert len(site.reports) == said
    script.happen(RobotEnabled(**HEAD, robot=A))
    site.run(4_100, 5_000)
    assert site.alive == {A: True, B: False}


def test_a_robot_drives_where_it_is_told() -> None:
    site = Site(with_robots(1))
    site.run(0, 1_000)
    report = site.newest()
    way = leaving(AREA, report)[0]
    site.tell(drive_on(AREA, report, way, 1))
    site.run(1_100, 30_000)
    assert site.newest().point == way.end


def test_a_moving_robot_reports_ten_times_a_second_and_a_resting_one_once() -> None:
    site = Site(with_robots(2))
    site.run(0, 1_000)
    report = site.newest()
    site.reports.clear()
    site.tell(drive_on(AREA, report, leaving(AREA, report)[0], 1))
    site.run(1_050, 2_050, every_ms=50)
    counts = [sum(r.robot == name for r in site.reports) for name in (A, B)]
    assert counts == [10, 1]


def test_nonsense_is_not_obeyed() -> None:
    site = Site(with_robots(1))
    site.run(0, 1_000)
    for payload in (b"", b"{}", b'{"type": "Fly", "robot": "AMB-01"}', b"\xff"):
        site.bus.publish(tell_key(SCENE, A), payload)
    site.run(1_100, 2_000)
    assert site.newest().odometer_m == 0.0


def test_a_robot_without_room_stays_absent_until_there_is_some() -> None:
    script = with_robots(len(AREA.points) + 1)  # there is room for one on every point
    site = Site(script)
    site.run(0, 1_000)
    absent = [c.name for c in configs(len(AREA.points) + 1) if c.name not in site.alive]
    assert absent
    script.happen(RobotRemoved(**HEAD, robot=A))
    site.run(1_100, 2_000)
    assert site.alive[absent[0]]


def test_a_killed_simulator_goes_on_from_what_it_has_said(tmp_path: Path) -> None:
    script = with_robots(3)
    memory = tmp_path / "robots"
    site = Site(script, memory)
    rng = random.Random(4)
    for now_ms in range(0, 20_000, 100):
        site.role.tick(now_ms)
        for drive in random_drives(AREA, [site.newest(c.name) for c in configs(3)], rng):
            site.tell(drive)
    last = [site.newest(c.name) for c in configs(3)]
    again = Site(script, memory, seed=7)  # nothing was closed
    again.role.tick(60_000)
    for before in last:
        after = again.newest(before.robot)
        assert after.session == before.session
        assert after.progress >= before.progress
        assert after.number > before.number
        assert after.battery_ratio <= before.battery_ratio
    assert any(r.progress > Mark() for r in last)


def test_a_broken_memory_is_no_reason_to_stay_away(tmp_path: Path) -> None:
    memory = tmp_path / "robots"
    memory.write_bytes(b"torn")
    site = Site(with_robots(1), memory)
    site.run(0, 1_000)
    assert site.alive == {A: True}


def test_a_replaced_map_begins_a_new_session() -> None:
    script = with_robots(1)
    site = Site(script)
    site.run(0, 1_000)
    before = site.newest()
    area = msgspec.structs.replace(AREA, map_digest="other")
    script.happen(SceneMapReplaced(**HEAD, digest="2", areas=(area,), groups=WAREHOUSE.groups))
    site.run(1_100, 2_000)
    after = site.newest()
    assert after.map_digest == "other"
    assert after.session != before.session
    assert after.point == before.point


def test_the_same_seed_says_the_same_bytes() -> None:
    def said() -> list[bytes]:
        site = Site(with_robots(3))
        rng = random.Random(2)
        for now_ms in range(0, 15_000, 200):
            site.role.tick(now_ms)
            for drive in random_drives(AREA, [site.newest(c.name) for c in configs(3)], rng):
                site.tell(drive)
        return site.raw

    assert said() == said()


def test_closing_disconnects_everybody(tmp_path: Path) -> None:
    site = Site(with_robots(2), tmp_path / "robots")
    site.run(0, 1_000)
    site.tell(Act(robot=A, id="a", name="Load"))
    site.role.close()
    assert site.alive == {A: False, B: False}


def test_a_long_gap_is_not_simulated_whole() -> None:
    site = Site(with_robots(1))
    site.run(0, 1_000)
    report = site.newest()
    drive: Drive = drive_on(AREA, report, leaving(AREA, report)[0], 1)
    site.tell(drive)
    site.role.tick(10_000_000)
    first = site.newest()
    assert first.at_ms == 10_000_000
    assert report.battery_ratio - first.battery_ratio < 0.01


def test_a_robot_with_a_cut_link_has_no_token_until_it_is_called_back() -> None:
    site = Site(with_robots(1))
    site.run(0, 1_000)
    site.role._world.cut(SCENE, A)
    site.run(1_100, 1_200)
    site.reports.clear()
    site.run(1_300, 5_000)
    assert site.alive == {A: False}
    assert not site.reports
    site.tell(Reconnect(robot=A))
    site.run(5_100, 5_300)
    assert site.alive == {A: True}
    assert site.reports


def test_resting_robots_report_as_often_as_their_scene_asks_for() -> None:
    script = with_robots(1)
    site = Site(script)
    script.happen(SceneConfigured(**HEAD, config=SceneConfig(state_fetch_ms=300)))
    site.run(0, 1_000)
    site.reports.clear()
    site.run(1_100, 4_000)
    assert len(site.reports) == 10


def test_a_scene_that_rests_takes_its_robots_along_and_brings_them_back_as_they_were() -> None:
    script = with_robots(2)
    site = Site(script)
    site.run(0, 1_000)
    report = site.newest()
    site.tell(drive_on(AREA, report, leaving(AREA, report)[0], 1))
    site.run(1_100, 2_000)
    before = site.newest()
    script.happen(SceneDisabled(**HEAD))
    site.run(2_100, 9_000)
    assert site.alive == {A: False, B: False}
    script.happen(RobotRemoved(**HEAD, robot=B), SceneEnabled(**HEAD))
    site.role.tick(9_100)
    after = site.newest()
    assert (after.session, after.progress.piece) == (before.session, before.progress.piece)
    assert abs(after.x_m - before.x_m) + abs(after.y_m - before.y_m) < 0.2
    script.happen(SceneRemoved(**HEAD))
    site.run(9_200, 9_400)
    assert site.alive == {A: False, B: False}


def test_a_robot_that_is_simulated_no_more_leaves_and_another_group_is_another_body() -> None:
    script = with_robots(1)
    site = Site(script)
    site.run(0, 1_000)
    config = configs(1)[0]
    slow = Kinematics(speed_mps_max=0.2)
    group = Group(id=7, name="slow", kinematics=slow)
    scene = SceneMapReplaced(
        **HEAD, digest="2", areas=WAREHOUSE.areas, groups=(*WAREHOUSE.groups, group)
    )
    other = msgspec.structs.replace(config, group=7)
    script.happen(scene, RobotReconfigured(**HEAD, robot=A, config=other))
    site.run(1_100, 1_300)
    assert next(iter(site.role._world.robots())).body.kinematics == slow
    real = msgspec.structs.replace(config, simulated=False)
    script.happen(RobotReconfigured(**HEAD, robot=A, config=real))
    site.run(1_400, 1_600)
    assert site.alive == {A: False}
    assert not len(site.role._world)
