"""Phase *continue*: robots begin, finish and fail the steps of the orders they have."""

from typing import TypeAlias

from ledger.ids import OrderId, PointName, RobotName
from ledger.link import DOOR, EXTERNAL, ActionPhase
from ledger.proposals import (
    AnyProposal,
    FaultOrder,
    FinishStep,
    RejectExecution,
    StartStep,
    WithdrawOrder,
)
from ledger.state import OrderKind
from scheduler.current import Current
from scheduler.dispatch.eligibility import trouble
from scheduler.dispatch.execution import action, is_busy, place_of, takes_load
from scheduler.dispatch.reasons import Why
from scheduler.dispatch.stopped import stopped
from scheduler.places import Place
from scheduler.view import RobotView, View

STILL_MS = 10_000  # a robot that has not moved for so long is worth a reason
REASON_CHANGES_EVERY_MS = 5_000  # one order's reason changes no oftener, unless it ends

Standing: TypeAlias = dict[PointName, set[RobotName]]  # who is on a point, by their own word


def continue_(view: View, so_far: tuple[AnyProposal, ...], now_ms: int) -> list[AnyProposal]:
    """Bring every robot's present step one state further, where the world allows it."""
    withdrawn = {p.order for p in so_far if isinstance(p, WithdrawOrder)}
    standing: Standing = {}
    for robot in view.robots.values():
        if robot.report is not None and robot.report.point is not None:
            standing.setdefault(robot.report.point, set()).add(robot.name)
    proposals: list[AnyProposal] = []
    for robot in view.robots.values():
        at = robot.at
        proposals.extend(_put_off(view, robot, at, withdrawn))
        if at is None or at.order.id in withdrawn:
            continue
        found = _advance(view, robot, at)
        # What gets on has no reason not to; it may even have ended by what was just proposed.
        proposals.extend(found or _explain(view, robot, at, standing, now_ms))
    return proposals


def _advance(view: View, robot: RobotView, at: Current) -> list[AnyProposal]:
    if at.order.fault_reason is not None or not _may_act(robot):
        return []
    order, scene = at.order.id, view.scene.id
    if not at.begun:
        held_up = at.order.suspended or stopped(robot) is not None or view.scene.disabled
        if held_up:
            return []
        return [StartStep(scene=scene, order=order, step=at.index, robot=robot.name)]
    place = place_of(view, at.step)
    if place is None:
        return []
    done, wrong = _outcome(view, robot, at, place)
    if wrong is not None:
        return [FaultOrder(scene=scene, order=order, reason=wrong)]
    if done:
        return [FinishStep(scene=scene, order=order, step=at.index, robot=robot.name)]
    return []


def _put_off(
    view: View, robot: RobotView, at: Current | None, withdrawn: set[OrderId]
) -> list[AnyProposal]:
    """Say of orders that the robot is not at whether they are suspended, when that changes."""
    proposals: list[AnyProposal] = []
    for order in robot.orders:
        told = order.execution_reject is not None and (
            order.execution_reject.code == Why.ORDER_SUSPENDED
        )
        here = at is not None and at.order.id == order.id
        if told is not order.suspended and not here and order.id not in withdrawn:
            code = Why.ORDER_SUSPENDED.value if order.suspended else ""
            proposals.append(RejectExecution(scene=view.scene.id, order=order.id, code=code))
    return proposals


def _may_act(robot: RobotView) -> bool:
    return robot.robot.online and robot.ready and not robot.robot.config.disabled


def _outcome(view: View, robot: RobotView, at: Current, place: Place) -> tuple[bool, str | None]:
    """Say whether the step is done, and what went wrong if anything did."""
    wanted = action(at.step, place)
    if wanted is None:
        return view.stands_at(robot, place), None
    if wanted.wrong is not None:
        return False, wanted.wrong
    told = robot.report.action if robot.report is not None else None
    mine = told is not None and told.id == at.attempt
    if told is not None and mine and told.phase is ActionPhase.FAILED:
        return False, told.message or f"{wanted.name} failed"
    done = told is not None and mine and told.phase is ActionPhase.DONE
    if at.order.kind is OrderKind.CHARGING:
        return _has_charged(view, robot, place, told_done=done), None
    return done, None


def _has_charged(view: View, robot: RobotView, place: Place, *, told_done: bool) -> bool:
    """Charging ends by level, not by time: at charge_full, or when the charger itself gives up.

    An order that comes sooner takes the robot away by being assigned (see eligibility).
    """
    if not view.stands_at(robot, place) or robot.report is None:
        return False
    full = robot.battery_ratio >= view.levels(robot).charge_full
    return full or (told_done and not robot.report.charging)


def _explain(
    view: View, robot: RobotView, at: Current, standing: Standing, now_ms: int
) -> list[AnyProposal]:
    """Say why the order does not get on, when the answer has changed; else say nothing."""
    code, others = _obstacle(view, robot, at, standing, now_ms)
    before = at.order.execution_reject
    scene, order = view.scene.id, at.order.id
    if code is None:
        return [RejectExecution(scene=scene, order=order, code="")] if before is not None else []
    if before is not None:
        same = before.code == code and before.robots == others
        if same or now_ms - before.at_ms < REASON_CHANGES_EVERY_MS:
            return []
    return [RejectExecution(scene=scene, order=order, code=code.value, robots=others)]


def _obstacle(
    view: View, robot: RobotView, at: Current, standing: Standing, now_ms: int
) -> tuple[Why | None, dict[RobotName, str]]:
    if view.scene.disabled:
        return Why.SCENE_DISABLED, {}
    why = trouble(view, robot)
    if why is not None:
        return why, {robot.name: why.value}
    if at.order.fault_reason is not None:
        return None, {}
    if at.order.suspended:
        return Why.ORDER_SUSPENDED, {}
    if robot.blocked_by and takes_load(view, robot) and not view.roads.has_room(robot.name):
        return Why.NO_ROOM_TO_LOAD, dict.fromkeys(
            sorted(robot.blocked_by), Why.ROBOT_IN_THE_WAY.value
        )
    paused = view.scene.config.traffic_paused
    if (not paused and robot.stuck_ms(at.order, now_ms) < STILL_MS) or is_busy(view, robot):
        return None, {}
    place = place_of(view, at.step)
    if place is None:
        return Why.LOCATION_UNKNOWN, {}
    if paused:
        return Why.TRAFFIC_PAUSED, {}
    if view.stands_at(robot, place):
        return None, {}
    if not robot.ready:
        return Why.ROBOT_NOT_READY, {robot.name: Why.ROBOT_NOT_READY.value}
    doors = sorted(name for name in robot.blocked_by if name.startswith(DOOR))
    if doors:
        broken = any(name.removeprefix(DOOR) in view.broken_doors for name in doors)
        why = Why.DOOR_FAULT if broken else Why.DOOR_CLOSED
        return why, dict.fromkeys(doors, why.value)
    owners = view.reserved(robot, place)
    if owners:
        whose = (RobotName(f"{EXTERNAL}{owner}") for owner in owners)
        return Why.GROUND_RESERVED, dict.fromkeys(whose, Why.GROUND_RESERVED.value)
    if view.cost_s(robot, place) == float("inf"):
        return Why.NO_ROUTE, {}
    if robot.report is not None and robot.report.blocked:
        return Why.ROBOT_OBSTRUCTED, {robot.name: Why.ROBOT_OBSTRUCTED.value}
    names = set(robot.blocked_by) or standing.get(place.point.name, set()) - {robot.name}
    blockers = (view.robots[name] for name in sorted(names) if name in view.robots)
    return Why.ROBOT_BLOCKED, {
        b.name: (trouble(view, b) or Why.ROBOT_IN_THE_WAY).value for b in blockers
    }
