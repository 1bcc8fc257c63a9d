"""What each event means: the fold that gives the state. It never refuses an event."""

from collections.abc import Iterable
from typing import assert_never

import msgspec

from ledger.events import (
    AnyEvent,
    CommandAnswered,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderEvent,
    OrderFinished,
    OrderWithdrawn,
    RobotAdded,
    RobotBinsCleared,
    RobotConnected,
    RobotDisabled,
    RobotDisconnected,
    RobotEnabled,
    RobotEvent,
    RobotRemoved,
    RobotWentOffDuty,
    RobotWentOnDuty,
    SceneConfigured,
    SceneImported,
    SceneMapReplaced,
    StepFinished,
)
from ledger.events.orders import OfOrder
from ledger.events.robots import OfRobot
from ledger.evolve_order import order_after, order_created
from ledger.ids import robot_key
from ledger.scene import RobotConfig, Scene
from ledger.state import (
    Answer,
    BinStatus,
    Fleet,
    Order,
    Robot,
    RobotBin,
)

ANSWERS_MAX = 10_000  # answers kept for repeated Idempotency-Keys

replace = msgspec.structs.replace
# events of an order that change what its robot carries, or whose it is
_CARRIED = (OrderAssigned, StepFinished, OrderWithdrawn, OrderFinished, OrderCancelled)


def fold(fleet: Fleet, events: Iterable[AnyEvent]) -> Fleet:
    """Evolve through all events, in order."""
    for event in events:
        evolve(fleet, event)
    return fleet


def evolve(fleet: Fleet, event: AnyEvent) -> None:
    """Take one event into the state."""
    if isinstance(event, OfOrder):
        _evolve_order(fleet, event)
    elif isinstance(event, OfRobot):
        _evolve_robot(fleet, event)
    else:
        match event:
            case SceneImported():
                fleet.scenes[event.scene] = Scene(
                    id=event.scene,
                    name=event.name,
                    digest=event.digest,
                    areas=event.areas,
                    groups=event.groups,
                    container_types=event.container_types,
                    config=event.config,
                )
            case SceneMapReplaced():
                fleet.scenes[event.scene] = replace(
                    fleet.scenes[event.scene],
                    digest=event.digest,
                    areas=event.areas,
                    groups=event.groups,
                    container_types=event.container_types,
                )
            case SceneConfigured():
                scene = fleet.scenes[event.scene]
                fleet.scenes[event.scene] = replace(scene, config=event.config)
            case CommandAnswered():
                fleet.answers[event.command] = Answer(
                    digest=event.digest, status=event.status, body=event.body, at_ms=event.at_ms
                )
                while len(fleet.answers) > ANSWERS_MAX:
                    del fleet.answers[next(iter(fleet.answers))]
            case _:
                assert_never(event)
    fleet.position = event.position
    fleet.at_ms = event.at_ms


def _evolve_robot(fleet: Fleet, event: RobotEvent) -> None:
    if isinstance(event, RobotAdded):
        robot = Robot(
            scene=event.scene,
            config=event.config,
            bins=(RobotBin(),) * event.config.bin_count,
            idle_since_ms=event.at_ms,
        )
        fleet.robots[robot_key(event.scene, robot.name)] = robot
        return
    key = robot_key(event.scene, event.robot)
    robot = fleet.robots[key]
    match event:
        case RobotRemoved():
            del fleet.robots[key]
            return
        case RobotWentOffDuty():
            robot = replace(robot, off_duty=True)
        case RobotWentOnDuty():
            robot = replace(robot, off_duty=False, idle_since_ms=event.at_ms)
        case RobotDisabled():
            robot = replace(robot, config=_disabled(robot.config, disabled=True))
        case RobotEnabled():
            config = _disabled(robot.config, disabled=False)
            robot = replace(robot, config=config, idle_since_ms=event.at_ms)
        case RobotConnected():
            robot = replace(robot, online=True)
        case RobotDisconnected():
            robot = replace(robot, online=False)
        case RobotBinsCleared():
            bins = (RobotBin() if b.status is BinStatus.CANCELLED else b for b in robot.bins)
            robot = replace(robot, bins=tuple(bins))
        case _:
            assert_never(event)
    fleet.robots[key] = robot


def _disabled(config: RobotConfig, *, disabled: bool) -> RobotConfig:
    return replace(config, disabled=disabled)


def _evolve_order(fleet: Fleet, event: OrderEvent) -> None:
    if isinstance(event, OrderCreated):
        day = event.order[2:10]
        fleet.order_counts[day] = fleet.order_counts.get(day, 0) + 1
        fleet.orders[event.order] = order_created(event)
        return
    before = fleet.orders[event.order]
    after = order_after(before, event)
    if after.terminal:
        del fleet.orders[event.order]
    else:
        fleet.orders[event.order] = after
    _evolve_carrier(fleet, before, after, event)


def _evolve_carrier(fleet: Fleet, before: Order, after: Order, event: OrderEvent) -> None:
    """Keep the robot's bins and list of orders in step with its order."""
    if not isinstance(event, _CARRIED):
        return
    name = after.robot if after.robot is not None else before.robot
    index = after.bin if after.bin is not None else before.bin
    if name is None or index is None:
        return
    key = robot_key(after.scene, name)
    robot = fleet.robots[key]
    content: RobotBin | None = None  # what the bin holds from now on, if that changes
    orders = robot.orders
    if isinstance(event, OrderAssigned):
        content = RobotBin(status=BinStatus.RESERVED, order=after.id, container=after.container)
        orders = (*orders, after.id)
    elif isinstance(event, StepFinished):
        task = after.steps[event.step].task
        if task.loads:
            content = RobotBin(status=BinStatus.FILLED, order=after.id, container=after.container)
        elif task.unloads:
            content = RobotBin(status=BinStatus.RESERVED, order=after.id)
    elif isinstance(event, OrderWithdrawn) or after.terminal:
        on_board = robot.bins[index].status is BinStatus.FILLED
        content = replace(robot.bins[index], status=BinStatus.CANCELLED) if on_board else RobotBin()
        orders = tuple(o for o in orders if o != after.id)
    if content is None:
        return
    fleet.robots[key] = replace(
        robot,
        bins=(*robot.bins[:index], content, *robot.bins[index + 1 :]),
        orders=orders,
        idle_since_ms=robot.idle_since_ms if orders else event.at_ms,
    )
