"""What lasts: waits, states of robots, faults, reservations, each from an event to another."""

from collections.abc import Iterable
from typing import Any, TypeVar

import msgspec

from ledger.events import (
    AnyEvent,
    AssignmentRejected,
    DeviceFaulted,
    DeviceRecovered,
    Event,
    ExecutionRejected,
    MapResourcesAsked,
    MapResourcesGranted,
    MapResourcesReleased,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderFaulted,
    OrderFinished,
    OrderRetried,
    OrderWithdrawn,
    RobotAdded,
    RobotConnected,
    RobotDisconnected,
    RobotGivenUp,
    RobotRemoved,
    SceneRemoved,
)
from ledger.events.orders import OfOrder
from ledger.events.robots import OfRobot
from ledger.ids import RobotKey, RobotName, SceneId, robot_key
from ledger.link import InstructionKind
from ledger.scene import Value
from ledger.state import Fleet, Order, OrderKind, Robot


class Span(Value, frozen=True, kw_only=True):
    """Something that began, and has ended or not."""

    scene_id: str
    position: int  # of the event that it began with
    began_ms: int
    ended_ms: int | None = None
    ended_by: str | None = None  # type of the event


class Wait(Span, frozen=True, kw_only=True):
    """An order waits, for one reason."""

    order_id: str
    kind: str
    phase: str  # Assignment: for a robot; Execution: with one
    code: str | None = None
    robot: str | None = None


class RobotState(Span, frozen=True, kw_only=True):
    """A time in which nothing changed about what a robot is for."""

    robot: str
    state: str
    online: bool
    off_duty: bool
    disabled: bool
    soft_stopped: bool
    paused: bool
    order_id: str | None
    orders: int


class Fault(Span, frozen=True, kw_only=True):
    """An order, a robot or a device does not work."""

    of: str  # Order, Robot, Door or Lift
    robot: str | None = None
    order_id: str | None = None
    device: int | None = None
    reason: str


class Reservation(Span, frozen=True, kw_only=True):
    """Ground that somebody outside asked for, and held."""

    unit_id: str
    owner: str
    granted_ms: int | None = None
    lapsed: bool = False


S = TypeVar("S", bound=Span)
_SPENT = {
    OrderKind.BUSINESS: "Busy",
    OrderKind.CHARGING: "Charging",
    OrderKind.PARKING: "Parking",
    OrderKind.IDLE_AVOID: "Avoiding",
}
_CARRIERS = (OrderAssigned, OrderWithdrawn, OrderFinished, OrderCancelled)
ORDER_FAULT, ROBOT_FAULT = "Order", "Robot"


class Spans:
    """What lasts now, by what it is of, and what has ended since the last `clear`."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.open: dict[type[Span], dict[str, Any]] = {
            Wait: {},
            RobotState: {},
            Fault: {},
            Reservation: {},
        }
        self.ended: dict[type[Span], list[Any]] = {kind: [] for kind in self.open}

    def resume(self, spans: Iterable[Span]) -> None:
        """Take back what lasted when all was left."""
        for span in spans:
            self.open[type(span)][_key(span)] = span

    def clear(self) -> None:
        """Forget what has ended: it is kept elsewhere now."""
        for ended in self.ended.values():
            ended.clear()

    def take(self, event: AnyEvent, before: Order | None, fleet: Fleet) -> None:
        """Take in an event: `before` is its order before it, `fleet` the state after it."""
        if isinstance(event, OfOrder):
            self._order(event, before)
            if isinstance(event, _CARRIERS):
                name = before.robot if before is not None and before.robot else None
                name = event.robot if isinstance(event, OrderAssigned) else name
                self._robot(event, name, fleet)
        elif isinstance(event, OfRobot):
            self._robot_fault(event)
            self._robot(event, _name(event), fleet)
        elif isinstance(event, SceneRemoved):
            for kind in (RobotState, Fault):
                gone = [k for k, s in self.open[kind].items() if s.scene_id == event.scene]
                for key in gone:
                    self._end(kind, key, event)
        else:
            self._device_or_ground(event)

    def _begin(self, span: Span) -> None:
        self.open[type(span)][_key(span)] = span

    def _end(self, kind: type[Span], key: str, event: Event, **more: Any) -> None:
        span = self.open[kind].pop(key, None)
        if span is not None:
            by = type(event).__name__
            more |= {"ended_ms": event.at_ms, "ended_by": by}
            self.ended[kind].append(msgspec.structs.replace(span, **more))

    def _order(self, event: OfOrder, before: Order | None) -> None:
        id_, phase, code, robot = event.order, "Assignment", None, None
        kind = event.kind if isinstance(event, OrderCreated) else before and before.kind
        match event:
            case OrderCreated() | OrderWithdrawn():
                pass
            case AssignmentRejected():
                code = event.code
            case ExecutionRejected():
                phase, code = "Execution", event.code
                robot = before.robot if before is not None else None
            case OrderAssigned():
                code = ""
            case OrderFinished() | OrderCancelled():
                code = ""
                if isinstance(event, OrderCancelled):
                    self._end(Fault, f"{ORDER_FAULT}/{id_}", event)
            case OrderFaulted() | OrderRetried():
                self._order_fault(event, before)
                return
            case _:
                return
        self._end(Wait, id_, event)
        if code == "":  # nothing is waited for
            return
        self._begin(
            Wait(**_since(event), order_id=id_, kind=str(kind), phase=phase, code=code, robot=robot)
        )

    def _order_fault(self, event: OrderFaulted | OrderRetried, before: Order | None) -> None:
        self._end(Fault, f"{ORDER_FAULT}/{event.order}", event)
        if isinstance(event, OrderFaulted):
            robot = before.robot if before is not None else None
            reason, id_ = event.reason, event.order
            self._begin(
                Fault(**_since(event), of=ORDER_FAULT, robot=robot, order_id=id_, reason=reason)
            )

    def _robot_fault(self, event: OfRobot) -> None:
        name = _name(event)
        key = f"{ROBOT_FAULT}/{event.scene}/{name}"
        match event:
            case RobotDisconnected():
                fault = Fault(**_since(event), of=ROBOT_FAULT, robot=name, reason="Offline")
                self.open[Fault].setdefault(key, fault)
            case RobotGivenUp():  # the same outage, of which less is to be hoped
                fault = Fault(**_since(event), of=ROBOT_FAULT, robot=name, reason="GivenUp")
                known = self.open[Fault].setdefault(key, fault)
                self.open[Fault][key] = msgspec.structs.replace(known, reason="GivenUp")
            case RobotConnected() | RobotRemoved():
                self._end(Fault, key, event)
            case _:
                pass

    def _robot(self, event: OfOrder | OfRobot, name: RobotName | None, fleet: Fleet) -> None:
        """Look at the robot anew: it may be for something else from now on."""
        if name is None:
            return
        key = robot_key(event.scene, name)
        robot = fleet.robots.get(key)
        last = self.open[RobotState].get(key)
        if robot is not None:
            span = _state_of(robot, fleet, event)
            if last is not None and _same(last, span):
                return
        if last is not None and last.began_ms == event.at_ms:
            del self.open[RobotState][key]  # it was so for no time
        self._end(RobotState, key, event)
        if robot is not None:
            self._begin(span)

    def _device_or_ground(self, event: AnyEvent) -> None:
        match event:
            case DeviceFaulted():
                self._end(Fault, _device_key(event), event)
                fault = Fault(
                    **_since(event), of=event.kind, device=event.device, reason=event.reason
                )
                self._begin(fault)
            case DeviceRecovered():
                self._end(Fault, _device_key(event), event)
            case MapResourcesAsked():
                for unit in event.units:
                    self._begin(Reservation(**_since(event), unit_id=unit.id, owner=unit.owner))
            case MapResourcesGranted():
                for id_ in event.units:
                    held = self.open[Reservation].get(id_)
                    if held is not None:
                        held = msgspec.structs.replace(held, granted_ms=event.at_ms)
                        self.open[Reservation][id_] = held
            case MapResourcesReleased():
                for id_ in event.units:
                    self._end(Reservation, id_, event, lapsed=event.lapsed)
            case _:
                pass


def _since(event: Event) -> dict[str, Any]:
    return {"scene_id": event.scene, "position": event.position, "began_ms": event.at_ms}


def _name(event: OfRobot) -> RobotName:
    name: RobotName = (
        event.config.name if isinstance(event, RobotAdded) else getattr(event, "robot")  # noqa: B009 -- each other event of a robot names it
    )
    return name


def _device_key(event: DeviceFaulted | DeviceRecovered) -> str:
    return f"{event.kind}/{event.scene}/{event.device}"


def _key(span: Span) -> str:
    match span:
        case Wait():
            return span.order_id
        case RobotState():
            return _robot_key(span.scene_id, span.robot)
        case Reservation():
            return span.unit_id
        case Fault():
            if span.of == ORDER_FAULT:
                return f"{ORDER_FAULT}/{span.order_id}"
            what = span.device if span.device is not None else span.robot
            return f"{span.of}/{span.scene_id}/{what}"
        case _:
            pass
    raise AssertionError(f"{span} is of no kind that lasts")


def _robot_key(scene: str, robot: str) -> RobotKey:
    return robot_key(SceneId(scene), RobotName(robot))


def _state_of(robot: Robot, fleet: Fleet, event: OfOrder | OfRobot) -> RobotState:
    """Say what a robot is for; where several things hold, the first of this list names it."""
    told = {i.kind for i in robot.instructions if i.on}
    stopped = InstructionKind.SOFT_STOP in told
    paused = InstructionKind.PAUSE in told
    kinds = {id_: fleet.orders[id_].kind for id_ in robot.orders}
    business = (id_ for id_, kind in kinds.items() if kind is OrderKind.BUSINESS)
    order = next(business, next(iter(kinds), None))
    if robot.config.disabled:
        state = "Disabled"
    elif not robot.online:
        state = "Offline"
    elif stopped:
        state = "SoftStopped"
    elif paused:
        state = "Paused"
    elif order is not None:
        state = _SPENT[kinds[order]]
    else:
        state = "OffDuty" if robot.off_duty else "Idle"
    return RobotState(
        **_since(event),
        robot=robot.name,
        state=state,
        online=robot.online,
        off_duty=robot.off_duty,
        disabled=robot.config.disabled,
        soft_stopped=stopped,
        paused=paused,
        order_id=order,
        orders=len(robot.orders),
    )


def _same(last: RobotState, now: RobotState) -> bool:
    began = {"began_ms": last.began_ms, "position": last.position}
    return msgspec.structs.replace(now, **began) == last
