"""A DuckDB file of millions of ended orders, made in SQL: what years of a plant would leave.

Ended orders and one event for each, its end: a ledger so long would take hours to make.
Orders come at an even pace over the days, take one to fifteen minutes, and end out of order.
"""

from pathlib import Path
from typing import Any

import duckdb
import msgspec

from ledger.events import AnyEvent, OrderFinished, stamped
from ledger.ids import CommandId, OrderId, RobotName, SceneId, StepId
from ledger.state import Order, OrderKind, OrderStatus, Step, StepStatus, StepTask
from projections.archive import Archive, digest_of
from projections.fields import FIELDS
from projections.order_keys import BASE, PLACES
from projections.tables import KEYS, ORDER_EVENTS, ORDERS, Placed

ROBOTS = 200
ORDERS_A_DAY = 100_000
DAY_MS = 86_400_000
START_MS = 1_700_006_400_000  # 2023-11-15, midnight
SCENE = SceneId("0" * 24)
SCENE_NAME = "bench"
PART_ORDERS = 500_000  # in one statement
BINS = 400

# as projections/order_keys.py has it, for numbers of six digits
_KEY = f"({START_MS // DAY_MS + 719_163} + i // {ORDERS_A_DAY}) * {BASE**PLACES}" + "".join(
    f" + (id_number // {10 ** (5 - n)} % 10 + 1) * {BASE ** (PLACES - 1 - n)}" for n in range(6)
)
# made of the running number i, and hashed so that neighbours differ
_MADE = f"""
SELECT i, {START_MS} + i * {DAY_MS // ORDERS_A_DAY} AS created_ms,
       created_ms + 60000 + hash(i) % 840000 AS done_ms,
       created_ms + 1000 + hash(i) % 30000 AS assigned_ms,
       'TO' || strftime(epoch_ms(created_ms), '%Y%m%d') || '-'
           || lpad((i % {ORDERS_A_DAY} + 1)::VARCHAR, 6, '0') AS id,
       'AMB-' || hash(i + 1) % {ROBOTS} AS robot,
       strftime(epoch_ms(created_ms), '%Y%m%d')::BIGINT AS id_day,
       i % {ORDERS_A_DAY} + 1 AS id_number,
       ({_KEY})::BIGINT AS id_key,
       CASE WHEN hash(i + 2) % 100 < 97 THEN 'Done' ELSE 'Cancelled' END AS status,
       CASE WHEN hash(i + 3) % 100 < 85 THEN 'Business' WHEN hash(i + 3) % 100 < 93 THEN 'Parking'
            WHEN hash(i + 3) % 100 < 97 THEN 'Charging' ELSE 'IdleAvoid' END AS kind,
       (hash(i + 4) % 10)::BIGINT AS priority,
       'wms-' || i AS external_id,
       'B-' || hash(i + 5) % {BINS} AS load_point,
       'B-' || hash(i + 6) % {BINS} AS unload_point
FROM range(?, ?) numbers(i)
"""
_FIELDS = {
    "id": "id", "status": "status", "kind": "kind", "external_id": "external_id",
    "priority": "priority", "key_locations": "[load_point, unload_point]",
    "load_point": "load_point", "unload_point": "unload_point", "actual_robot_name": "robot",
    "robot_allocated_on": "assigned_ms", "processing_time": "(done_ms - created_ms) / 1000",
    "executing_time": "(done_ms - assigned_ms) / 1000", "created_on": "created_ms",
    "modified_on": "done_ms", "done_on": "done_ms", "done_position": "done_position",
    "id_key": "id_key", "id_day": "id_day", "id_number": "id_number",
}  # fmt: skip


def _pattern() -> Order:
    """Give an ended order with marks where orders differ."""
    steps = tuple(
        Step(
            id=StepId(f"@id@-Step{n}"),
            task=StepTask(location=place, arguments=f'{{"binTask":"{task}"}}', **what),
            status=StepStatus.DONE, version=2, created_ms=-1, modified_ms=-3, started_ms=-2,
            ended_ms=-3,
        )
        for n, (place, task, what) in enumerate(
            (
                ("@load_point@", "Load", {"loads": True}),
                ("@unload_point@", "Unload", {"unloads": True}),
            )
        )
    )  # fmt: skip
    return Order(
        id=OrderId("@id@"), scene=SCENE, kind=OrderKind.BUSINESS, status=OrderStatus.DONE,
        version=7, created_ms=-1, created_by="wms", modified_ms=-3, modified_by="dispatch",
        external_id="@external_id@", priority=-4, sealed=True, steps=steps, steps_made=2,
        current_step=1, done_step=1, robot=RobotName("@robot@"), bin=0, assigned_ms=-2, cost_s=41.5,
        waited_ms=0, loaded=True, unloaded=True, load_ms=20_000, unload_ms=20_000, done_ms=-3,
    )  # fmt: skip


_MARKS = {
    "@id@": "id", "@load_point@": "load_point", "@unload_point@": "unload_point",
    "@external_id@": "external_id", "@robot@": "robot",
    '"Business"': "'\"' || kind || '\"'", '"status":"Done","version":7': (
        "'\"status\":\"' || status || '\",\"version\":7'"
    ),
    ":-1,": "':' || created_ms || ','", ":-2,": "':' || assigned_ms || ','",
    ":-3,": "':' || done_ms || ','", ":-3}": "':' || done_ms || '}'",
    ":-4,": "':' || priority || ','",
}  # fmt: skip


def _text_of(pattern: bytes) -> str:
    """Give the SQL that fills a JSON text with what differs."""
    parts: list[str] = [pattern.decode()]
    made: dict[str, str] = {}
    for number, (mark, sql) in enumerate(_MARKS.items()):
        key = chr(0xE000 + number)  # private use: in no text of ours
        made[key] = sql
        parts = [part.replace(mark, f"\0{key}\0") for part in parts]
    pieces = parts[0].split("\0")
    return "concat(" + ", ".join(made.get(p) or _literal(p) for p in pieces if p) + ")"


def _literal(value: object) -> str:
    match value:
        case None:
            return "NULL"
        case str():
            return "'" + value.replace("'", "''") + "'"
        case list():
            return "[" + ", ".join(map(_literal, value)) + "]"
        case _:
            return str(value)


def build(path: Path, orders: int) -> None:
    """Write the file, in some ten seconds a million."""
    Archive.open(path).close()
    pattern = _pattern()
    placed = Placed(order=pattern, scene_name=SCENE_NAME, position=0)
    given: dict[str, Any] = {c.name: c.read(placed) for c in ORDERS if c.name not in _FIELDS}
    given.pop("body")
    columns = {f.column for f in FIELDS}
    assert columns <= {*given, *_FIELDS}
    exprs = {
        "body": _text_of(msgspec.json.encode(pattern)),
        **{name: _literal(value) for name, value in given.items()},
        **_FIELDS,
    }
    chosen = ", ".join(f'{exprs[c.name]} AS "{c.name}"' for c in (*ORDERS, *KEYS))
    event = {"position": "done_position", "order_id": "id", "id_key": "id_key", "body": "'{}'"}
    told = ", ".join(event[c.name] for c in ORDER_EVENTS)
    ended = (
        f"FROM (SELECT *, ? + row_number() OVER (ORDER BY done_ms, i) AS done_position "
        f"FROM ({_MADE})) ORDER BY done_position"
    )
    with duckdb.connect(str(path)) as connection:
        for start in range(0, orders, PART_ORDERS):
            numbers = [start, start, min(orders, start + PART_ORDERS)]
            connection.execute(f"INSERT INTO orders_done SELECT {chosen} {ended}", numbers)
            connection.execute(f"INSERT INTO order_events SELECT {told} {ended}", numbers)
        digest = digest_of(last_event(orders))
        connection.execute(
            "UPDATE checkpoint SET position = ?, orders = ?, events = ?, digest = ?",
            [orders, orders, orders, digest],
        )


def last_event(orders: int) -> AnyEvent:
    """Give an event at the position of the checkpoint, for who asks what the ledger has there."""
    event = OrderFinished(scene=SCENE, order=OrderId("TO20231115-000001"))
    return stamped(event, orders, START_MS, "dispatch", CommandId("c"))
