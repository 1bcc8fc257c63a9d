"""The fields of a TransportOrder: the one list behind rows, queries, sorting and tables.

Durations are seconds and dates epoch milliseconds, as on the wire (spec/m4.md §8). Readings where
the source is silent: durations of the whole order are null until it is done; `executingTime` of an
order that ended without ever having had a robot is 0.0; lists that nobody asked for are null.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from typing import Any, TypeAlias

from ledger.ids import SceneId
from ledger.scene import Value
from ledger.state import Order

Row: TypeAlias = dict[str, Any]  # a business object by wire names: M4 calls it EntityValue
Read: TypeAlias = Callable[[Order, str], Any]  # order, name of its scene


class FieldType(StrEnum):
    """What a field holds; decides which operators it takes and how values are read."""

    TEXT = "text"
    INTEGER = "integer"
    NUMBER = "number"
    BOOLEAN = "boolean"
    DATE = "date"  # epoch milliseconds
    TEXTS = "list of text"


class Field(Value, frozen=True, kw_only=True):
    """One field: its wire name, its column in SQL, and how it is read from an order."""

    name: str
    column: str
    type: FieldType
    read: Read
    doc: str
    shown: bool = True  # False: only in answers that ask for it


def _seconds(ms: int | None) -> float | None:
    return None if ms is None else ms / 1000


def _processing_s(order: Order, _: str) -> float | None:
    return None if order.done_ms is None else (order.done_ms - order.created_ms) / 1000


def _executing_s(order: Order, _: str) -> float | None:
    if order.done_ms is None:
        return None
    return 0.0 if order.assigned_ms is None else (order.done_ms - order.assigned_ms) / 1000


def _key_locations(order: Order, _: str) -> list[str]:
    """Give what the client named, or else where the steps lead (spec/m4.md §2, orders-create)."""
    return list(order.key_locations) or [step.task.location for step in order.steps]


def _load_point(order: Order, _: str) -> str | None:
    return next((s.task.location for s in order.steps if s.task.loads), None)


def _unload_point(order: Order, _: str) -> str | None:
    return next((s.task.location for s in order.steps if s.task.unloads), None)


def _no_load(order: Order, _: str) -> bool:
    return not any(s.task.loads or s.task.unloads for s in order.steps)


def _field(name: str, type_: FieldType, read: Read, doc: str, *, shown: bool = True) -> Field:
    column = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
    return Field(name=name, column=column, type=type_, read=read, doc=doc, shown=shown)


_T = FieldType
FIELDS: tuple[Field, ...] = (
    _field("id", _T.TEXT, lambda o, s: o.id, "Order id."),
    _field("sceneId", _T.TEXT, lambda o, s: o.scene, "Id of its scene."),
    _field("sceneName", _T.TEXT, lambda o, s: s, "Name of its scene."),
    _field("status", _T.TEXT, lambda o, s: o.status.value, "OrderStatus of spec/m4.md."),
    _field("kind", _T.TEXT, lambda o, s: o.kind.value, "OrderKind of spec/m4.md."),
    _field("externalId", _T.TEXT, lambda o, s: o.external_id, "The client's own number."),
    _field("priority", _T.INTEGER, lambda o, s: o.priority, "Larger goes first."),
    _field("containerId", _T.TEXT, lambda o, s: o.container, "Container to carry."),
    _field("containerTypeName", _T.TEXT, lambda o, s: o.container_type, "Its type."),
    _field("containerDir", _T.NUMBER, lambda o, s: o.container_heading_rad, "Set down so, rad."),
    _field("taskBatch", _T.TEXT, lambda o, s: None, "Tasks of one trip; not used yet."),
    _field("expectedRobotNames", _T.TEXTS, lambda o, s: list(o.wanted_robots) or None, "Wanted."),
    _field("expectedRobotGroups", _T.TEXTS, lambda o, s: list(o.wanted_groups) or None, "Wanted."),
    _field("keyLocations", _T.TEXTS, _key_locations, "Locations by which it is assigned."),
    _field("loadPoint", _T.TEXT, _load_point, "Where it is picked up."),
    _field("unloadPoint", _T.TEXT, _unload_point, "Where it is put down."),
    _field("stepFixed", _T.BOOLEAN, lambda o, s: o.sealed, "Sealed: no step can be added."),
    _field("stepNum", _T.INTEGER, lambda o, s: len(o.steps), "Number of steps."),
    _field("currentStepIndex", _T.INTEGER, lambda o, s: o.current_step, "-1 before the first."),
    _field("doneStepIndex", _T.INTEGER, lambda o, s: o.done_step, "-1 before the first."),
    _field("actualRobotName", _T.TEXT, lambda o, s: o.robot, "Robot that has it."),
    _field("oldRobots", _T.TEXTS, lambda o, s: list(o.former_robots) or None, "It was taken from."),
    _field("robotAllocatedOn", _T.DATE, lambda o, s: o.assigned_ms, "When it got its robot."),
    _field("dispatchCost", _T.NUMBER, lambda o, s: o.cost_s, "Cost of the assignment, s."),
    _field("loaded", _T.BOOLEAN, lambda o, s: o.loaded, "Pick-up finished."),
    _field("unloaded", _T.BOOLEAN, lambda o, s: o.unloaded, "Put-down finished."),
    _field("fault", _T.BOOLEAN, lambda o, s: o.fault_reason is not None, "Faulted now."),
    _field("faultReason", _T.TEXT, lambda o, s: o.fault_reason, "Why it is faulted."),
    _field("failureNum", _T.INTEGER, lambda o, s: o.fault_count, "Number of faults."),
    _field("faultDuration", _T.NUMBER, lambda o, s: _seconds(o.fault_ms), "In fault, s."),
    _field("loadDuration", _T.NUMBER, lambda o, s: _seconds(o.load_ms), "Pick-up, s."),
    _field("unloadDuration", _T.NUMBER, lambda o, s: _seconds(o.unload_ms), "Put-down, s."),
    _field("waitExecuteDuration", _T.NUMBER, lambda o, s: _seconds(o.waited_ms), "Waited, s."),
    _field("processingTime", _T.NUMBER, _processing_s, "From creation to the end, s."),
    _field("executingTime", _T.NUMBER, _executing_s, "From assignment to the end, s."),
    _field("createdOn", _T.DATE, lambda o, s: o.created_ms, "When it was created."),
    _field("createdBy", _T.TEXT, lambda o, s: o.created_by or None, "Who created it."),
    _field("modifiedOn", _T.DATE, lambda o, s: o.modified_ms, "When it last changed."),
    _field("modifiedBy", _T.TEXT, lambda o, s: o.modified_by or None, "Who changed it last."),
    _field("doneOn", _T.DATE, lambda o, s: o.done_ms, "When it was done or cancelled."),
    _field("version", _T.INTEGER, lambda o, s: o.version, "Counts its changes."),
    # in no example of the source, which allows it to be absent (spec/m4.md §9, C18)
    _field("noLoad", _T.BOOLEAN, _no_load, "No step loads or unloads.", shown=False),
)
BY_NAME: dict[str, Field] = {field.name: field for field in FIELDS}
SHOWN: tuple[Field, ...] = tuple(field for field in FIELDS if field.shown)
ID = BY_NAME["id"]
CREATED = BY_NAME["createdOn"]


def row(order: Order, scene_name: str, fields: Iterable[Field] = SHOWN) -> Row:
    """Give the business object of an order, or the part of it that these fields are."""
    return {field.name: field.read(order, scene_name) for field in fields}


def scene_name(names: Mapping[SceneId, str], order: Order) -> str:
    """Name of the order's scene; scenes are never deleted, so there is one."""
    return names[order.scene]
