"""Laws of traffic under faults, by true polygons: design notes, traffic §8, one test each.

Robots are those of `sim` with kinematics, on generated maps, and everything of the standard mix of
faults strikes them so often that minutes hold what a day does. (11), the conflict table, is with
the compiler's tests; (4), the serial order of a plan, with the planner's.
"""

import random

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from fleetledger.shift import Shift
from ledger.ids import RobotName
from ledger.scene import Area, RobotConfig, SceneFile
from ledger.state import StepTask
from sim.faults import LATE, STANDARD, FaultMix
from sim.people import push
from sim.warehouses import generate
from tests.laws.onlooker import Onlooker, bins_of, load, unload
from tests.laws.routes import acyclic, connected
from tests.laws.test_traffic_laws import roads
from tests.laws.yard import Yard
from tests.scheduler.traffic.maps import lattice
from tests.stands import STALL_MS

HARD: FaultMix = STANDARD.times(20)
FEW = settings(max_examples=4, deadline=None, suppress_health_check=[HealthCheck.too_slow])
CONFIGS = tuple(RobotConfig(name=RobotName(n), simulated=True) for n in ("R1", "R2"))
SEEDS = st.integers(0, 10_000)
ORDER_S_MAX = 400.0  # on a lattice with delays of 6 s and a fifth of its points taken: 130 s seen


def yard(area: Area, robots: int, seed: int, mix: FaultMix) -> Yard:
    return Yard(area, robots, [p.name for p in area.points], seed=seed, mix=mix, service_s=1.0)


def busy_lattice(seed: int, mix: FaultMix, columns: int = 5, rows: int = 4) -> Yard:
    return yard(lattice(columns, rows), columns * rows // 5, seed, mix)


@FEW
@given(roads(), SEEDS, st.integers(1, 5))
def test_ground_is_exclusive_and_every_body_on_its_own_whatever_goes_wrong(area, seed, robots):
    made = yard(area, robots, seed, HARD) if robots * 6 <= len(area.points) else None
    if made is not None:
        made.run(60)


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_the_ground_of_a_robot_follows_it_when_it_is_pushed_off_its_stop(seed):
    made = Yard(lattice(3, 3), {"R1": ("P1-1", 0.0)}, [], endless=False)
    made.run(2)
    robot = made.robots[RobotName("R1")]
    assert push(robot, random.Random(seed), "anew", [robot]) is not None
    made.run(2)


@FEW
@given(SEEDS)
@example(386)  # put by hand where the route of one that is heard later ends
def test_routes_are_connected_and_what_is_committed_never_waits_in_a_ring(seed):
    made = busy_lattice(seed, HARD)
    for _ in range(60):
        made.run(1, grants_every=0)
        connected(made.traffic)
        acyclic(made.traffic)


@FEW
@given(SEEDS)
def test_delays_alone_keep_every_order_within_its_bound(seed):
    made = busy_lattice(seed, LATE)
    made.run(150, grants_every=0)
    assert made.longest_ms < ORDER_S_MAX * 1000
    assert made.stands.unnamed_ms < STALL_MS, made.stands.unnamed
    assert sum(made.done.values()) >= 4


@FEW
@given(SEEDS)
@example(1174)  # a new scheduler named a session that the robot had left
def test_once_nothing_goes_wrong_any_more_everybody_arrives(seed):
    made = busy_lattice(seed, HARD)
    made.run(60, grants_every=0)
    made.calm()
    before = dict(made.done)
    for _ in range(30):
        made.run(10, grants_every=0)
        if all(made.done[name] > before.get(name, 0) for name in made.robots):
            return
    raise AssertionError([plan.wait for plan in made.traffic.plans(made.now_ms)])


def test_the_same_seed_gives_the_same_grants():
    runs = []
    for _ in range(2):
        made = busy_lattice(7, HARD)
        made.run(40, grants_every=0)
        runs.append((made.traffic.plans(made.now_ms), made.poses, made.happened))
    assert runs[0] == runs[1]


def conserved(seed: int, robots: int, rounds: int, mix: FaultMix) -> None:
    """(8) Orders end exactly once, whoever is restarted; with the judge of the whole looking on."""
    file = generate(aisles=3, bays=2, robots=robots, seed=seed)
    shift = Shift(file, seed=seed, faults=mix)
    onlooker, chance, bins = Onlooker(shift), random.Random(seed), bins_of(file)
    orders = []
    for _ in range(rounds):
        for _ in range(robots):
            source, target = chance.sample(bins, 2)
            orders.append(shift.order(load(source), unload(target)))
        onlooker.run(chance.uniform(5.0, 20.0))
        if chance.random() < 0.5:
            onlooker.restart_scheduler()
        if chance.random() < 0.3:
            shift.restart_core()
    for _ in range(60):
        if not any(order in shift.fleet.orders for order in orders):
            break
        onlooker.run(15.0)
    onlooker.each_order_ended_once()
    assert set(orders) <= onlooker.ends.keys()
    assert not any(order in shift.fleet.orders for order in orders)


@pytest.mark.parametrize("silent_s", [1.0, 30.0])
def test_a_new_scheduler_keeps_others_off_a_robot_that_does_not_answer(silent_s):
    shift = Shift(SceneFile(name="lane", areas=(lattice(4, 1),), robots=CONFIGS))
    onlooker = Onlooker(shift)
    onlooker.run(3.0)
    there = {robot.point: robot.body.name for robot in shift.world.robots()}
    shift.world.cut(shift.scene, there["P1-0"], deaf=True)
    onlooker.run(silent_s)
    onlooker.restart_scheduler()
    shift.order(StepTask(location="P2-0"))
    onlooker.run(60.0)
    shift.world.mend(shift.scene, there["P1-0"])
    onlooker.run(60.0)
    assert not shift.fleet.orders


def test_every_order_ends_once_whatever_goes_wrong():
    conserved(3, robots=3, rounds=2, mix=FaultMix(late_ratio=0.1, lost_ratio=0.1))


def stage(seed: int) -> None:
    """For the soak: more robots for longer, on lattices, and whole sites with their core."""
    if seed % 2:
        made = busy_lattice(seed, STANDARD.times(6), 8, 8)
        made.run(600, grants_every=15)
        connected(made.traffic)
        assert made.stands.unnamed_ms < STALL_MS, made.stands.unnamed
        return
    conserved(seed, robots=6, rounds=8, mix=STANDARD.times(6))
