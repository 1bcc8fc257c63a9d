"""A past moment as text: what `fleetledger replay DIR --at T` prints."""

from collections.abc import Mapping

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ledger.ids import RobotName, SceneId
from ledger.link import Report
from ledger.moment import time_text
from ledger.scene import Scene
from ledger.state import Fleet, Order
from replay.frame import RobotState, order_frame, robot_frame

ORDERS_MAX = 200  # in one table; the rest are counted

COLOURS = {
    RobotState.IDLE: "dim",
    RobotState.MOVING: "blue",
    RobotState.WAITING: "yellow",
    RobotState.WORKING: "magenta",
    RobotState.CHARGING: "green",
    RobotState.BLOCKED: "red",
    RobotState.OFFLINE: "dim",
}


def describe(fleet: Fleet, reports: Mapping[SceneId, Mapping[RobotName, Report]]) -> RenderableType:
    """Put robots and orders of the scenes named in `reports` into tables that rich prints."""
    when = time_text(fleet.at_ms) if fleet.position else "before the first event"
    shown: list[RenderableType] = [Text(f"Position {fleet.position}, newest event {when}")]
    for scene_id, known in reports.items():
        scene = fleet.scenes.get(scene_id)
        if scene is not None:
            orders = [o for o in fleet.orders.values() if o.scene == scene_id]
            shown += [Text(), Text(f"{scene.name} ({scene.id})", "bold")]
            shown += [_robots(fleet, scene, known), _orders(orders)]
    return Group(*shown)


def _robots(fleet: Fleet, scene: Scene, reports: Mapping[RobotName, Report]) -> RenderableType:
    table = Table(box=box.SIMPLE_HEAD, title_justify="left")
    for name in ("Robot", "State", "Place", "Heading", "Battery", "Orders", "Remark"):
        table.add_column(name, justify="right" if name in ("Heading", "Battery") else "left")
    for robot in fleet.robots.values():
        if robot.scene != scene.id:
            continue
        frame = robot_frame(robot, reports.get(robot.name), None)
        known = frame.x is not None and frame.y is not None
        place = f"{frame.x:.2f}, {frame.y:.2f} m" if known else "unknown"
        table.add_row(
            Text(frame.name, "bold"),
            Text(frame.state.value, COLOURS[frame.state]),
            Text(place + (f" ({frame.point})" if frame.point else "")),
            Text(f"{frame.heading:.2f} rad" if frame.heading is not None else ""),
            Text(f"{frame.battery:.0%}" if frame.battery is not None else ""),
            Text(", ".join(frame.orders)),
            Text(frame.words),
        )
    return table if table.row_count else Text("No robots.")


def _orders(orders: list[Order]) -> RenderableType:
    table = Table(box=box.SIMPLE_HEAD)
    for name in ("Order", "State", "Robot", "Route", "Done", "Created", "Reason"):
        table.add_column(name)
    for order in orders[-ORDERS_MAX:]:
        line = order_frame(order)
        table.add_row(
            Text(line.id, "bold"),
            Text(line.status_words, "red" if line.faulted else ""),
            Text(line.robot or ""),
            Text(" → ".join(line.route)),
            Text(f"{line.steps_done}/{len(line.route)}"),
            Text(time_text(line.created_ms)),
            Text(line.reason),
        )
    more = len(orders) - table.row_count
    if not orders:
        return Text("No open orders.")
    return Group(table, Text(f"and {more} older ones")) if more else table
