"""Histories that make sense: a scene with robots, doors and the lives of orders.

A history comes from a seed and a length, and a shorter one is a prefix of a longer one: it shrinks
by its length, and benchmarks may ask for a million events without Hypothesis.
"""

from collections.abc import Iterator
from random import Random

from hypothesis import strategies as st

from ledger.events import (
    AnswersWindowSet,
    AnyEvent,
    CommandAnswered,
    RobotAdded,
    RobotConnected,
    SceneImported,
    stamped,
)
from ledger.evolve import evolve
from ledger.ids import CommandId, SceneId
from ledger.state import Fleet
from tests import order_lives
from tests.site_lives import DOORS, LIFTS, of_device, of_ground, of_robot, of_scene, of_traffic
from tests.strategies import DAY_MS, SCENE, grid


def histories(min_events: int = 0, max_events: int = 120) -> st.SearchStrategy[list[AnyEvent]]:
    """Stamped events from position 1 that evolve accepts in this order, from an empty fleet."""
    return st.builds(history, st.integers(0, 2**16), st.integers(min_events, max_events))


def history(seed: int, count: int, scene: SceneId = SCENE) -> list[AnyEvent]:
    """Give the first `count` events of the history with this seed."""
    happening = happenings(seed, scene)
    return [next(happening) for _ in range(count)]


def happenings(seed: int, scene: SceneId = SCENE) -> Iterator[AnyEvent]:
    """Go on for ever: a scene with robots and the lives of orders, each event evolved."""
    random = Random(seed)
    fleet = Fleet()
    for blank in _openings(scene):
        yield _happen(random, fleet, blank)
    while True:
        blank = _next(random, fleet, scene)
        if blank is not None:
            yield _happen(random, fleet, blank)


def _happen(random: Random, fleet: Fleet, blank: AnyEvent) -> AnyEvent:
    position = fleet.position + 1
    at_ms = max(fleet.at_ms, DAY_MS) + random.choice((0, 0, 1, 40, 2_000))
    by = random.choice(("alice", "scheduler"))
    command = CommandId(f"c{position}")
    if isinstance(blank, CommandAnswered):
        by, command = "alice", CommandId(f"key-{position}")
    event = stamped(blank, position, at_ms, by, command)
    evolve(fleet, event)
    return event


def _openings(scene: SceneId) -> Iterator[AnyEvent]:
    file = grid(robots=3)
    yield SceneImported(
        scene=scene,
        name=file.name,
        digest="d" * 64,
        areas=file.areas,
        groups=file.groups,
        doors=DOORS,
        lifts=LIFTS,
    )
    for config in file.robots:
        yield RobotAdded(scene=scene, config=config)
        yield RobotConnected(scene=scene, robot=config.name)


def _next(random: Random, fleet: Fleet, scene: SceneId) -> AnyEvent | None:
    roll = random.random()
    if roll < 0.12 or not fleet.orders:
        return order_lives.created(random, fleet, scene) if len(fleet.orders) < 40 else None
    if roll < 0.87:
        order = fleet.orders[random.choice(list(fleet.orders))]
        may = order_lives.life(random, fleet, order)
        return random.choice(may) if may else None
    if roll < 0.96:
        return of_robot(random, fleet, scene)
    if roll < 0.995:
        kind = random.choice((of_scene, of_ground, of_device, of_device))
        return kind(random, fleet, scene)
    if roll < 0.997:
        return of_traffic(random, fleet, scene)
    if roll < 0.9985:
        return CommandAnswered(scene=scene, digest="a" * 64, status=200, body='{"ok":true}')
    return AnswersWindowSet(scene=scene, count_max=random.randint(1, 50), age_s_max=3600)
