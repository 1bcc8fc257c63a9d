"""Laws of the whole: core, scheduler and robots at work together, on virtual time."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from fleetledger.shift import Shift
from ledger.codec import encode
from ledger.ids import OrderId
from ledger.scene import SceneFile
from sim.faults import FaultMix
from sim.warehouses import for_robots, generate
from tests.laws.onlooker import Onlooker, bins_of, load, unload

ORDER_S_MAX = 300.0  # of virtual time for one round of orders; twenty robots need about sixty


def some_orders(shift: Shift, file: SceneFile, count: int, rng: Random) -> list[OrderId]:
    bins = bins_of(file)
    loads = [rng.sample(bins, 2) for _ in range(count)]
    return [
        shift.order(load(source), unload(target), priority=rng.choice((0, 0, 5)))
        for source, target in loads
    ]


def until_ended(onlooker: Onlooker, orders: list[OrderId], seconds: float = ORDER_S_MAX) -> None:
    until_ms = onlooker.shift.now_ms + int(seconds * 1000)
    live = onlooker.shift.fleet.orders
    while any(order in live for order in orders):
        assert onlooker.shift.now_ms < until_ms, [live[o] for o in orders if o in live]
        onlooker.run(2.0)


def a_day(seed: int, robots: int = 4, restarts: bool = True) -> Shift:
    """A fixed story with delays, crowded bins and new schedulers in the middle of it."""
    file = generate(aisles=2, bays=2, robots=robots, seed=seed)
    shift = Shift(file, seed=seed, faults=FaultMix(late_ratio=0.2, late_mean_s=3.0))
    rng = Random(seed)
    for _ in range(3):
        some_orders(shift, file, robots, rng)
        shift.run(20.0)
        if restarts:
            shift.restart_scheduler()
        shift.run(20.0)
    return shift


def digest(shift: Shift) -> str:
    return hashlib.sha256(b"\n".join(encode(e) for e in shift.ledger.read(0))).hexdigest()


@pytest.mark.parametrize("robots", [1, 3, 8])
def test_all_orders_end_and_nobody_overlaps(robots: int) -> None:
    file = for_robots(robots, seed=robots)
    shift = Shift(file, seed=robots, faults=FaultMix(late_ratio=0.1, late_mean_s=4.0))
    onlooker = Onlooker(shift)
    orders = some_orders(shift, file, 2 * robots, Random(robots))
    until_ended(onlooker, orders)
    onlooker.states_agree()
    onlooker.each_order_ended_once()
    assert set(orders) <= onlooker.ends.keys()


def test_a_new_scheduler_goes_on_where_the_old_one_was() -> None:
    file = for_robots(6, seed=2)
    shift = Shift(file, seed=2)
    onlooker = Onlooker(shift)
    orders = some_orders(shift, file, 12, Random(2))
    for seconds in (0.2, 3.4, 7.2, 11.0, 4.8, 0.6):  # in the middle of whatever is going on
        onlooker.run(seconds)
        onlooker.restart_scheduler()
    until_ended(onlooker, orders)
    onlooker.states_agree()


def test_the_same_seed_gives_the_same_bytes() -> None:
    once, again, other = a_day(7), a_day(7), a_day(8)
    assert digest(once) == digest(again)
    assert once.fleet.canonical() == again.fleet.canonical()
    assert digest(once) != digest(other)


ELSEWHERE = "from tests.laws.test_shift_laws import a_day, digest; print(digest(a_day(7)))"


@pytest.mark.parametrize("hash_seed", ["1", "2"])
def test_another_process_comes_to_the_same_bytes(hash_seed: str) -> None:
    """Sets and hashes come in another order there, and nothing may hang on that."""
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        check=True,
    )
    assert done.stdout.split()[-1] == digest(a_day(7))


def stage(seed: int) -> None:
    """For the soak: a long shift, or one whose schedulers come and go."""
    if seed % 2:
        a_long_shift_keeps_its_laws(seed)
    else:
        schedulers_may_come_and_go_all_the_time(seed)


def a_long_shift_keeps_its_laws(seed: int) -> None:
    file = for_robots(20, seed=seed)
    shift = Shift(file, seed=seed, faults=FaultMix(late_ratio=0.1, late_mean_s=6.0))
    onlooker, rng = Onlooker(shift), Random(seed)
    orders: list[OrderId] = []
    for _ in range(20):
        orders += some_orders(shift, file, 10, rng)
        onlooker.run(rng.uniform(5.0, 60.0))
        if rng.random() < 0.3:
            onlooker.restart_scheduler()
    until_ended(onlooker, orders, 4 * ORDER_S_MAX)
    onlooker.states_agree()
    onlooker.each_order_ended_once()


def schedulers_may_come_and_go_all_the_time(seed: int) -> None:
    file = for_robots(12, seed=seed)
    shift = Shift(file, seed=seed, faults=FaultMix(late_ratio=0.2, late_mean_s=5.0))
    onlooker, rng = Onlooker(shift), Random(seed)
    orders: list[OrderId] = []
    for _ in range(40):
        if sum(order in shift.fleet.orders for order in orders) < 24:
            orders += some_orders(shift, file, 4, rng)
        onlooker.run(rng.uniform(1.0, 9.0))
        onlooker.restart_scheduler()
    until_ended(onlooker, orders, 3 * ORDER_S_MAX)
    onlooker.states_agree()
