"""The views that `fleetledger sql` offers, and their documentation."""

from collections.abc import Callable
from typing import Any

from ledger.scene import Value
from ledger.state import Robot
from projections.tables import EVENTS, ORDERS, STEPS, Column


class PlacedRobot(Value, frozen=True, kw_only=True):
    """A robot with the names of what it belongs to."""

    robot: Robot
    scene_name: str
    group: str


def _col(
    name: str, type_: str, read: Callable[[PlacedRobot], Any], doc: str
) -> Column[PlacedRobot]:
    return Column(name=name, type=type_, read=read, doc=doc)


ROBOTS: tuple[Column[PlacedRobot], ...] = (
    _col("scene_id", "VARCHAR", lambda r: r.robot.scene, "Id of its scene."),
    _col("scene_name", "VARCHAR", lambda r: r.scene_name, "Name of its scene."),
    _col("name", "VARCHAR", lambda r: r.robot.name, "Unique in its scene."),
    _col("group_name", "VARCHAR", lambda r: r.group, "Robots of one build."),
    _col("online", "BOOLEAN", lambda r: r.robot.online, "Answers."),
    _col("off_duty", "BOOLEAN", lambda r: r.robot.off_duty, "Takes no orders."),
    _col("disabled", "BOOLEAN", lambda r: r.robot.config.disabled, "Out of dispatch."),
    _col("simulated", "BOOLEAN", lambda r: r.robot.config.simulated, "Not made of steel."),
    _col("bin_count", "BIGINT", lambda r: len(r.robot.bins), "Loads it carries at once."),
    _col("orders", "VARCHAR[]", lambda r: list(r.robot.orders), "Orders it has now."),
    _col("idle_since_on", "BIGINT", lambda r: r.robot.idle_since_ms, "Since when it has had none."),
)


class View(Value, frozen=True, kw_only=True):
    """A documented view: the tables behind it, and its columns."""

    name: str
    doc: str
    tables: tuple[str, ...]
    columns: tuple[Column[Any], ...]


VIEWS: tuple[View, ...] = (
    View(
        name="orders",
        doc="Every transport order there ever was, as it is now.",
        tables=("orders_done", "orders_live"),
        columns=tuple(c for c in ORDERS if c.name != "body"),
    ),
    View(
        name="steps",
        doc="The steps of all orders.",
        tables=("steps_done", "steps_live"),
        columns=STEPS,
    ),
    View(name="events", doc="Everything that happened.", tables=("events_all",), columns=EVENTS),
    View(
        name="robots", doc="All robots, as they are now.", tables=("robots_live",), columns=ROBOTS
    ),
)


def views_page() -> str:
    """Give the documentation of the views, as Markdown."""
    lines = ["# Views of `fleetledger sql`", ""]
    lines += ["Times are UTC timestamps, durations are seconds.", ""]
    for view in VIEWS:
        lines += [
            f"## {view.name}",
            "",
            view.doc,
            "",
            "| column | type | meaning |",
            "|---|---|---|",
        ]
        for column in view.columns:
            type_ = "TIMESTAMP" if is_time(column) else column.type
            lines.append(f"| `{column.name}` | {type_} | {column.doc} |")
        lines.append("")
    return "\n".join(lines)


def is_time(column: Column[Any]) -> bool:
    """Whether a column holds epoch milliseconds that the view shows as a timestamp."""
    return column.name.endswith("_on") and column.type == "BIGINT"


def shown(column: Column[Any]) -> str:
    """Give the SQL of a view's column: milliseconds become timestamps."""
    name = f'"{column.name}"'
    return f"epoch_ms({name}) AS {name}" if is_time(column) else name
