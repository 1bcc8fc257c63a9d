"""Pages of 100 k orders, and how fast DuckDB follows and is built anew: `python -m bench.read`.

The questions go through `Find` as they do behind HTTP: the event loop, a thread, memory and DuckDB.
"""

import asyncio
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ledger.events import (
    AnyEvent,
    OrderAssigned,
    OrderCreated,
    OrderFinished,
    RobotAdded,
    SceneImported,
    StepFinished,
    StepStarted,
    stamped,
)
from ledger.evolve import fold
from ledger.ids import CommandId, OrderId, RobotName, SceneId
from ledger.scene import Group, RobotConfig
from ledger.state import Fleet, StepTask
from projections.find import Asked, Find
from projections.history import History
from projections.live import Live
from projections.query import Asker, parse
from projections.reading import Reader
from projections.sorting import parse_sort

ORDERS = 100_000
LIVE = 500  # of them are not finished
ROBOTS = 50
CALLS = 300
SCENE = SceneId("0" * 24)
START_MS = 1_700_000_000_000

Row = dict[str, float | str]


def _blanks(orders: int, live: int) -> Iterator[AnyEvent]:
    group = Group(id=0, name="g")
    yield SceneImported(scene=SCENE, name="bench", digest="", areas=(), groups=(group,))
    names = [RobotName(f"AMB-{n}") for n in range(ROBOTS)]
    for name in names:
        yield RobotAdded(scene=SCENE, config=RobotConfig(name=name))
    tasks = (
        StepTask(location="B-01-17", arguments='{"binTask":"Load"}', loads=True),
        StepTask(location="B-09-03", arguments='{"binTask":"Unload"}', unloads=True),
    )
    for number in range(orders):
        order, robot = OrderId(f"TO20231114-{number + 1:06d}"), names[number % ROBOTS]
        yield OrderCreated(
            scene=SCENE,
            order=order,
            sealed=True,
            tasks=tasks,
            priority=number % 10,
            external_id=f"wms-{number}",
        )
        if number >= orders - live:
            continue
        yield OrderAssigned(scene=SCENE, order=order, robot=robot, bin=0, cost_s=1.5)
        for step in range(2):
            yield StepStarted(scene=SCENE, order=order, step=step, robot=robot)
            yield StepFinished(scene=SCENE, order=order, step=step, robot=robot)
        yield OrderFinished(scene=SCENE, order=order)


def events(orders: int, live: int) -> list[AnyEvent]:
    """Give the life of so many orders, one after the other."""
    return [
        stamped(blank, n, START_MS + n * 100, "wms", CommandId(f"c{n}"))
        for n, blank in enumerate(_blanks(orders, live), 1)
    ]


QUESTIONS: dict[str, tuple[Any, list[str], str | None, int]] = {
    "find/page, 50 newest": (None, ["-createdOn"], None, 0),
    "find/page, 50 newest, page 500": (None, ["-createdOn"], None, 499 * 50),
    "find/page, done by one robot": (
        {
            "type": "Compound",
            "items": [
                {"type": "General", "field1": "status", "operator": "Eq", "value": "Done"},
                {
                    "type": "General",
                    "field1": "actualRobotName",
                    "operator": "Eq",
                    "value": "AMB-7",
                },
            ],
        },
        ["-createdOn"],
        None,
        0,
    ),
    "find/page, fuzzy id": (None, ["-createdOn"], "4242", 0),
    "find/page, by external id": (
        {"type": "General", "field1": "externalId", "operator": "Eq", "value": "wms-4711"},
        [],
        None,
        0,
    ),
}


async def _ask(find: Find, what: str) -> Row:
    query, sort, fuzzy, skip = QUESTIONS[what]
    condition = parse(query, Asker(user="", now_ms=START_MS))
    asked = Asked(condition=condition, sort=parse_sort(sort), fuzzy=fuzzy)
    took_s = []
    for _ in range(CALLS):
        began = time.perf_counter()
        page = await find.page(asked, skip, 50)
        took_s.append(time.perf_counter() - began)
    took_s.sort()
    return {
        "what": what,
        "rows": float(len(page.rows)),
        "total": float(page.total),
        "p50_ms": took_s[CALLS // 2] * 1e3,
        "p99_ms": took_s[CALLS * 99 // 100] * 1e3,
    }


def main() -> list[Row]:
    """Build the history, ask, and let it follow once more event by event."""
    known = events(ORDERS, LIVE)
    rows: list[Row] = []

    def told(row: Row) -> None:
        rows.append(row)
        print(
            ", ".join(f"{k} {v:,.2f}" if isinstance(v, float) else v for k, v in row.items()),
            flush=True,
        )

    with tempfile.TemporaryDirectory() as folder:
        live = Live(fold(Fleet(), known))
        history = History(Path(folder) / "history.duckdb", live)
        began = time.perf_counter()
        history.start(lambda after: iter(known[after:]), lambda position: live.fleet)
        took_s = time.perf_counter() - began
        told({"what": "history built anew", "took_s": took_s, "events_per_s": len(known) / took_s})
        reader = Reader(history.cursor)
        find = Find(live, reader, lambda at_ms: live.fleet, lambda: START_MS)
        for what in QUESTIONS:
            told(asyncio.run(_ask(find, what)))
        reader.close()
        history.close()
        told(_following(Path(folder) / "followed.duckdb", known[: len(known) // 5]))
    return rows


def _following(path: Path, known: list[AnyEvent]) -> Row:
    """Hand the events over in commits of 64, as fast as they are taken."""
    live = Live(Fleet())
    history = History(path, live)
    log: list[AnyEvent] = []
    history.start(lambda after: iter(log[after:]), lambda position: Fleet())
    began = time.perf_counter()
    for first in range(0, len(known), 64):
        batch = known[first : first + 64]
        log += batch
        live.apply(batch)
        history.follow(batch)
    with history.moved:
        history.moved.wait_for(lambda: history.position == len(known), timeout=60)
    took_s = time.perf_counter() - began
    history.close()
    return {"what": "history follows", "took_s": took_s, "events_per_s": len(known) / took_s}


if __name__ == "__main__":
    main()
