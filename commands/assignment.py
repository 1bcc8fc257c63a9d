"""Who carries an order: what the scheduler proposes about it, decided on the newest state."""

from commands.command import Events, scene_of
from commands.ids import live_order, next_order_id
from commands.order_suspension import check_not_suspended
from commands.places import check_location, places_of
from commands.rejected import Reason, Rejected
from ledger.events import (
    AssignmentRejected,
    ExecutionRejected,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderWithdrawn,
)
from ledger.ids import OrderId, RobotName, SceneId, robot_key
from ledger.proposals import (
    AssignOrder,
    CreateSystemOrder,
    RejectAssignment,
    RejectExecution,
    WithdrawOrder,
)
from ledger.state import BinStatus, Fleet, Order, OrderKind, OrderStatus, Robot, StepTask


def assign(fleet: Fleet, proposal: AssignOrder) -> Events:
    """Business goes before the system's own needs.

    A robot that parks, charges or makes way lets go of that order, and of its bin, first.
    """
    order = order_in(fleet, proposal.scene, proposal.order)
    if order.status is not OrderStatus.TO_BE_ALLOCATED:
        message = f"Order '{order.id}' is {order.status}."
        raise Rejected(Reason.ORDER_ASSIGNED, message, order.id, order.status.value)
    check_unfaulted(order)
    check_not_suspended(order)
    _check_dispatching(fleet, proposal.scene)
    robot = _available(fleet, proposal.scene, proposal.robot)
    if robot.off_duty and order.kind is OrderKind.BUSINESS:
        raise _not_available(robot.name, "is off duty")
    _check_wanted(fleet, order, robot)
    own_needs = [
        other
        for other in map(fleet.orders.__getitem__, robot.orders)
        if other.kind is not OrderKind.BUSINESS
    ]
    _check_free(robot, proposal.bin, {other.id for other in own_needs})
    ended = tuple(OrderCancelled(scene=order.scene, order=other.id) for other in own_needs)
    assigned = OrderAssigned(
        scene=order.scene,
        order=order.id,
        robot=robot.name,
        bin=proposal.bin,
        cost_s=proposal.cost_s,
        candidates=proposal.candidates,
    )
    return (*ended, assigned)


def withdraw(fleet: Fleet, proposal: WithdrawOrder) -> Events:
    """What is loaded stays with its robot; an order of the system's own ends with it."""
    order = order_in(fleet, proposal.scene, proposal.order)
    if order.robot is None or order.bin is None:
        raise _not_assigned(order)
    robot = fleet.robots[robot_key(order.scene, order.robot)]
    if robot.bins[order.bin].status is BinStatus.FILLED:
        message = f"Order '{order.id}' is loaded on robot '{robot.name}'."
        raise Rejected(Reason.ORDER_LOADED, message, order.id, robot.name)
    if order.kind is not OrderKind.BUSINESS:
        return (OrderCancelled(scene=order.scene, order=order.id),)
    return (
        OrderWithdrawn(scene=order.scene, order=order.id, robot=robot.name, reason=proposal.reason),
    )


def reject_assignment(fleet: Fleet, proposal: RejectAssignment) -> Events:
    """Only news is an event."""
    order = order_in(fleet, proposal.scene, proposal.order)
    if order.status is not OrderStatus.TO_BE_ALLOCATED:
        message = f"Order '{order.id}' is {order.status}."
        raise Rejected(Reason.ORDER_ASSIGNED, message, order.id, order.status.value)
    known = order.allocation_reject
    if known is not None and (known.code, known.robots) == (proposal.code, proposal.robots):
        return ()
    return (
        AssignmentRejected(
            scene=order.scene, order=order.id, code=proposal.code, robots=proposal.robots
        ),
    )


def reject_execution(fleet: Fleet, proposal: RejectExecution) -> Events:
    """Only news is an event; an empty code takes the last reason back."""
    order = order_in(fleet, proposal.scene, proposal.order)
    known = order.execution_reject
    if proposal.code and order.robot is None:
        raise _not_assigned(order)
    if known is None and not proposal.code:
        return ()
    if known is not None and (known.code, known.robots) == (proposal.code, proposal.robots):
        return ()
    return (
        ExecutionRejected(
            scene=order.scene, order=order.id, code=proposal.code, robots=proposal.robots
        ),
    )


def create_system_order(fleet: Fleet, proposal: CreateSystemOrder, at_ms: int) -> Events:
    """Made and assigned in one: such an order is about its robot, and only while that is idle.

    A robot off duty may still park and charge.
    """
    if proposal.kind is OrderKind.BUSINESS:
        message = "Field 'kind' must be Parking, Charging or IdleAvoid."
        raise Rejected(Reason.ORDER_KIND_INVALID, message)
    _check_dispatching(fleet, proposal.scene)
    robot = _available(fleet, proposal.scene, proposal.robot)
    if robot.orders:
        message = f"Robot '{robot.name}' has order '{robot.orders[0]}'."
        raise Rejected(Reason.ROBOT_HAS_ORDERS, message, robot.name, *robot.orders)
    free = [n for n, content in enumerate(robot.bins) if content.status is BinStatus.EMPTY]
    if not free:
        message = f"Robot '{robot.name}' has no free bin."
        raise Rejected(Reason.ROBOT_BIN_TAKEN, message, robot.name)
    check_location(places_of(fleet.scenes[robot.scene]), proposal.location, "location")
    order = next_order_id(fleet, at_ms, proposal.kind)
    created = OrderCreated(
        scene=robot.scene,
        order=order,
        kind=proposal.kind,
        wanted_robots=(robot.name,),
        key_locations=(proposal.location,),
        sealed=True,
        tasks=(StepTask(location=proposal.location, arguments=proposal.arguments),),
    )
    assigned = OrderAssigned(
        scene=robot.scene, order=order, robot=robot.name, bin=free[0], cost_s=proposal.cost_s
    )
    return created, assigned


def order_in(fleet: Fleet, scene: SceneId, id_: OrderId) -> Order:
    """Find a live order of the scene."""
    order = live_order(fleet, id_)
    if order.scene != scene:
        message = f"Order '{id_}' is of another scene."
        raise Rejected(Reason.ORDER_SCENE_MISMATCH, message, id_, scene)
    return order


def check_unfaulted(order: Order) -> None:
    """Refuse to go on with an order that waits for a retry."""
    if order.fault_reason is not None:
        message = f"Order '{order.id}' has a fault: {order.fault_reason}."
        raise Rejected(Reason.ORDER_FAULTED, message, order.id)


def robot_in(fleet: Fleet, scene: SceneId, name: RobotName) -> Robot:
    """Find a robot of the scene."""
    robot = fleet.robots.get(robot_key(scene, name))
    if robot is None:
        message = f"The scene has no robot '{name}'."
        raise Rejected(Reason.ROBOT_UNKNOWN, message, name)
    return robot


def _available(fleet: Fleet, scene: SceneId, name: RobotName) -> Robot:
    robot = robot_in(fleet, scene, name)
    if robot.config.disabled:
        raise _not_available(name, "is disabled")
    if not robot.online:
        raise _not_available(name, "is offline")
    return robot


def _check_dispatching(fleet: Fleet, scene: SceneId) -> None:
    """The pause may be newer than the proposal."""
    if scene_of(fleet, scene).dispatch_paused:
        raise Rejected(Reason.SCENE_DISPATCH_PAUSED, f"Dispatch of scene '{scene}' is paused.")


def _not_available(robot: RobotName, why: str) -> Rejected:
    return Rejected(Reason.ROBOT_NOT_AVAILABLE, f"Robot '{robot}' {why}.", robot)


def _not_assigned(order: Order) -> Rejected:
    message = f"Order '{order.id}' has no robot."
    return Rejected(Reason.ORDER_NOT_ASSIGNED, message, order.id)


def _check_wanted(fleet: Fleet, order: Order, robot: Robot) -> None:
    """Named robots and named groups are one list (spec/m4.md, C32: the mildest reading)."""
    if not order.wanted_robots and not order.wanted_groups:
        return
    groups = {g.name for g in fleet.scenes[order.scene].groups if g.id == robot.config.group}
    if robot.name not in order.wanted_robots and groups.isdisjoint(order.wanted_groups):
        message = f"Order '{order.id}' is not for robot '{robot.name}'."
        raise Rejected(Reason.ROBOT_NOT_WANTED, message, order.id, robot.name)


def _check_free(robot: Robot, index: int, released: set[OrderId]) -> None:
    if not 0 <= index < len(robot.bins):
        message = f"Robot '{robot.name}' has no bin {index}."
        raise Rejected(Reason.ROBOT_BIN_TAKEN, message, robot.name, index)
    content = robot.bins[index]
    reserved_only = content.status is BinStatus.RESERVED and content.order in released
    if content.status is not BinStatus.EMPTY and not reserved_only:
        message = f"Bin {index} of robot '{robot.name}' is {content.status}."
        raise Rejected(Reason.ROBOT_BIN_TAKEN, message, robot.name, index)
