"""Ledgers of any length for benchmarks: a hundred robots that do one order after the other."""

from collections.abc import Iterator
from pathlib import Path

from ledger.disk import Disk
from ledger.events import (
    AnyEvent,
    OrderAssigned,
    OrderCreated,
    OrderFinished,
    RobotAdded,
    SceneImported,
    StepFinished,
    StepStarted,
    stamped,
)
from ledger.evolve import evolve
from ledger.ids import CommandId, OrderId, RobotName, SceneId
from ledger.scene import Group, RobotConfig
from ledger.snapshot import EVENTS_APART, save
from ledger.state import Fleet, StepTask
from ledger.store import FileLedger

BATCH = 500
SCENE = SceneId("0" * 24)
START_MS = 1_700_000_000_000


def history(robots: int) -> Iterator[AnyEvent]:
    """Orders with one step, each done by the next robot in turn: six events an order."""
    yield SceneImported(
        scene=SCENE, name="bench", digest="", areas=(), groups=(Group(id=0, name="g"),)
    )
    names = [RobotName(f"AMB-{n}") for n in range(robots)]
    for name in names:
        yield RobotAdded(scene=SCENE, config=RobotConfig(name=name))
    number = 0
    while True:
        number += 1
        order, robot = OrderId(f"TO20231114-{number:06d}"), names[number % robots]
        task = StepTask(location="AP1", arguments='{"binTask":"Load"}', loads=False)
        yield OrderCreated(scene=SCENE, order=order, sealed=True, tasks=(task,))
        yield OrderAssigned(scene=SCENE, order=order, robot=robot, bin=0, cost_s=1.5)
        yield StepStarted(scene=SCENE, order=order, step=0, robot=robot)
        yield StepFinished(scene=SCENE, order=order, step=0, robot=robot)
        yield OrderFinished(scene=SCENE, order=order)


def write(folder: Path, events: int, disk: Disk | None = None) -> None:
    """Write a ledger of so many events, with snapshots on the way."""
    ledger = FileLedger.open(folder / "ledger", disk=disk)
    fleet = Fleet()
    source = history(100)
    while fleet.position < events:
        first = fleet.position
        batch = []
        for place in range(first + 1, first + BATCH + 1):
            event = stamped(next(source), place, START_MS + place * 10, "bench", CommandId("c"))
            evolve(fleet, event)
            batch.append(event)
        ledger.append(batch, first)
        ledger.wait(fleet.position, 30)
        if fleet.position % EVENTS_APART == 0:
            save(folder / "snapshots", fleet)
    ledger.close()
