import msgspec
import pytest
from prometheus_client import CollectorRegistry, generate_latest

from fleetledger.shift import Shift
from fleetledger.traffic_figures import STALE_MS, TrafficFigures
from ledger.bus import MemoryBus, counts_key
from ledger.events import RobotsWaited
from ledger.ids import RobotKey, RobotName, SceneId, robot_key
from ledger.link import Alarm, AlarmLevel, Plan
from ledger.waits import Counts, Wait, WaitReason
from sim.faults import FaultMix
from sim.warehouses import for_robots
from tests.laws.onlooker import bins_of, load, unload

SCENE = SceneId("0123456789abcdef01234567")


def plan(name: str, at_ms: int, since_ms: int | None = None) -> tuple[RobotKey, Plan]:
    robot = RobotName(name)
    wait = None
    if since_ms is not None:
        wait = Wait(robot=robot, since_ms=since_ms, reason=WaitReason.DOOR)
    made = Plan(scene=SCENE, robot=robot, at_ms=at_ms, ready=True, wait=wait)
    return robot_key(SCENE, robot), made


def figures(plans: dict[RobotKey, Plan], bus: MemoryBus) -> list[str]:
    made = TrafficFigures(plans, lambda: 100_000)
    made.hear(bus)
    counts = Counts(
        scene=SCENE,
        at_ms=1,
        plannings={"Goals": 7, "Pace": 2},
        pushes=3,
        cycles=1,
        breaches=2,
        ladder={"rescues": 4},
    )
    bus.publish(counts_key(SCENE), msgspec.json.encode(counts))
    bus.publish(counts_key(SCENE), b"nonsense")
    registry = CollectorRegistry()
    registry.register(made)
    return generate_latest(registry).decode().splitlines()


def test_robots_that_wait_are_counted_by_reason_and_the_longest_is_told():
    lines = figures(
        dict(
            [
                plan("A", 99_000, since_ms=60_000),
                plan("B", 99_000, since_ms=90_000),
                plan("C", 99_000),
                plan("D", 100_000 - STALE_MS - 1, since_ms=0),  # its scheduler has gone
            ]
        ),
        MemoryBus(),
    )
    waiting = "fleetledger_traffic_waiting_robots"
    assert f'{waiting}{{reason="Door",scene="{SCENE}"}} 2.0' in lines
    assert f'{waiting}{{reason="Late",scene="{SCENE}"}} 0.0' in lines
    assert f'fleetledger_traffic_longest_wait_seconds{{scene="{SCENE}"}} 40.0' in lines


def test_what_the_scheduler_counts_is_told_as_counters():
    lines = figures({}, MemoryBus())
    assert f'fleetledger_traffic_plannings_total{{due="Goals",scene="{SCENE}"}} 7.0' in lines
    assert f'fleetledger_traffic_pushes_total{{scene="{SCENE}"}} 3.0' in lines
    assert f'fleetledger_traffic_wait_cycles_total{{scene="{SCENE}"}} 1.0' in lines


def test_robots_that_cannot_get_on_are_told_and_what_was_tried_is_counted():
    plans = dict([plan("B", 99_000)])
    # C is held by the guard, which lets it go by itself
    for robot, code in (("A", "TrafficStuck"), ("C", "BodiesOverlap")):
        key, one = plan(robot, 99_000)
        alarm = Alarm(level=AlarmLevel.ERROR, code=code, message="no way")
        plans[key] = msgspec.structs.replace(one, alarm=alarm)
    lines = figures(plans, MemoryBus())
    assert f'fleetledger_traffic_stuck_robots{{scene="{SCENE}"}} 1.0' in lines
    told = f'fleetledger_traffic_ladder_total{{scene="{SCENE}",what="rescues"}} 4.0'
    assert told in lines


def test_what_the_guard_saw_is_counted():
    lines = figures({}, MemoryBus())
    assert f'fleetledger_traffic_breaches_total{{scene="{SCENE}"}} 2.0' in lines


def test_what_robots_wait_for_goes_from_traffic_to_the_ledger(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Through scheduler, bus and core, on virtual time; each part has its own tests."""
    monkeypatch.setattr("scheduler.tally.STRETCH_MS", 60_000)
    file = for_robots(6, seed=3)
    bus = MemoryBus()
    faults = FaultMix(late_ratio=0.4, late_mean_s=8.0)
    shift = Shift(file, seed=3, bus=bus, faults=faults)
    shown: list[Plan] = []
    bus.subscribe(
        "scenes/*/plans", lambda _, raw: shown.extend(msgspec.json.decode(raw, type=list[Plan]))
    )
    figures = TrafficFigures({}, lambda: shift.now_ms)
    figures.hear(bus)
    bin_ = bins_of(file)[0]
    for _ in range(6):  # all to one place
        shift.order(load(bin_), unload(bin_))
    shift.run(62)
    noted = [event for event in shift.ledger.read(0) if isinstance(event, RobotsWaited)]
    assert len(noted) == 1
    told = {(p.robot, p.wait.reason, p.wait.blockers) for p in shown if p.wait is not None}
    summed = {(wait.robot, wait.reason, wait.blockers) for wait in noted[0].waits}
    assert summed
    assert summed <= told
    assert noted[0].plannings["Goals"] > 0
    assert all(0 < w.longest_ms <= w.total_ms <= 60_000 for w in noted[0].waits)
    counted = {metric.name: metric for metric in figures.collect()}
    assert counted["fleetledger_traffic_plannings"].samples
