"""The views that analytics offer, and their documentation."""

from collections.abc import Sequence
from typing import Any

from ledger.scene import Value
from projections.analytics_tables import ALLOCATIONS, ROBOT_WAITS, ROBOTS, SPANS, WAIT_CYCLES
from projections.spans import Fault, Reservation, RobotState, Wait
from projections.sql_questions import QUESTIONS
from projections.tables import EVENTS, ORDERS, STEPS, Column

NOW_MS = "(SELECT at_ms FROM checkpoint)"  # of the newest event


class Shown(Value, frozen=True, kw_only=True):
    """A column of a view."""

    name: str
    type: str
    sql: str  # over the columns of the table
    doc: str


class View(Value, frozen=True, kw_only=True):
    """A documented view: the tables behind it, and its columns."""

    name: str
    doc: str
    tables: tuple[str, ...]
    columns: tuple[Shown, ...]


def _shown(columns: Sequence[Column[Any]]) -> tuple[Shown, ...]:
    """Show columns as they are, but epoch milliseconds as timestamps."""
    made = []
    for column in columns:
        name = f'"{column.name}"'
        is_time = column.name.endswith("_on") and column.type == "BIGINT"
        type_, sql = ("TIMESTAMP", f"epoch_ms({name})") if is_time else (column.type, name)
        made.append(Shown(name=column.name, type=type_, sql=sql, doc=column.doc))
    return tuple(made)


def _lasting(columns: Sequence[Column[Any]], began: str = "began_on") -> tuple[Shown, ...]:
    until = f"coalesce(ended_on, {NOW_MS})"
    seconds = Shown(
        name="seconds",
        type="DOUBLE",
        sql=f"({until} - {began}) / 1000.0::DOUBLE",
        doc="How long; of what lasts, up to the newest event.",
    )
    return (*_shown(columns), seconds)


def _ledger(columns: Sequence[Column[Any]]) -> tuple[Shown, ...]:
    at = Shown(
        name="at_on", type="TIMESTAMP", sql="epoch_ms(at_ms)", doc="When it happened, as a time."
    )
    return (*_shown(columns), at)


_HELD = Shown(
    name="held_s",
    type="DOUBLE",
    sql=f"(coalesce(ended_on, {NOW_MS}) - granted_on) / 1000.0::DOUBLE",
    doc="How long it was held, s.",
)
VIEWS: tuple[View, ...] = (
    View(
        name="orders",
        doc="Every transport order there ever was, as it is now.",
        tables=("orders_done", "orders_live"),
        columns=_shown([c for c in ORDERS if c.name != "body"]),
    ),
    View(
        name="steps",
        doc="The steps of all orders.",
        tables=("steps_done", "steps_live"),
        columns=_shown(STEPS),
    ),
    View(
        name="events",
        doc="Everything that happened.",
        tables=("events_all",),
        columns=_ledger(EVENTS),
    ),
    View(
        name="robots",
        doc="All robots, as they are now.",
        tables=("robots_live",),
        columns=_shown(ROBOTS),
    ),
    View(
        name="allocations",
        doc="Every decision about an order: a row for each robot that was considered.",
        tables=("allocations_all",),
        columns=_shown(ALLOCATIONS),
    ),
    View(
        name="waits",
        doc="For what each order waited, from reason to reason, before and after it had a robot.",
        tables=("waits_done", "waits_live"),
        columns=_lasting(SPANS[Wait][1]),
    ),
    View(
        name="robot_waits",
        doc="Who waited for whom in traffic, summed up for every ten minutes in which somebody "
        "waited; what was short is left out where it is much.",
        tables=("robot_waits_all",),
        columns=_shown(ROBOT_WAITS),
    ),
    View(
        name="wait_cycles",
        doc="Robots that waited for each other for three seconds or more.",
        tables=("wait_cycles_all",),
        columns=_shown(WAIT_CYCLES),
    ),
    View(
        name="robot_states",
        doc="What each robot was for: its times follow each other without a gap.",
        tables=("robot_states_done", "robot_states_live"),
        columns=_lasting(SPANS[RobotState][1]),
    ),
    View(
        name="faults",
        doc="Orders, robots, doors and lifts that did not work.",
        tables=("faults_done", "faults_live"),
        columns=_lasting(SPANS[Fault][1]),
    ),
    View(
        name="reservations",
        doc="Ground that others asked for, and held.",
        tables=("reservations_done", "reservations_live"),
        columns=(*_lasting(SPANS[Reservation][1]), _HELD),
    ),
)
NAMES = frozenset(view.name for view in VIEWS)


def create_views() -> list[str]:
    """Give the statements that make the views."""
    made = []
    for view in VIEWS:
        columns = ", ".join(f'{c.sql} AS "{c.name}"' for c in view.columns)
        parts = (f"SELECT {columns} FROM {table}" for table in view.tables)
        made.append(f"CREATE VIEW {view.name} AS {' UNION ALL '.join(parts)}")
    return made


_HEAD = """# SQL

Written from `projections/sql_views.py` and `projections/sql_questions.py` by `make docs`; do not
edit.

`POST /api/sql` and `fleetledger sql DIR "SELECT …"` answer one `SELECT` (or `EXPLAIN`, `DESCRIBE`,
`SUMMARIZE`) over the views below, in [DuckDB's dialect](https://duckdb.org/docs/sql/introduction).
Nothing else can be read, and nothing can be changed; limits are in [operations](operations.md#sql).

```
curl -s localhost:5800/api/sql -H 'content-type: application/json' \\
     -d '{"sql": "SELECT kind, count(*) AS n FROM orders GROUP BY kind", "maxRows": 100}'
{"columns":[{"name":"kind","type":"VARCHAR"},{"name":"n","type":"BIGINT"}],
 "rows":[["Business",4711]],"cut":false,"position":60211}
```

`position` is the newest event that the answer knows: every event that was on disk when the
statement came.
`cut` tells that there were more rows.
Times are ISO 8601 in UTC, intervals ISO 8601 durations, binary data hexadecimal; what is no number
(NaN, infinity) is null.
Times in the views are UTC timestamps, durations are seconds.
"""


def views_page() -> str:
    """Give the documentation of the views, and what plants ask of them, as Markdown."""
    lines = [_HEAD]
    for view in VIEWS:
        lines += [f"## {view.name}", "", view.doc, ""]
        lines += ["| column | type | meaning |", "|---|---|---|"]
        lines += [f"| `{c.name}` | {c.type} | {c.doc} |" for c in view.columns]
        lines.append("")
    lines += ["## Questions of a plant", ""]
    for number, question in enumerate(QUESTIONS, 1):
        lines += [f"### {number}. {question.title}", "", question.doc, ""]
        lines += ["```sql", question.sql, "```", ""]
    return "\n".join(lines)
