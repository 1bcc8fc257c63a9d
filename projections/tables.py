"""Tables of the history in DuckDB, and the rows that orders and events become in them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, TypeVar

import msgspec
import pyarrow as pa

from ledger.events import AnyEvent, RobotAdded
from ledger.events.orders import OfOrder
from ledger.scene import Value
from ledger.state import Order, Step
from projections.fields import FIELDS, FieldType
from projections.order_keys import key_of

SCHEMA_VERSION = 2  # of the tables; a file of another version is built anew

SQL_TYPES: dict[FieldType, str] = {
    FieldType.TEXT: "VARCHAR",
    FieldType.INTEGER: "BIGINT",
    FieldType.NUMBER: "DOUBLE",
    FieldType.BOOLEAN: "BOOLEAN",
    FieldType.DATE: "BIGINT",
    FieldType.TEXTS: "VARCHAR[]",
}
_ARROW_TYPES = {
    "VARCHAR": pa.string(),
    "BIGINT": pa.int64(),
    "DOUBLE": pa.float64(),
    "BOOLEAN": pa.bool_(),
    "VARCHAR[]": pa.list_(pa.string()),
}
_encode = msgspec.json.Encoder().encode  # bytes in UTF-8, which Arrow takes for text
R = TypeVar("R")  # what a row is made from


class Column(Value, Generic[R], frozen=True, kw_only=True):
    """A column: how it is filled and what it means."""

    name: str
    type: str
    read: Callable[[R], Any]
    doc: str


class Placed(Value, frozen=True, kw_only=True):
    """An order with what its row needs beside it."""

    order: Order
    scene_name: str
    position: int  # of its last event


class PlacedStep(Value, frozen=True, kw_only=True):
    """A step with its order."""

    index: int
    step: Step
    of: Placed


def _robot(event: AnyEvent) -> str | None:
    return event.config.name if isinstance(event, RobotAdded) else getattr(event, "robot", None)


def _part(id_: str, name: str) -> int | None:
    key = key_of(id_)
    return None if key is None else getattr(key, name)


def _bind(read: Callable[[Order, str], Any]) -> Callable[[Placed], Any]:
    return lambda placed: read(placed.order, placed.scene_name)


def _col(name: str, type_: str, read: Callable[[R], Any], doc: str) -> Column[R]:
    return Column(name=name, type=type_, read=read, doc=doc)


ORDERS: tuple[Column[Placed], ...] = (
    *(_col(f.column, SQL_TYPES[f.type], _bind(f.read), f.doc) for f in FIELDS),
    _col("done_position", "BIGINT", lambda p: p.position, "Ledger position of its last event."),
    _col("body", "VARCHAR", lambda p: msgspec.json.encode(p.order).decode(), "Whole, as JSON."),
)
STEPS: tuple[Column[PlacedStep], ...] = (
    _col("order_id", "VARCHAR", lambda s: s.of.order.id, "Id of its order."),
    _col("step_index", "BIGINT", lambda s: s.index, "Place in its order, from 0."),
    _col("id", "VARCHAR", lambda s: s.step.id, "Id of the step."),
    _col("scene_id", "VARCHAR", lambda s: s.of.order.scene, "Id of the scene."),
    _col("robot", "VARCHAR", lambda s: s.of.order.robot, "Robot that has the order."),
    _col("location", "VARCHAR", lambda s: s.step.task.location, "Point or bin."),
    _col("rbk_args", "VARCHAR", lambda s: s.step.task.arguments, "Arguments, JSON text."),
    _col("for_load", "BOOLEAN", lambda s: s.step.task.loads, "Picks up."),
    _col("for_unload", "BOOLEAN", lambda s: s.step.task.unloads, "Puts down."),
    _col("status", "VARCHAR", lambda s: s.step.status.value, "StepStatus of spec/m4.md."),
    _col("created_on", "BIGINT", lambda s: s.step.created_ms, "When it was made."),
    _col("started_on", "BIGINT", lambda s: s.step.started_ms, "When the robot set out."),
    _col("ended_on", "BIGINT", lambda s: s.step.ended_ms, "When it was done."),
    _col("version", "BIGINT", lambda s: s.step.version, "Counts its changes."),
)
# what the history looks orders up by; null where an id is not of our pattern
KEYS: tuple[Column[Placed], ...] = (
    _col("id_key", "BIGINT", lambda p: _part(p.order.id, "key"), "The id, as an integer."),
    _col("id_day", "BIGINT", lambda p: _part(p.order.id, "day"), "Its day, yyyymmdd."),
    _col("id_number", "BIGINT", lambda p: _part(p.order.id, "number"), "Its number in the day."),
)
ORDER_EVENTS: tuple[Column[OfOrder], ...] = (
    _col("position", "BIGINT", lambda e: e.position, "Position in the ledger."),
    _col("order_id", "VARCHAR", lambda e: e.order, "Id of its order."),
    _col("id_key", "BIGINT", lambda e: _part(e.order, "key"), "The id, as an integer."),
    _col("body", "VARCHAR", lambda e: msgspec.json.encode(e).decode(), "The event as JSON."),
)
EVENTS: tuple[Column[AnyEvent], ...] = (
    _col("position", "BIGINT", lambda e: e.position, "Position in the ledger, from 1."),
    _col("at_ms", "BIGINT", lambda e: e.at_ms, "When it happened."),
    _col("type", "VARCHAR", lambda e: type(e).__name__, "Its type; docs/events.md has them all."),
    _col("scene", "VARCHAR", lambda e: e.scene, "Id of the scene."),
    _col("order_id", "VARCHAR", lambda e: e.order if isinstance(e, OfOrder) else None, "Order."),
    _col("robot", "VARCHAR", _robot, "Robot, if the event is of or names one."),
    _col("by", "VARCHAR", lambda e: e.by, "Who asked."),
    _col("command", "VARCHAR", lambda e: e.command, "Id of the command that caused it."),
    _col("body", "VARCHAR", lambda e: msgspec.json.encode(e).decode(), "The event as JSON."),
)


def ddl(table: str, columns: Sequence[Column[Any]]) -> str:
    """Give the statement that creates a table. No keys and no indices: rows are only appended."""
    inner = ", ".join(f'"{c.name}" {c.type}' for c in columns)
    return f"CREATE TABLE {table} ({inner})"


def arrow(columns: Sequence[Column[R]], rows: Sequence[R]) -> pa.Table:
    """Make rows into the one form that DuckDB takes in fast (1000 times `executemany`)."""
    return pa.table(
        {c.name: pa.array(list(map(c.read, rows)), _ARROW_TYPES[c.type]) for c in columns}
    )


def order_rows(ended: Sequence[Placed]) -> pa.Table:
    """Make rows of `(*ORDERS, *KEYS)`, as `arrow` does, at half its cost."""
    orders = [placed.order for placed in ended]
    names = [placed.scene_name for placed in ended]
    fields = {f.column: list(map(f.read, orders, names)) for f in FIELDS}
    parts = [key_of(order.id) for order in orders]
    values: dict[str, list[Any]] = {
        **fields,
        "done_position": [placed.position for placed in ended],
        "body": [_encode(order) for order in orders],
        "id_key": [None if part is None else part.key for part in parts],
        "id_day": [None if part is None else part.day for part in parts],
        "id_number": [None if part is None else part.number for part in parts],
    }
    return _table((*ORDERS, *KEYS), values)


def event_rows(events: Sequence[OfOrder]) -> pa.Table:
    """Make rows of `ORDER_EVENTS`, likewise."""
    parts = [key_of(event.order) for event in events]
    values: dict[str, list[Any]] = {
        "position": [event.position for event in events],
        "order_id": [event.order for event in events],
        "id_key": [None if part is None else part.key for part in parts],
        "body": [_encode(event) for event in events],
    }
    return _table(ORDER_EVENTS, values)


def _table(columns: Sequence[Column[Any]], values: Mapping[str, list[Any]]) -> pa.Table:
    return pa.table({c.name: pa.array(values[c.name], _ARROW_TYPES[c.type]) for c in columns})


def steps_of(placed: Placed) -> list[PlacedStep]:
    """Give the steps of an order, to be rows."""
    return [PlacedStep(index=n, step=step, of=placed) for n, step in enumerate(placed.order.steps)]
