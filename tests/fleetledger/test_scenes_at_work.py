"""Scenes and their settings with all roles at work, on virtual time."""

from typing import Any

import msgspec
import pytest

from commands.decide import AnyCommand
from commands.robots import CreateRobots
from commands.scene_config import ConfigureScene
from commands.scene_life import CreateScene, DisableScene, PauseDispatch, RemoveScenes
from commands.scenes import ImportScene, scene_digest
from fleetledger.shift import Shift
from ledger.events import AnyEvent, OrderAssigned, OrderCreated, OrderFinished, RobotConnected
from ledger.ids import CommandId, SceneId
from ledger.scene import SceneFile
from ledger.scene_config import SceneConfig
from ledger.state import OrderKind, OrderStatus, StepTask
from sim.warehouses import generate

FILE = generate(aisles=2, bays=2, robots=2, seed=1)
BINS = [bin_.name for area in FILE.areas for bin_ in area.bins]
NEW = SceneId("F" * 24)


def ask(shift: Shift, kind: type[AnyCommand], **fields: Any) -> None:
    command: Any = kind
    shift.handler.handle(command(id=CommandId("c"), by="alice", at_ms=shift.now_ms, **fields))


def configure(shift: Shift, **settings: Any) -> None:
    config = msgspec.structs.replace(shift.fleet.scenes[shift.scene].config, **settings)
    ask(shift, ConfigureScene, scene=shift.scene, config=config)


def fill(shift: Shift, file: SceneFile) -> SceneId:
    ask(shift, ImportScene, scene=NEW, digest=scene_digest(file), file=file)
    return next(s.id for s in shift.fleet.scenes.values() if s.name == file.name and not s.removed)


def happened(shift: Shift, kind: type[AnyEvent]) -> list[Any]:
    return [e for e in shift.ledger.read(0) if isinstance(e, kind)]


def carry(shift: Shift) -> str:
    return shift.order(StepTask(location=BINS[0]), StepTask(location=BINS[-1]))


def until(shift: Shift, seconds: float, true: Any) -> bool:
    for _ in range(int(seconds)):
        if true():
            return True
        shift.run(1)
    return bool(true())


@pytest.fixture
def shift() -> Shift:
    shift = Shift(FILE)
    assert until(shift, 30, lambda: len(happened(shift, RobotConnected)) == 2)
    return shift


def driven_m(shift: Shift) -> list[float]:
    return sorted(robot.odometer_m for robot in shift.world.robots())


def test_paused_traffic_gives_no_new_moves_until_it_goes_on(shift: Shift) -> None:
    configure(shift, parking_paused=True)
    order = carry(shift)
    assert until(shift, 20, lambda: shift.fleet.orders[order].status is OrderStatus.EXECUTING)
    configure(shift, traffic_paused=True)
    shift.run(40)  # to the end of what was granted
    still = driven_m(shift)
    shift.run(40)
    assert driven_m(shift) == still
    assert order in shift.fleet.orders
    configure(shift, traffic_paused=False)
    assert until(shift, 200, lambda: order not in shift.fleet.orders)


def test_idle_robots_park_after_the_time_that_was_set(shift: Shift) -> None:
    configure(shift, parking_idle_s=10_000, charging_paused=True)
    before = len(happened(shift, OrderCreated))
    shift.run(60)
    assert len(happened(shift, OrderCreated)) == before
    configure(shift, parking_idle_s=0)
    moved = carry(shift)  # away from where they may have stood to park
    assert until(shift, 200, lambda: moved not in shift.fleet.orders)

    def parks() -> bool:
        return any(e.kind is OrderKind.PARKING for e in happened(shift, OrderCreated))

    assert until(shift, 30, parks)


def test_while_dispatch_is_paused_orders_wait_and_then_go(shift: Shift) -> None:
    ask(shift, PauseDispatch, scene=shift.scene, paused=True)
    order = carry(shift)
    shift.run(60)
    assert not happened(shift, OrderAssigned)
    assert shift.fleet.orders[order].status is OrderStatus.TO_BE_ALLOCATED
    ask(shift, PauseDispatch, scene=shift.scene, paused=False)
    assert until(shift, 200, lambda: order not in shift.fleet.orders)


def test_a_scene_out_of_service_rests_and_goes_on_where_it_was(shift: Shift) -> None:
    order, waiting = carry(shift), carry(shift)
    assert until(shift, 20, lambda: shift.fleet.orders[order].status is OrderStatus.EXECUTING)
    ask(shift, DisableScene, scene=shift.scene, disabled=True)
    shift.run(60)
    assigned = len(happened(shift, OrderAssigned))
    shift.restart_scheduler()
    shift.run(60)
    assert len(happened(shift, OrderAssigned)) == assigned
    assert {order, waiting} <= shift.fleet.orders.keys()
    ask(shift, DisableScene, scene=shift.scene, disabled=False)
    assert until(shift, 300, lambda: not {order, waiting} & shift.fleet.orders.keys())


def test_a_removed_scene_leaves_nobody_behind_and_its_file_opens_a_new_one(shift: Shift) -> None:
    order = carry(shift)
    assert until(shift, 200, lambda: order not in shift.fleet.orders)
    ask(shift, RemoveScenes, scenes=(shift.scene,))
    shift.run(20)
    assert len(shift.world) == 0
    assert not shift.fleet.robots
    assert not shift.fleet.orders
    old, position = shift.scene, shift.fleet.position
    shift.scene = fill(shift, FILE)
    assert shift.scene == NEW
    order = carry(shift)
    assert until(shift, 200, lambda: order not in shift.fleet.orders)
    assert all(e.scene != old for e in shift.ledger.read(position))


def test_an_empty_scene_is_quiet_and_works_once_it_is_filled(shift: Shift) -> None:
    ask(shift, CreateScene, scene=NEW, name="new")
    ask(shift, CreateRobots, scene=NEW, robots=FILE.robots[:1])
    shift.run(30)
    other = msgspec.structs.replace(FILE, name="new", config=SceneConfig(parking_idle_s=5))
    assert fill(shift, other) == NEW
    old, shift.scene = shift.scene, NEW
    order = carry(shift)
    assert until(shift, 200, lambda: order not in shift.fleet.orders)
    assert len([r for r in shift.fleet.robots.values() if r.scene == NEW]) == 2
    assert next(e.order for e in happened(shift, OrderFinished) if e.scene == NEW) == order
    assert not shift.fleet.scenes[old].removed
