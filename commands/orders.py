"""Transport orders as a whole: made, sealed, prioritised, retried, cancelled (spec/m4.md §2).

Readings where the specification is silent:
- An order without steps must name key locations and stays open: a sealed one could never do
  anything, so creating or sealing an order without steps is refused.
- A sealed order whose steps are all done is finished, by whatever command brought that about; a
  faulted one only after its retry.
- Cancelling what is done or cancelled is ignored; every other command refuses it.
- A scene out of service refuses new orders and changes of orders; cancelling and suspending them
  still work, for they only wind down.
"""

from typing import TypeVar

from commands.command import Command, Decision, Events, at_most, known_scene, scene_of
from commands.ids import next_order_id, order_in_service, unknown_order, was_made
from commands.places import check_location, check_task, places_of
from commands.rejected import Reason, Rejected
from ledger.events import (
    OrderCancelled,
    OrderCreated,
    OrderFinished,
    OrderPrioritised,
    OrderRetried,
    OrderSealed,
)
from ledger.ids import OrderId, RobotName, SceneId, robot_key
from ledger.scene import Scene
from ledger.state import Fleet, Order, OrderKind, StepStatus, StepTask

EXTERNAL_ID_CHARS_MAX = 50  # spec/m4.md, orders-create
PRIORITY_MAX = 2**31 - 1  # the wire's Int
PRIORITY_MIN = -(2**31)
STEPS_MAX = 1_000  # of one order, added ones included
KEY_LOCATIONS_MAX = 1_000
WANTED_MAX = 1_000  # robots or groups
BATCH_ORDERS_MAX = 10_000


class CreateOrder(Command, frozen=True, kw_only=True):
    """Make one order."""

    scene: SceneId
    external_id: str | None = None
    priority: int = 0
    wanted_robots: tuple[RobotName, ...] = ()
    wanted_groups: tuple[str, ...] = ()
    container: str | None = None
    container_type: str | None = None
    container_heading_rad: float | None = None
    key_locations: tuple[str, ...] = ()
    sealed: bool = False
    tasks: tuple[StepTask, ...] = ()


def create(fleet: Fleet, command: CreateOrder) -> Decision:
    """Key locations default to the steps' own, the container to one named after the order."""
    scene = scene_of(fleet, command.scene)
    _check_form(command)
    _check_wanted(fleet, scene, command)
    places = places_of(scene)
    for index, location in enumerate(command.key_locations):
        check_location(places, location, f"keyLocations[{index}]")
    for index, task in enumerate(command.tasks):
        check_task(places, task, f"steps[{index}]")
    order = next_order_id(fleet, command.at_ms, OrderKind.BUSINESS)
    created = OrderCreated(
        scene=scene.id,
        order=order,
        external_id=command.external_id,
        priority=command.priority,
        wanted_robots=command.wanted_robots,
        wanted_groups=command.wanted_groups,
        container=command.container or own_container(order, command.tasks),
        container_type=command.container_type,
        container_heading_rad=command.container_heading_rad,
        key_locations=command.key_locations or tuple(task.location for task in command.tasks),
        sealed=command.sealed,
        tasks=command.tasks,
    )
    return Decision(events=(created,), made=order)


def _check_form(command: CreateOrder) -> None:
    if command.external_id is not None and len(command.external_id) > EXTERNAL_ID_CHARS_MAX:
        message = f"Field 'externalId' may have {EXTERNAL_ID_CHARS_MAX} characters."
        raise Rejected(Reason.EXTERNAL_ID_TOO_LONG, message, EXTERNAL_ID_CHARS_MAX)
    _check_priority(command.priority)
    if not command.tasks and not command.key_locations:
        message = "Field 'keyLocations' must name a point of the map where 'steps' is empty."
        raise Rejected(Reason.ORDER_WITHOUT_GOAL, message)
    if command.sealed and not command.tasks:
        message = "Field 'steps' must not be empty where 'stepFixed' is true."
        raise Rejected(Reason.ORDER_NO_STEPS, message)
    at_most(len(command.tasks), STEPS_MAX, "steps")
    at_most(len(command.key_locations), KEY_LOCATIONS_MAX, "keyLocations")
    at_most(len(command.wanted_robots), WANTED_MAX, "expectedRobotNames")
    at_most(len(command.wanted_groups), WANTED_MAX, "expectedRobotGroups")


def _check_priority(priority: int) -> None:
    if not PRIORITY_MIN <= priority <= PRIORITY_MAX:
        message = f"Field 'priority' must be from {PRIORITY_MIN} to {PRIORITY_MAX}."
        raise Rejected(Reason.PRIORITY_INVALID, message, priority)


def _check_wanted(fleet: Fleet, scene: Scene, command: CreateOrder) -> None:
    for robot in command.wanted_robots:
        if robot_key(scene.id, robot) not in fleet.robots:
            message = f"Field 'expectedRobotNames': the scene has no robot '{robot}'."
            raise Rejected(Reason.ROBOT_UNKNOWN, message, robot)
    for group in command.wanted_groups:
        if all(group != known.name for known in scene.groups):
            message = f"Field 'expectedRobotGroups': the scene has no robot group '{group}'."
            raise Rejected(Reason.GROUP_UNKNOWN, message, group)
    wanted = command.container_type
    if wanted is not None and all(wanted != known.name for known in scene.container_types):
        message = f"Field 'containerTypeName': the scene has no container type '{wanted}'."
        raise Rejected(Reason.CONTAINER_TYPE_UNKNOWN, message, wanted)


def own_container(order: OrderId, tasks: tuple[StepTask, ...]) -> str | None:
    """Name the container of an order that names none, if it handles one at all.

    By the examples of spec/m4.md; move-only orders have none.
    """
    handles = any(task.loads or task.unloads for task in tasks)
    return f"container-{order}" if handles else None


class SealOrder(Command, frozen=True, kw_only=True):
    """Say that no more steps will come."""

    order: OrderId


def seal(fleet: Fleet, command: SealOrder) -> Decision:
    """An order whose steps are all done is thereby finished."""
    return Decision(events=_sealed(fleet, command.order))


def _sealed(fleet: Fleet, id_: OrderId) -> Events:
    order = order_in_service(fleet, id_)
    if order.sealed:
        raise Rejected(Reason.ORDER_SEALED, f"Order '{order.id}' is sealed already.", order.id)
    if not order.steps:
        message = f"Order '{order.id}' has no steps: add some, or cancel it."
        raise Rejected(Reason.ORDER_NO_STEPS, message, order.id)
    sealed = OrderSealed(scene=order.scene, order=order.id)
    if order.fault_reason is None and all_done(order):
        return sealed, OrderFinished(scene=order.scene, order=order.id)
    return (sealed,)


def all_done(order: Order) -> bool:
    """Tell whether nothing is left to do of the steps known so far."""
    return all(step.status is StepStatus.DONE for step in order.steps)


class SealOrders(Command, frozen=True, kw_only=True):
    """Seal several orders, each on its own."""

    orders: tuple[OrderId, ...]


def seal_each(fleet: Fleet, command: SealOrders) -> Decision:
    """Seal those that can be sealed."""
    events: list[OrderSealed | OrderFinished] = []
    refused: dict[str, Rejected] = {}
    for order in _distinct(command.orders, "orderIds"):
        try:
            events.extend(_sealed(fleet, order))  # type: ignore[arg-type]  # only these two come
        except Rejected as no:
            refused[order] = no.with_traceback(None)
    return Decision(events=tuple(events), refused=refused)


class CancelOrder(Command, frozen=True, kw_only=True):
    """Give one order up."""

    scene: SceneId
    order: OrderId


def cancel(fleet: Fleet, command: CancelOrder) -> Decision:
    """A finished order is left alone, silently; of which scene it was is not known any more."""
    scene = known_scene(fleet, command.scene)
    order = fleet.orders.get(command.order)
    if order is None:
        if was_made(fleet, command.order):
            return Decision()
        raise unknown_order(command.order)
    if order.scene != scene.id:
        message = f"Field 'sceneId': order '{order.id}' is of another scene."
        raise Rejected(Reason.ORDER_SCENE_MISMATCH, message, order.id, scene.id)
    return Decision(events=(OrderCancelled(scene=scene.id, order=order.id),))


class CancelOrders(Command, frozen=True, kw_only=True):
    """Give several orders up, each on its own."""

    orders: tuple[OrderId, ...]


def cancel_each(fleet: Fleet, command: CancelOrders) -> Decision:
    """Cancel the live ones, ignore the finished ones, refuse the unknown ones."""
    events: list[OrderCancelled] = []
    refused: dict[str, Rejected] = {}
    for id_ in _distinct(command.orders, "orderIds"):
        order = fleet.orders.get(id_)
        if order is not None:
            events.append(OrderCancelled(scene=order.scene, order=id_))
        elif not was_made(fleet, id_):
            refused[id_] = unknown_order(id_)
    return Decision(events=tuple(events), refused=refused)


class CancelAllOrders(Command, frozen=True, kw_only=True):
    """Give up every order of a scene, the system's own included."""

    scene: SceneId


def cancel_all(fleet: Fleet, command: CancelAllOrders) -> Decision:
    """An empty scene is no error."""
    scene = known_scene(fleet, command.scene)
    of_scene = [order for order in fleet.orders.values() if order.scene == scene.id]
    return Decision(
        events=tuple(OrderCancelled(scene=scene.id, order=order.id) for order in of_scene)
    )


class PrioritiseOrders(Command, frozen=True, kw_only=True):
    """Give several orders one priority; all of them, or none."""

    orders: tuple[OrderId, ...]
    priority: int


def prioritise(fleet: Fleet, command: PrioritiseOrders) -> Decision:
    """The call answers nothing per order, so one that cannot be set refuses them all."""
    _check_priority(command.priority)
    orders = [order_in_service(fleet, id_) for id_ in _distinct(command.orders, "orderIds")]
    return Decision(
        events=tuple(
            OrderPrioritised(scene=order.scene, order=order.id, priority=command.priority)
            for order in orders
            if order.priority != command.priority
        )
    )


class RetryOrders(Command, frozen=True, kw_only=True):
    """Go on with orders that have a fault, each on its own."""

    orders: tuple[OrderId, ...]


def retry(fleet: Fleet, command: RetryOrders) -> Decision:
    """Where all steps were done before the fault, the order is thereby finished."""
    events: list[OrderRetried | OrderFinished] = []
    refused: dict[str, Rejected] = {}
    for id_ in _distinct(command.orders, "orderIds"):
        try:
            order = order_in_service(fleet, id_)
            if order.fault_reason is None:
                message = f"Order '{id_}' has no fault."
                raise Rejected(Reason.ORDER_NOT_FAULTED, message, id_)
        except Rejected as no:
            refused[id_] = no.with_traceback(None)
            continue
        events.extend(retried(order))
    return Decision(events=tuple(events), refused=refused)


def retried(order: Order) -> tuple[OrderRetried | OrderFinished, ...]:
    """Go on with an order that has a fault."""
    again = OrderRetried(scene=order.scene, order=order.id)
    if order.sealed and all_done(order):
        return again, OrderFinished(scene=order.scene, order=order.id)
    return (again,)


T = TypeVar("T")


def _distinct(orders: tuple[T, ...], field: str) -> tuple[T, ...]:
    """Give each once, in order: asking twice for one thing is asking for it."""
    at_most(len(orders), BATCH_ORDERS_MAX, field)
    return tuple(dict.fromkeys(orders))
