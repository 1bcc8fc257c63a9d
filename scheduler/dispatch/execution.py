"""What a robot's present step asks of it: where to be, what to do there, what to leave off.

All of it follows from state and reports alone, so a restarted scheduler goes on where it was.
"""

import json
from functools import lru_cache

from ledger.ids import RobotName
from ledger.link import Act, ActionPhase, Cancel
from ledger.scene import Bin, Value
from ledger.state import OrderKind, Step
from scheduler.current import kept_order
from scheduler.dispatch.stopped import stopped
from scheduler.goal import Goal
from scheduler.places import Place
from scheduler.view import RobotView, View

SYSTEM_PRIORITY = -1_000_000  # parking and charging give way to every business order
CHARGE = "Charge"
SETTLED_MS = 2_000  # so long on one spot is rest, whatever noise the speed shows


class Action(Value, frozen=True, kw_only=True):
    """What the robot is to do at the step's place."""

    name: str
    arguments: str = "{}"  # JSON object text
    wrong: str | None = None  # why nobody could do it


def keeps_robot(robot: RobotView) -> bool:
    """Tell whether its next step is already bound to one order (spec/m4.md, nextStepSameOrder)."""
    at = robot.at
    if at is not None and at.begun and at.step.task.keeps_robot:
        return True
    return kept_order(robot.orders) is not None


def action(step: Step, place: Place) -> Action | None:
    """Read the step's arguments; none, or an empty object, means that being there is enough.

    A bin task stands for the robot's own operation and arguments; what the client added wins.
    """
    if step.task.arguments is None:
        return None
    return _read(step.task.arguments, step.task.location, place.bin)


@lru_cache(maxsize=4096)
def _read(text: str, location: str, spot: Bin | None) -> Action | None:
    try:
        asked = json.loads(text)
    except ValueError:
        return Action(name="", wrong=f"arguments for {location} are not JSON")
    if not isinstance(asked, dict) or not asked:
        return None
    name = asked.pop("binTask", None)
    if name is None:
        name = str(asked.get("operation", ""))
        return Action(name=name, arguments=_object(asked))
    task = next((t for t in spot.tasks if t.name == name), None) if spot is not None else None
    if task is None:
        return Action(name=str(name), wrong=f"{location} has no bin task {name}")
    merged = {"operation": task.operation, **json.loads(task.arguments or "{}"), **asked}
    return Action(name=task.name, arguments=_object(merged))


def _object(arguments: dict[str, object]) -> str:
    return json.dumps(arguments, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def place_of(view: View, step: Step) -> Place | None:
    """Find where a step is done."""
    return view.place(step.task.location)


def _running(robot: RobotView) -> str | None:
    told = robot.report.action if robot.report is not None else None
    return told.id if told is not None and told.phase is ActionPhase.RUNNING else None


def _rests(robot: RobotView, now_ms: int) -> bool:
    """Tell whether the very last creep is over: robots refuse to act while they move at all."""
    report = robot.report
    if report is None:
        return False
    at_rest = report.speed_mps == 0.0 and report.turn_radps == 0.0
    return at_rest or now_ms - robot.still_since_ms >= SETTLED_MS


def due_action(view: View, robot: RobotView, now_ms: int) -> Act | None:
    """Give the action to be told: the robot rests at the step's place and has not begun.

    Repeating it is harmless (link rule: a repeated id is the same action), forgetting it is not.
    """
    at = robot.at
    if at is None or not at.begun or at.order.fault_reason is not None or robot.report is None:
        return None
    if at.order.suspended or stopped(robot) is not None:
        return None
    told = robot.report.action
    if told is not None and (told.id == at.attempt or told.phase is ActionPhase.RUNNING):
        return None
    place = place_of(view, at.step)
    if place is None or not view.stands_at(robot, place) or not _rests(robot, now_ms):
        return None
    wanted = action(at.step, place)
    if wanted is None or wanted.wrong is not None:
        return None
    if at.step.task.loads and not view.roads.has_room(robot.name):
        return None
    return Act(
        robot=robot.name,
        id=at.attempt,
        name=wanted.name,
        bin=at.order.bin or 0,
        order=at.order.id,
        arguments=wanted.arguments,
    )


def due_cancel(view: View, robot: RobotView) -> Cancel | None:
    """Give the cancel of an action that no order of the robot wants any more.

    The setting keep_robot_on_cancel lets such an action run to its end; charging has none.
    """
    running = _running(robot)
    if running is None or robot.report is None:
        return None
    at = robot.at
    if at is not None and at.begun and at.attempt == running:
        return None
    if view.scene.config.keep_robot_on_cancel and not robot.report.charging:
        return None
    return Cancel(robot=robot.name, id=running)


def is_acting(robot: RobotView) -> bool:
    """Tell whether an action runs, by its own report."""
    return _running(robot) is not None


def takes_load(view: View, robot: RobotView) -> bool:
    """Tell whether its step puts a load on it where it rests: now, or once there is room for it."""
    at = robot.at
    if at is None or not at.begun or not at.step.task.loads:
        return False
    if at.order.suspended and not is_acting(robot):
        return False
    place = place_of(view, at.step)
    return place is not None and view.stands_at(robot, place)


def is_busy(view: View, robot: RobotView) -> bool:
    """Tell whether it must neither move nor be pushed: it acts, is about to, or failed at it.

    One whose order is suspended may make way meanwhile.
    """
    if is_acting(robot):
        return True
    at = robot.at
    if at is None or not at.begun:
        return False
    if at.order.suspended and at.order.fault_reason is None:
        return False
    place = place_of(view, at.step)
    if place is None or not view.stands_at(robot, place):
        return False
    return action(at.step, place) is not None


def goal(view: View, robot: RobotView) -> Goal | None:
    """Give where the robot should go: to the step it is at. A robot without one can be pushed.

    None for an order that waits for somebody: to retry it, or to let it go on.
    """
    at = robot.at
    if at is None or not at.begun or at.order.fault_reason is not None or at.order.suspended:
        return None
    place = place_of(view, at.step)
    if place is None or robot.report is None or robot.report.area != place.area:
        return None
    order = at.order
    priority = order.priority if order.kind is OrderKind.BUSINESS else SYSTEM_PRIORITY
    since_ms = order.assigned_ms or order.created_ms
    return Goal(point=place.point.name, rank=(-priority, since_ms, robot.name))


def goals(view: View) -> dict[RobotName, Goal]:
    """Give the goals of all robots that have one; those that may not drive have none."""
    found: dict[RobotName, Goal] = {}
    for name, robot in view.robots.items():
        in_service = robot.robot.online and not robot.robot.config.disabled
        if in_service and stopped(robot) is None:
            wanted = goal(view, robot)
            if wanted is not None:
                found[name] = wanted
    return found
