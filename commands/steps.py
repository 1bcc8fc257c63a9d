"""The steps of an open order: appended, changed, deleted (spec/m4.md §2).

What a robot has begun stays as it is: only Executable steps can be changed or deleted.
"""

import msgspec

from commands.command import Command, Decision, Events, at_most
from commands.ids import order_in_service
from commands.orders import STEPS_MAX, own_container
from commands.places import check_task, places_of
from commands.rejected import Reason, Rejected
from ledger.events import OrderFinished, StepChange, StepsAdded, StepsChanged, StepsDeleted
from ledger.ids import OrderId, StepId
from ledger.scene import Value
from ledger.state import Fleet, Order, Step, StepStatus, StepTask


class AddSteps(Command, frozen=True, kw_only=True):
    """Append steps to an order that is not sealed."""

    order: OrderId
    tasks: tuple[StepTask, ...]


def add(fleet: Fleet, command: AddSteps) -> Decision:
    """Append only: a robot may already be driving to the steps it knows."""
    order = order_in_service(fleet, command.order)
    if order.sealed:
        message = f"Order '{order.id}' is sealed and takes no more steps."
        raise Rejected(Reason.ORDER_SEALED, message, order.id)
    _check_some(len(command.tasks))
    at_most(len(order.steps) + len(command.tasks), STEPS_MAX, "steps")
    places = places_of(fleet.scenes[order.scene])
    for index, task in enumerate(command.tasks):
        check_task(places, task, f"steps[{index}]")
    container = None if order.container else own_container(order.id, command.tasks)
    added = StepsAdded(scene=order.scene, order=order.id, tasks=command.tasks, container=container)
    return Decision(events=(added,))


class StepPatch(Value, frozen=True, kw_only=True):
    """New values for the step at an index; None leaves a value as it is."""

    step: int
    location: str | None = None
    arguments: str | None = None  # JSON object text; an empty object = no action any more
    loads: bool | None = None
    unloads: bool | None = None
    withdrawable: bool | None = None
    keeps_robot: bool | None = None


class ChangeSteps(Command, frozen=True, kw_only=True):
    """Change steps that no robot has begun; all of them, or none."""

    order: OrderId
    patches: tuple[StepPatch, ...]


def change(fleet: Fleet, command: ChangeSteps) -> Decision:
    """The rules of a step hold for what comes out, not for what was sent."""
    order = order_in_service(fleet, command.order)
    _check_some(len(command.patches))
    at_most(len(command.patches), STEPS_MAX, "steps")
    places = places_of(fleet.scenes[order.scene])
    changes: list[StepChange] = []
    seen: set[int] = set()
    for number, patch in enumerate(command.patches):
        field = f"steps[{number}]"
        if not 0 <= patch.step < len(order.steps):
            message = f"Field '{field}.stepIndex': the order has no step {patch.step}."
            raise Rejected(Reason.STEP_UNKNOWN, message, order.id, patch.step)
        if patch.step in seen:
            message = f"Field '{field}.stepIndex': step {patch.step} stands here twice."
            raise Rejected(Reason.STEP_REPEATED, message, order.id, patch.step)
        seen.add(patch.step)
        step = order.steps[patch.step]
        _check_executable(step, f"{field}.stepIndex")
        task = _patched(step.task, patch)
        check_task(places, task, field)
        if task != step.task:
            changes.append(StepChange(step=patch.step, task=task))
    if not changes:
        return Decision()
    tasks = tuple(change.task for change in changes)
    container = None if order.container else own_container(order.id, tasks)
    changed = StepsChanged(
        scene=order.scene, order=order.id, changes=tuple(changes), container=container
    )
    return Decision(events=(changed,))


def _patched(task: StepTask, patch: StepPatch) -> StepTask:
    arguments = task.arguments
    if patch.arguments is not None:
        arguments = patch.arguments if patch.arguments != "{}" else None
    return msgspec.structs.replace(
        task,
        location=task.location if patch.location is None else patch.location,
        arguments=arguments,
        loads=task.loads if patch.loads is None else patch.loads,
        unloads=task.unloads if patch.unloads is None else patch.unloads,
        withdrawable=task.withdrawable if patch.withdrawable is None else patch.withdrawable,
        keeps_robot=task.keeps_robot if patch.keeps_robot is None else patch.keeps_robot,
    )


class DeleteSteps(Command, frozen=True, kw_only=True):
    """Take out steps that no robot has begun; all of them, or none."""

    order: OrderId
    steps: tuple[StepId, ...]


def delete(fleet: Fleet, command: DeleteSteps) -> Decision:
    """A sealed order keeps at least one step; if all it keeps are done, it is finished."""
    order = order_in_service(fleet, command.order)
    at_most(len(command.steps), STEPS_MAX, "stepIds")
    gone = tuple(dict.fromkeys(command.steps))
    if not gone:
        raise Rejected(Reason.STEPS_MISSING, "Field 'stepIds' must not be empty.")
    known = {step.id: step for step in order.steps}
    for index, id_ in enumerate(gone):
        if id_ not in known:
            message = f"Field 'stepIds[{index}]': order '{order.id}' has no step '{id_}'."
            raise Rejected(Reason.STEP_UNKNOWN, message, order.id, id_)
        _check_executable(known[id_], f"stepIds[{index}]")
    return Decision(events=_deleted(order, gone))


def _deleted(order: Order, gone: tuple[StepId, ...]) -> Events:
    deleted = StepsDeleted(scene=order.scene, order=order.id, steps=gone)
    if not order.sealed:
        return (deleted,)
    kept = [step for step in order.steps if step.id not in gone]
    if not kept:
        message = f"Order '{order.id}' is sealed and would have no steps: cancel it instead."
        raise Rejected(Reason.ORDER_NO_STEPS, message, order.id)
    if order.fault_reason is None and all(step.status is StepStatus.DONE for step in kept):
        return deleted, OrderFinished(scene=order.scene, order=order.id)
    return (deleted,)


def _check_some(count: int) -> None:
    if not count:
        raise Rejected(Reason.STEPS_MISSING, "Field 'steps' must not be empty.")


def _check_executable(step: Step, field: str) -> None:
    if step.status is not StepStatus.EXECUTABLE:
        message = f"Field '{field}': step '{step.id}' is {step.status}, no longer Executable."
        raise Rejected(Reason.STEP_NOT_EXECUTABLE, message, step.id, step.status.value)
