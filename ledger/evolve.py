"""What each event means: the fold that gives the state. It never refuses an event."""

from collections.abc import Iterable
from typing import Any, assert_never

import msgspec

from ledger.events import (
    AnyEvent,
    AssignmentRejected,
    CommandAnswered,
    ExecutionRejected,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderEvent,
    OrderFaulted,
    OrderFinished,
    OrderPrioritised,
    OrderRetried,
    OrderSealed,
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
    StepsAdded,
    StepsChanged,
    StepsDeleted,
    StepStarted,
)
from ledger.events.orders import OfOrder
from ledger.events.robots import OfRobot
from ledger.ids import OrderId, StepId, robot_key
from ledger.scene import RobotConfig, Scene
from ledger.state import (
    Answer,
    BinStatus,
    Fleet,
    Order,
    OrderStatus,
    Reject,
    Robot,
    RobotBin,
    Step,
    StepStatus,
    StepTask,
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


def order_created(event: OrderCreated) -> Order:
    """Give the order that this event begins."""
    return Order(
        id=event.order,
        scene=event.scene,
        kind=event.kind,
        created_ms=event.at_ms,
        created_by=event.by,
        modified_ms=event.at_ms,
        modified_by=event.by,
        external_id=event.external_id,
        priority=event.priority,
        wanted_robots=event.wanted_robots,
        wanted_groups=event.wanted_groups,
        container=event.container,
        container_type=event.container_type,
        container_heading_rad=event.container_heading_rad,
        key_locations=event.key_locations,
        sealed=event.sealed,
        steps=_steps(event.order, event.tasks, 0, event.at_ms),
        steps_made=len(event.tasks),
    )


def _steps(order: OrderId, tasks: tuple[StepTask, ...], made: int, at_ms: int) -> tuple[Step, ...]:
    return tuple(
        Step(id=StepId(f"{order}-Step{n}"), task=task, created_ms=at_ms, modified_ms=at_ms)
        for n, task in enumerate(tasks, made)
    )


def order_after(order: Order, event: OrderEvent) -> Order:
    """Give the order as it is after one more event of its own.

    The arms stand in the order of how often their events come: a fold tries them one by one.
    """
    match event:
        case StepStarted():
            return _step_started(order, event)
        case StepFinished():
            return _step_finished(order, event)
        case OrderAssigned():
            return _changed(
                order,
                event,
                status=OrderStatus.ALLOCATED,
                robot=event.robot,
                bin=event.bin,
                assigned_ms=event.at_ms,
                cost_s=event.cost_s,
                allocation_reject=None,
            )
        case OrderFinished():
            return _changed(
                order, event, status=OrderStatus.DONE, done_ms=event.at_ms, execution_reject=None
            )
        case AssignmentRejected():
            reject = Reject(code=event.code, robots=event.robots, at_ms=event.at_ms)
            return _changed(order, event, allocation_reject=reject)
        case ExecutionRejected():
            why = Reject(code=event.code, robots=event.robots, at_ms=event.at_ms)
            return _changed(order, event, execution_reject=why if event.code else None)
        case OrderCreated():
            return order_created(event)
        case StepsAdded():
            return _steps_added(order, event)
        case StepsChanged():
            return _steps_changed(order, event)
        case StepsDeleted():
            gone = frozenset(event.steps)
            left = tuple(step for step in order.steps if step.id not in gone)
            return _pending_if_all_done(_changed(order, event, steps=left))
        case OrderSealed():
            return _changed(order, event, sealed=True)
        case OrderPrioritised():
            return _changed(order, event, priority=event.priority)
        case OrderWithdrawn():
            return _withdrawn(order, event)
        case OrderFaulted():
            return _changed(
                order,
                event,
                fault_reason=event.reason,
                fault_count=order.fault_count + 1,
                faulted_ms=event.at_ms,
            )
        case OrderRetried():
            return _fault_ended(_changed(order, event), event.at_ms)
        case OrderCancelled():
            order = _fault_ended(order, event.at_ms)
            return _changed(order, event, status=OrderStatus.CANCELLED, done_ms=event.at_ms)
        case _:
            assert_never(event)


def _changed(order: Order, event: OrderEvent, **fields: Any) -> Order:
    return replace(
        order,
        version=order.version + 1,
        modified_ms=event.at_ms,
        modified_by=event.by,
        **fields,
    )


def _with(steps: tuple[Step, ...], index: int, step: Step) -> tuple[Step, ...]:
    return (*steps[:index], step, *steps[index + 1 :])


def _steps_added(order: Order, event: StepsAdded) -> Order:
    steps = _steps(order.id, event.tasks, order.steps_made, event.at_ms)
    waited = order.status is OrderStatus.PENDING  # for these
    return _changed(
        order,
        event,
        steps=order.steps + steps,
        steps_made=order.steps_made + len(steps),
        status=OrderStatus.ALLOCATED if waited else order.status,
        container=order.container if event.container is None else event.container,
    )


def _steps_changed(order: Order, event: StepsChanged) -> Order:
    container = order.container if event.container is None else event.container
    order = _changed(order, event, container=container)
    for change in event.changes:
        before = order.steps[change.step]
        step = replace(
            before, task=change.task, modified_ms=event.at_ms, version=before.version + 1
        )
        order = replace(order, steps=_with(order.steps, change.step, step))
    return order


def _pending_if_all_done(order: Order) -> Order:
    if order.robot is None or any(s.status is not StepStatus.DONE for s in order.steps):
        return order
    return replace(order, status=OrderStatus.PENDING)


def _withdrawn(order: Order, event: OrderWithdrawn) -> Order:
    steps = tuple(
        replace(s, status=StepStatus.EXECUTABLE, started_ms=None, modified_ms=event.at_ms)
        if s.status is StepStatus.EXECUTING
        else s
        for s in order.steps
    )
    return _changed(
        order,
        event,
        status=OrderStatus.TO_BE_ALLOCATED,
        robot=None,
        bin=None,
        assigned_ms=None,
        cost_s=None,
        steps=steps,
        current_step=order.done_step,
        former_robots=(*order.former_robots, event.robot),
        execution_reject=None,
    )


def _step_started(order: Order, event: StepStarted) -> Order:
    step = replace(
        order.steps[event.step],
        status=StepStatus.EXECUTING,
        started_ms=event.at_ms,
        modified_ms=event.at_ms,
        version=order.steps[event.step].version + 1,
    )
    waited_ms = order.waited_ms
    if waited_ms is None and order.assigned_ms is not None:
        waited_ms = event.at_ms - order.assigned_ms
    return _changed(
        order,
        event,
        steps=_with(order.steps, event.step, step),
        status=OrderStatus.EXECUTING,
        current_step=event.step,
        waited_ms=waited_ms,
    )


def _step_finished(order: Order, event: StepFinished) -> Order:
    before = order.steps[event.step]
    step = replace(
        before,
        status=StepStatus.DONE,
        ended_ms=event.at_ms,
        modified_ms=event.at_ms,
        version=before.version + 1,
    )
    spent_ms = event.at_ms - (before.started_ms or event.at_ms)
    steps = _with(order.steps, event.step, step)
    order = _changed(order, event, steps=steps, done_step=event.step)
    if before.task.loads:
        order = replace(order, loaded=True, load_ms=(order.load_ms or 0) + spent_ms)
    if before.task.unloads:
        order = replace(order, unloaded=True, unload_ms=(order.unload_ms or 0) + spent_ms)
    return _pending_if_all_done(order)


def _fault_ended(order: Order, at_ms: int) -> Order:
    if order.faulted_ms is None:
        return order
    fault_ms = (order.fault_ms or 0) + at_ms - order.faulted_ms
    return replace(order, fault_reason=None, faulted_ms=None, fault_ms=fault_ms)


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
