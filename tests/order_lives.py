"""What may happen next to the orders of a history (tests/histories.py)."""

from random import Random

from ledger.events import (
    AnyEvent,
    AssignmentRejected,
    ExecutionRejected,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderFaulted,
    OrderFinished,
    OrderPrioritised,
    OrderRetried,
    OrderSealed,
    OrderSuspended,
    OrderUnsuspended,
    OrderWithdrawn,
    StepChange,
    StepFinished,
    StepsAdded,
    StepsChanged,
    StepsDeleted,
    StepStarted,
)
from ledger.ids import OrderId, SceneId
from ledger.state import (
    BinStatus,
    Candidate,
    Fleet,
    Order,
    OrderKind,
    OrderStatus,
    StepStatus,
    StepTask,
)


def created(random: Random, fleet: Fleet, scene: SceneId) -> OrderCreated:
    day = "20260922"
    number = fleet.order_counts.get(day, 0) + 1
    return OrderCreated(
        scene=scene,
        order=OrderId(f"TO{day}-{number:06}"),
        kind=OrderKind.BUSINESS,
        external_id=f"wms-{number}" if random.random() < 0.5 else None,
        priority=random.randint(-5, 100),
        container=f"C{number}" if random.random() < 0.5 else None,
        sealed=random.random() < 0.7,
        tasks=tasks(random),
    )


def tasks(random: Random) -> tuple[StepTask, ...]:
    where = [f"B{random.randint(1, 4)}" for _ in range(random.randint(1, 3))]
    last = len(where) - 1
    return tuple(
        StepTask(
            location=location,
            arguments='{"binTask": "load"}' if n == 0 else None,
            loads=n == 0 and last > 0,
            unloads=n == last and last > 0,
            withdrawable=n == 0,
        )
        for n, location in enumerate(where)
    )


def life(random: Random, fleet: Fleet, order: Order) -> list[AnyEvent]:
    """Give what may happen to the order next; likely things are there more than once."""
    scene, id_ = order.scene, order.id
    coming = range(max(order.current_step, order.done_step) + 1, len(order.steps))
    may: list[AnyEvent] = []
    if random.random() < 0.1:
        may.append(OrderPrioritised(scene=scene, order=id_, priority=random.randint(0, 9)))
    if random.random() < 0.1:
        may.append(OrderCancelled(scene=scene, order=id_))
    if not order.sealed:
        may.append(StepsAdded(scene=scene, order=id_, tasks=tasks(random)))
        may += [OrderSealed(scene=scene, order=id_)] * 3
        if coming:
            change = StepChange(step=coming[0], task=StepTask(location="B1"))
            may.append(StepsChanged(scene=scene, order=id_, changes=(change,)))
        if len(coming) > 1:
            gone = (order.steps[coming[-1]].id,)
            may.append(StepsDeleted(scene=scene, order=id_, steps=gone))
    if not order.suspended and random.random() < 0.03:
        may.append(OrderSuspended(scene=scene, order=id_))
    if order.suspended:
        return [*may, *_going(random, order, range(0)), OrderUnsuspended(scene=scene, order=id_)]
    if order.robot is None:
        return may + _waiting(random, fleet, order)
    return may + _going(random, order, coming)


def _waiting(random: Random, fleet: Fleet, order: Order) -> list[AnyEvent]:
    if fleet.scenes[order.scene].dispatch_paused:
        return []
    free = [
        (robot, number)
        for robot in fleet.robots.values()
        if robot.online and not robot.off_duty and not robot.config.disabled
        for number, content in enumerate(robot.bins)
        if content.status is BinStatus.EMPTY
    ]
    if not free:
        robots = dict.fromkeys((r.name for r in fleet.robots.values()), "RobotBusy")
        code = "AllRobotUnDispatchable"
        if order.allocation_reject is not None and order.allocation_reject.robots == robots:
            return []  # only news is stated
        return [AssignmentRejected(scene=order.scene, order=order.id, code=code, robots=robots)]
    robot, number = random.choice(free)
    cost_s = round(random.uniform(1, 60), 3)
    assigned = OrderAssigned(
        scene=order.scene,
        order=order.id,
        robot=robot.name,
        bin=number,
        cost_s=cost_s,
        candidates=(Candidate(robot=robot.name, cost_s=cost_s),),
    )
    return [assigned] * 4


def _going(random: Random, order: Order, coming: range) -> list[AnyEvent]:
    scene, id_, robot = order.scene, order.id, order.robot
    if robot is None:
        return []
    if order.fault_reason is not None:
        return [OrderRetried(scene=scene, order=id_)] * 4
    may: list[AnyEvent] = []
    if random.random() < 0.1:
        may.append(OrderFaulted(scene=scene, order=id_, reason="JackFailed"))
        may.append(ExecutionRejected(scene=scene, order=id_, code="Blocked", robots={robot: "R9"}))
        may.append(ExecutionRejected(scene=scene, order=id_, code=""))
        if not order.loaded:
            may.append(OrderWithdrawn(scene=scene, order=id_, robot=robot, reason="Cheaper"))
    now = order.current_step
    if 0 <= now < len(order.steps) and order.steps[now].status is StepStatus.EXECUTING:
        may += [StepFinished(scene=scene, order=id_, step=now, robot=robot)] * 8
    elif coming:
        may += [StepStarted(scene=scene, order=id_, step=coming[0], robot=robot)] * 8
    elif order.sealed and order.status is OrderStatus.PENDING:
        may += [OrderFinished(scene=scene, order=id_)] * 8
    return may
