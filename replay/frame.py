"""What the console draws at a moment, live or past: one small JSON of robots and orders."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import StrEnum
from itertools import chain, islice

from ledger.ids import OrderId, PathKey, PointName, RobotName, SceneId
from ledger.link import ActionPhase, AlarmLevel, Plan, Report
from ledger.scene import Area, Group, Scene, Value
from ledger.state import BinStatus, Fleet, Order, OrderKind, Robot, RobotBin, Step
from replay.waiting import (
    ChainFrame,
    WaitFrame,
    chain_frames,
    name_of,
    wait_frames,
    wait_words,
    waits_of,
)
from replay.wire import Wire
from replay.words import STATUS, order_reason, robot_reason, task

STILL = 0.01  # m/s or rad/s; slower is standing
SCANNED_MAX = 20_000  # live orders searched for a text

XY = tuple[float, float]


class RobotState(StrEnum):
    """What a robot is doing, as the console colours it."""

    IDLE = "idle"
    MOVING = "moving"
    WAITING = "waiting"  # for other robots, or for what comes next
    WORKING = "working"
    CHARGING = "charging"
    BLOCKED = "blocked"  # by itself: stopped, an obstacle, an error
    OFFLINE = "offline"


DOES = {
    RobotState.IDLE: "has nothing to do",
    RobotState.MOVING: "drives",
    RobotState.WAITING: "stands",
    RobotState.WORKING: "works",
    RobotState.CHARGING: "charges",
    RobotState.BLOCKED: "is stopped",
    RobotState.OFFLINE: "is offline",
}


class RobotFrame(Wire, frozen=True, kw_only=True):
    """One robot; without a report there is no pose."""

    name: RobotName
    group: int
    state: RobotState
    words: str  # why it takes no orders, or does not get on; empty = nothing is wrong
    online: bool
    off_duty: bool
    disabled: bool
    orders: tuple[OrderId, ...]
    bins: tuple[RobotBin, ...]
    reported_ms: int | None = None
    area: int | None = None
    x: float | None = None  # metres
    y: float | None = None
    heading: float | None = None  # radians
    speed: float = 0.0  # m/s
    battery: float | None = None  # ratio
    point: PointName | None = None
    loads: tuple[str, ...] = ()
    target: PointName | None = None
    left: tuple[PathKey, ...] = ()  # paths still to be driven
    spaces: tuple[tuple[XY, ...], ...] = ()  # ground it holds
    blocked_by: tuple[RobotName, ...] = ()


class OrderFrame(Wire, frozen=True, kw_only=True):
    """One line of the list of orders."""

    id: OrderId
    kind: str
    status: str
    status_words: str
    reason: str  # why it does not get on; empty = nothing is in its way
    faulted: bool
    robot: RobotName | None
    priority: int
    route: tuple[str, ...]  # where its steps go
    steps_done: int
    created_ms: int
    done_ms: int | None
    external_id: str | None
    container: str | None


class StepFrame(Wire, frozen=True, kw_only=True):
    """One step of an order's story."""

    id: str
    words: str
    location: str
    arguments: str | None
    status: str
    started_ms: int | None
    ended_ms: int | None


class SceneName(Wire, frozen=True, kw_only=True):
    """A scene to choose."""

    id: SceneId
    name: str


class Frame(Wire, frozen=True, kw_only=True):
    """The console at one moment."""

    at_ms: int
    live: bool
    position: int
    first_ms: int | None  # of the first event: where the time slider begins
    now_ms: int
    scenes: tuple[SceneName, ...]
    scene: SceneId | None
    map_digest: str
    robots: tuple[RobotFrame, ...]
    orders: tuple[OrderFrame, ...]  # newest first
    orders_open: int
    waits: tuple[WaitFrame, ...]
    chains: tuple[ChainFrame, ...]  # who waits for whom, the longest wait first


class MapFrame(Wire, frozen=True, kw_only=True):
    """What of a scene does not move."""

    scene: SceneId
    name: str
    digest: str
    areas: tuple[Area, ...]
    groups: tuple[Group, ...]


class Wish(Value, frozen=True, kw_only=True):
    """Which orders to list."""

    limit: int = 0
    find: str = ""  # a text that they hold
    business_only: bool = False  # without parking, charging and making way


def robot_state(robot: Robot, report: Report | None, plan: Plan | None) -> RobotState:
    """Say what a robot is doing; the first that is true of: offline, blocked, charging, …"""
    if report is None or not robot.online:
        return RobotState.OFFLINE
    grave = any(a.level in (AlarmLevel.ERROR, AlarmLevel.FATAL) for a in report.alarms)
    if report.blocked or report.emergency_stop or report.soft_stop or grave:
        return RobotState.BLOCKED
    if report.charging:
        return RobotState.CHARGING
    if abs(report.speed_mps) > STILL or abs(report.turn_radps) > STILL:
        return RobotState.MOVING
    if report.action is not None and report.action.phase is ActionPhase.RUNNING:
        return RobotState.WORKING
    if robot.orders or (plan is not None and plan.blocked_by):
        return RobotState.WAITING
    return RobotState.IDLE


def _robot_words(robot: Robot, report: Report | None, plan: Plan | None) -> str:
    said = [robot_reason(robot)]
    if report is not None and robot.online:
        said += ["emergency stop"] * report.emergency_stop + ["stopped"] * report.soft_stop
        said += ["something is in its way"] * report.blocked
        said += [alarm.message or alarm.code for alarm in report.alarms]
    if plan is not None and plan.wait is not None:
        said.append(wait_words(plan.wait))
    elif plan is not None and plan.blocked_by:
        said.append(f"waits for {', '.join(map(name_of, plan.blocked_by))}")
    return "; ".join(words for words in said if words)


def loads_of(robot: Robot, report: Report | None) -> tuple[str, ...]:
    """What it carries: as it says itself, or else as its orders' steps say."""
    if report is not None and report.loads:
        return tuple(load.container for load in report.loads)
    aboard = (b for b in robot.bins if b.status in (BinStatus.FILLED, BinStatus.CANCELLED))
    return tuple(b.container or b.order or "" for b in aboard)


def robot_frame(robot: Robot, report: Report | None, plan: Plan | None) -> RobotFrame:
    """Put together what the ledger, the robot itself and traffic say of a robot."""
    return RobotFrame(
        name=robot.name,
        group=robot.config.group,
        state=robot_state(robot, report, plan),
        words=_robot_words(robot, report, plan),
        online=robot.online,
        off_duty=robot.off_duty,
        disabled=robot.config.disabled,
        orders=robot.orders,
        bins=robot.bins,
        reported_ms=report.at_ms if report else None,
        area=report.area if report else None,
        x=round(report.x_m, 3) if report else None,
        y=round(report.y_m, 3) if report else None,
        heading=round(report.heading_rad, 4) if report else None,
        speed=round(report.speed_mps, 2) if report else 0.0,
        battery=round(report.battery_ratio, 3) if report else None,
        point=report.point if report else None,
        loads=loads_of(robot, report),
        target=plan.target if plan else None,
        left=plan.untravelled if plan else (),
        spaces=tuple(space.points for space in plan.spaces) if plan else (),
        blocked_by=plan.blocked_by if plan else (),
    )


def order_frame(order: Order) -> OrderFrame:
    """Shorten an order to its line in the list."""
    words = STATUS[order.status]
    return OrderFrame(
        id=order.id,
        kind=order.kind.value,
        status=order.status.value,
        status_words="faulted" if order.fault_reason is not None else words,
        reason=order_reason(order),
        faulted=order.fault_reason is not None,
        robot=order.robot,
        priority=order.priority,
        route=tuple(step.task.location for step in order.steps),
        steps_done=order.done_step + 1,
        created_ms=order.created_ms,
        done_ms=order.done_ms,
        external_id=order.external_id,
        container=order.container,
    )


def step_frame(step: Step) -> StepFrame:
    """Say a step in words."""
    return StepFrame(
        id=step.id,
        words=task(step.task),
        location=step.task.location,
        arguments=step.task.arguments,
        status=step.status.value,
        started_ms=step.started_ms,
        ended_ms=step.ended_ms,
    )


def _holds(line: OrderFrame, text: str) -> bool:
    fields: Iterable[str | None] = (
        line.id,
        line.kind,
        line.status,
        line.status_words,
        line.reason,
        line.robot,
        line.external_id,
        line.container,
        *line.route,
    )
    return any(text in field.casefold() for field in fields if field)


def order_lines(
    orders: Iterable[Order], finished: Sequence[Order], wish: Wish
) -> tuple[OrderFrame, ...]:
    """Give the newest orders as wished; orders come newest first."""
    text, limit = wish.find.strip().casefold(), wish.limit

    def wanted(some: Iterable[Order]) -> Iterator[OrderFrame]:
        for order in islice(some, SCANNED_MAX):
            if wish.business_only and order.kind is not OrderKind.BUSINESS:
                continue
            line = order_frame(order)
            if not text or _holds(line, text):
                yield line

    known = {order.id for order in finished}
    living = islice(wanted(order for order in orders if order.id not in known), limit)
    lines = chain(living, islice(wanted(finished), limit))
    newest = sorted(lines, key=lambda line: (line.created_ms, line.id), reverse=True)
    return tuple(newest[:limit])


def build(
    fleet: Fleet,
    scene: Scene | None,
    *,
    at_ms: int,
    now_ms: int,
    live: bool,
    first_ms: int | None,
    report: Callable[[RobotName], Report | None],
    plan: Callable[[RobotName], Plan | None],
    finished: Sequence[Order] = (),
    wish: Wish,
) -> Frame:
    """Draw a fleet; without a scene there is nothing but the choice of scenes."""
    scenes = tuple(SceneName(id=s.id, name=s.name) for s in fleet.scenes.values() if not s.disabled)
    robots = [r for r in fleet.robots.values() if scene is not None and r.scene == scene.id]
    newest_first = (
        order
        for order in reversed(fleet.orders.values())  # made in order of creation
        if scene is not None and order.scene == scene.id
    )
    plans = {robot.name: plan(robot.name) for robot in robots}
    waits = waits_of(plans.values(), at_ms)

    def does(name: RobotName) -> str:
        known = next((robot for robot in robots if robot.name == name), None)
        return "" if known is None else DOES[robot_state(known, report(name), plans[name])]

    return Frame(
        at_ms=at_ms,
        live=live,
        position=fleet.position,
        first_ms=first_ms,
        now_ms=now_ms,
        scenes=scenes,
        scene=scene.id if scene else None,
        map_digest=scene.digest if scene else "",
        robots=tuple(robot_frame(r, report(r.name), plans[r.name]) for r in robots),
        orders=order_lines(newest_first, finished, wish) if wish.limit else (),
        orders_open=sum(scene is not None and o.scene == scene.id for o in fleet.orders.values()),
        waits=wait_frames(waits),
        chains=chain_frames(waits, does, at_ms),
    )
