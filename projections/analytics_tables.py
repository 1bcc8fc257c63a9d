"""Tables behind the views of analytics, beside those of orders, steps and events."""

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from ledger.events import AnyEvent, AssignmentRejected, OrderAssigned, RobotsWaited
from ledger.scene import Value
from ledger.state import Robot
from ledger.waits import WaitReason
from projections.spans import Fault, Reservation, RobotState, Span, Wait
from projections.tables import Column

R = TypeVar("R")


class PlacedRobot(Value, frozen=True, kw_only=True):
    """A robot with the names of what it belongs to."""

    robot: Robot
    scene_name: str
    group: str


class Allocation(Value, frozen=True, kw_only=True):
    """A robot that was considered for an order, once."""

    order_id: str
    scene_id: str
    position: int
    at_ms: int
    outcome: str
    code: str | None = None
    robot: str | None = None
    chosen: bool = False
    cost_s: float | None = None
    reason: str | None = None


class RobotWait(Value, frozen=True, kw_only=True):
    """What one robot waited for in a stretch of time, summed up."""

    scene_id: str
    position: int
    from_ms: int
    until_ms: int
    robot: str
    reason: str
    blockers: list[str]
    place: str | None
    times: int
    seconds: float
    longest_s: float


class WaitCycle(Value, frozen=True, kw_only=True):
    """Robots that waited for each other."""

    scene_id: str
    position: int
    robots: list[str]
    from_ms: int
    until_ms: int | None


def waits_of(event: AnyEvent) -> Iterator[RobotWait]:
    """Give what each robot waited for, if an event sums that up."""
    if isinstance(event, RobotsWaited):
        for wait in event.waits:
            yield RobotWait(
                scene_id=event.scene,
                position=event.position,
                from_ms=event.from_ms,
                until_ms=event.at_ms,
                robot=wait.robot,
                reason=wait.reason.value,
                blockers=list(wait.blockers),
                place=wait.place,
                times=wait.times,
                seconds=wait.total_ms / 1000,
                longest_s=wait.longest_ms / 1000,
            )


def cycles_of(event: AnyEvent) -> Iterator[WaitCycle]:
    """Give the robots that waited for each other, if an event tells of any."""
    if isinstance(event, RobotsWaited):
        for cycle in event.cycles:
            yield WaitCycle(
                scene_id=event.scene,
                position=event.position,
                robots=list(cycle.robots),
                from_ms=cycle.from_ms,
                until_ms=cycle.until_ms,
            )


def allocations_of(event: AnyEvent) -> Iterator[Allocation]:
    """Give every robot that dispatch looked at when it decided about an order, if it did."""
    if not isinstance(event, OrderAssigned | AssignmentRejected):
        return
    head: dict[str, Any] = {
        "order_id": event.order,
        "scene_id": event.scene,
        "position": event.position,
        "at_ms": event.at_ms,
    }
    if isinstance(event, OrderAssigned):
        head["outcome"] = "Assigned"
        yield Allocation(**head, robot=event.robot, chosen=True, cost_s=event.cost_s)
        for other in event.candidates:
            if other.robot != event.robot:
                yield Allocation(
                    **head, robot=other.robot, cost_s=other.cost_s, reason=other.reason
                )
        return
    head |= {"outcome": "Rejected", "code": event.code}
    for robot, reason in event.robots.items():
        yield Allocation(**head, robot=robot, reason=reason)
    if not event.robots:
        yield Allocation(**head)


def _robot(
    name: str, type_: str, read: Callable[[PlacedRobot], Any], doc: str
) -> Column[PlacedRobot]:
    return Column(name=name, type=type_, read=read, doc=doc)


def _field(name: str, type_: str, doc: str) -> Column[Any]:
    """Describe a column that holds the field of the same name; a time's ends with `_ms` there."""
    field = f"{name.removesuffix('_on')}_ms" if name.endswith("_on") else name
    return Column(name=name, type=type_, read=lambda row: getattr(row, field), doc=doc)


ROBOTS: tuple[Column[PlacedRobot], ...] = (
    _robot("scene_id", "VARCHAR", lambda r: r.robot.scene, "Id of its scene."),
    _robot("scene_name", "VARCHAR", lambda r: r.scene_name, "Name of its scene."),
    _robot("name", "VARCHAR", lambda r: r.robot.name, "Unique in its scene."),
    _robot("group_name", "VARCHAR", lambda r: r.group, "Robots of one build."),
    _robot("online", "BOOLEAN", lambda r: r.robot.online, "Answers."),
    _robot("off_duty", "BOOLEAN", lambda r: r.robot.off_duty, "Takes no orders."),
    _robot("disabled", "BOOLEAN", lambda r: r.robot.config.disabled, "Out of dispatch."),
    _robot("simulated", "BOOLEAN", lambda r: r.robot.config.simulated, "Not made of steel."),
    _robot("bin_count", "BIGINT", lambda r: len(r.robot.bins), "Loads it carries at once."),
    _robot("orders", "VARCHAR[]", lambda r: list(r.robot.orders), "Orders it has now."),
    _robot("idle_since_on", "BIGINT", lambda r: r.robot.idle_since_ms, "Since when it has none."),
)
ALLOCATIONS = (
    _field("order_id", "VARCHAR", "Order that was decided about."),
    _field("scene_id", "VARCHAR", "Id of the scene."),
    _field(
        "position", "BIGINT", "Position of the decision's event: rows of one decision share it."
    ),
    _field("at_on", "BIGINT", "When it was decided."),
    _field("outcome", "VARCHAR", "Assigned, or Rejected: no robot was found."),
    _field("code", "VARCHAR", "Why no robot was found, of the order as a whole."),
    _field("robot", "VARCHAR", "Robot that was considered; NULL where the scene has none to ask."),
    _field("chosen", "BOOLEAN", "It got the order."),
    _field("cost_s", "DOUBLE", "What it would have cost, s; NULL where it could not take it."),
    _field("reason", "VARCHAR", "Why it could not take the order."),
)
ROBOT_WAITS: tuple[Column[RobotWait], ...] = (
    _field("scene_id", "VARCHAR", "Id of the scene."),
    _field("position", "BIGINT", "Position of the event that sums it up."),
    _field("from_on", "BIGINT", "Beginning of the stretch of time: ten minutes."),
    _field("until_on", "BIGINT", "Its end."),
    _field("robot", "VARCHAR", "Robot that waited."),
    _field(
        "reason",
        "VARCHAR",
        f"{', '.join(WaitReason)}: see [operations](operations.md#who-waits-for-whom).",
    ),
    _field(
        "blockers",
        "VARCHAR[]",
        "For whom: robots; `external:` with the owner of reserved ground, `door:` with its name.",
    ),
    _field(
        "place",
        "VARCHAR",
        "Point that it could not get to next; `A->B@1` is one on the way from A to B.",
    ),
    _field("times", "BIGINT", "How often in that time."),
    _field("seconds", "DOUBLE", "How long in all."),
    _field("longest_s", "DOUBLE", "How long once, counted from before that time if it began so."),
)
WAIT_CYCLES: tuple[Column[WaitCycle], ...] = (
    _field("scene_id", "VARCHAR", "Id of the scene."),
    _field("position", "BIGINT", "Position of the event that tells of it."),
    _field("robots", "VARCHAR[]", "Robots that waited for each other."),
    _field("from_on", "BIGINT", "Since when."),
    _field("until_on", "BIGINT", "Until when; NULL = they still did when it was told."),
)
_SPAN = (
    _field("scene_id", "VARCHAR", "Id of the scene."),
    _field("position", "BIGINT", "Position of the event that it began with."),
    _field("began_on", "BIGINT", "When it began."),
    _field("ended_on", "BIGINT", "When it ended; NULL = it lasts."),
    _field("ended_by", "VARCHAR", "Type of the event that ended it."),
)
SPANS: dict[type[Span], tuple[str, tuple[Column[Any], ...]]] = {
    Wait: (
        "waits",
        (
            _field("order_id", "VARCHAR", "Order that waits."),
            _field("kind", "VARCHAR", "OrderKind of spec/m4.md."),
            _field("phase", "VARCHAR", "Assignment: waits for a robot. Execution: with one."),
            _field("code", "VARCHAR", "Why; NULL = dispatch has not said yet."),
            _field("robot", "VARCHAR", "Robot that cannot get on, in phase Execution."),
            *_SPAN,
        ),
    ),
    RobotState: (
        "robot_states",
        (
            _field("robot", "VARCHAR", "Name of the robot."),
            _field(
                "state",
                "VARCHAR",
                "The first that holds of Disabled, Offline, SoftStopped, Paused, Busy (has a "
                "business order), Charging, Parking, Avoiding (has such an order), OffDuty, Idle.",
            ),
            _field("online", "BOOLEAN", "It answered."),
            _field("off_duty", "BOOLEAN", "It was to take no orders."),
            _field("disabled", "BOOLEAN", "It was out of dispatch."),
            _field("soft_stopped", "BOOLEAN", "The soft emergency stop was pressed."),
            _field("paused", "BOOLEAN", "It was told to stay."),
            _field("order_id", "VARCHAR", "Its order; of several the first business order."),
            _field("orders", "BIGINT", "How many orders it had."),
            *_SPAN,
        ),
    ),
    Fault: (
        "faults",
        (
            _field("of", "VARCHAR", "What does not work: Order, Robot, Door or Lift."),
            _field("robot", "VARCHAR", "Robot, or the one that had the order."),
            _field("order_id", "VARCHAR", "Order, if it is one's."),
            _field("device", "BIGINT", "Id of the door or lift."),
            _field("reason", "VARCHAR", "As stated; of robots Offline, or GivenUp in the end."),
            *_SPAN,
        ),
    ),
    Reservation: (
        "reservations",
        (
            _field("unit_id", "VARCHAR", "Id of the piece of ground that was asked for."),
            _field("owner", "VARCHAR", "Who asked: an external system, or a robot."),
            _field("granted_on", "BIGINT", "When it was held; NULL = not (yet)."),
            _field("lapsed", "BOOLEAN", "It was never held: robots did not leave in time."),
            *_SPAN,
        ),
    ),
}


def span_of(kind: type[Span], row: tuple[Any, ...]) -> Span:
    """Read a row of a table of spans."""
    columns = SPANS[kind][1]
    fields = (f"{c.name.removesuffix('_on')}_ms" if _is_time(c) else c.name for c in columns)
    return kind(**dict(zip(fields, row, strict=True)))


def _is_time(column: Column[Any]) -> bool:
    return column.name.endswith("_on")
