"""Questions to millions of ended orders, and the memory it takes: `python -m bench.scale`.

`--orders 10000000` for the figures of the documentation; `--keep FILE` makes the file once and uses
it again. The questions go through `Find` with 1,000 live orders beside, as they do behind HTTP,
but without a ledger: one of that length would take hours to make. So the memory is that of the read
side, not of the whole core.
"""

import argparse
import asyncio
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import msgspec

from bench.scale_history import (
    DAY_MS,
    ORDERS_A_DAY,
    ROBOTS,
    SCENE,
    SCENE_NAME,
    START_MS,
    build,
    last_event,
)
from ledger.events import AnyEvent, OrderAssigned, OrderCreated, OrderFinished, stamped
from ledger.ids import CommandId, OrderId, RobotKey, RobotName, robot_key
from ledger.scene import Group, RobotConfig, Scene
from ledger.state import Fleet, Order, Robot, RobotBin
from projections.find import Asked, Find
from projections.history import History
from projections.live import Live
from projections.query import Asker, parse
from projections.reading import Reader
from projections.sorting import parse_sort

ORDERS = 1_000_000
LIVE = 1_000
CALLS = 100
FOLLOWED_S = 5.0
CHANGES_A_S = 5_000

Row = dict[str, float | str]


def _general(field: str, operator: str, value: object) -> dict[str, object]:
    return {"type": "General", "field1": field, "operator": operator, "value": value}


def _both(*items: dict[str, object]) -> dict[str, object]:
    return {"type": "Compound", "items": list(items)}


def _questions(orders: int) -> dict[str, tuple[Any, list[str], str | None, int, int | None]]:
    """Give query, sorting, part of the id, rows to skip, and moment."""
    middle_ms = START_MS + orders // 2 * DAY_MS // ORDERS_A_DAY
    done = _general("status", "Eq", "Done")
    newest = ["-createdOn"]
    an_hour = _general("createdOn", "Between", [middle_ms, middle_ms + 3_600_000])
    robot = _both(done, _general("actualRobotName", "Eq", "AMB-7"))
    external = _general("externalId", "Eq", f"wms-{orders // 2}")
    return {
        "newest": (None, newest, None, 0, None),
        "newest, page 100": (None, newest, None, 99 * 50, None),
        "newest, a page in the middle": (None, newest, None, orders // 2, None),
        "of an hour, by createdOn": (an_hour, newest, None, 0, None),
        "by status and robot": (robot, newest, None, 0, None),
        "part of the id": (None, newest, "4242", 0, None),
        "by external id": (external, newest, None, 0, None),
        "newest, as of the middle": (None, newest, None, 0, middle_ms),
        "live only": (_general("doneOn", "Null", None), newest, None, 0, None),
    }


async def _timed(what: str, calls: int, ask: Any) -> Row:
    took_ms = []
    for _ in range(calls):
        began = time.perf_counter()
        await ask()
        took_ms.append((time.perf_counter() - began) * 1e3)
    took_ms.sort()
    p50_ms, p99_ms = took_ms[calls // 2], took_ms[calls * 99 // 100]
    return {"what": what, "p50_ms": p50_ms, "p99_ms": p99_ms}


async def _ask(find: Find, orders: int) -> list[Row]:
    rows = []
    for what, (query, sort, fuzzy, skip, at_ms) in _questions(orders).items():
        condition = parse(query, Asker(user="", now_ms=START_MS))
        asked = Asked(condition=condition, sort=parse_sort(sort), fuzzy=fuzzy)
        for name, ask in (
            (f"page, {what}", lambda a=asked, s=skip, t=at_ms: find.page(a, s, 50, t)),
            (f"rows of it, {what}", lambda a=asked, s=skip, t=at_ms: find.some(a, s, 50, t)),
        ):
            rows.append(_told(await _timed(name, CALLS, ask)))
    ids = iter(_ids(orders))
    rows.append(_told(await _timed("detail by id", CALLS, lambda: find.order(next(ids)))))
    return rows


def _ids(orders: int) -> Iterator[OrderId]:
    number = 1
    while True:
        number = number * 7_919 % orders
        day = time.gmtime((START_MS + number * (DAY_MS // ORDERS_A_DAY)) / 1000)
        yield OrderId(f"TO{time.strftime('%Y%m%d', day)}-{number % ORDERS_A_DAY + 1:06}")


def _fleet(orders: int) -> Fleet:
    """Give the state at the end: live orders and robots."""
    at_ms = START_MS + orders * DAY_MS // ORDERS_A_DAY
    robots: dict[RobotKey, Robot] = {}
    for n in range(ROBOTS):
        config = RobotConfig(name=RobotName(f"AMB-{n}"))
        robots[robot_key(SCENE, config.name)] = Robot(
            scene=SCENE, config=config, bins=(RobotBin(),), idle_since_ms=at_ms
        )
    live = {}
    for n in range(LIVE):
        id_ = OrderId(f"TO29991231-{n + 1:06}")
        live[id_] = Order(
            id=id_, scene=SCENE, created_ms=at_ms + n, created_by="wms", modified_ms=at_ms + n,
            modified_by="wms",
        )  # fmt: skip
    days = {
        time.strftime("%Y%m%d", time.gmtime((START_MS + n * DAY_MS) / 1000)): ORDERS_A_DAY
        for n in range(orders // ORDERS_A_DAY + 1)
    }
    group = Group(id=0, name="g")
    scene = Scene(id=SCENE, name=SCENE_NAME, digest="", areas=(), groups=(group,))
    return Fleet(
        position=orders, at_ms=at_ms, scenes={SCENE: scene}, robots=robots, orders=live,
        order_counts={**days, "29991231": LIVE},
    )  # fmt: skip


async def _follow(find: Find, history: History, live: Live) -> list[Row]:
    """Ask for status and robot while 5,000 changes of orders a second come in."""
    condition = parse(
        _both(_general("status", "Eq", "Done"), _general("actualRobotName", "Eq", "AMB-7")),
        Asker(user="", now_ms=START_MS),
    )
    asked = Asked(condition=condition, sort=parse_sort(["-createdOn"]))
    began = time.perf_counter()
    before_s = time.process_time()
    took_ms: list[float] = []
    changes, coming = 0, _changes(live.position, live.fleet.at_ms)
    asking: asyncio.Task[object] | None = None
    asked_s = 0.0
    while (now_s := time.perf_counter() - began) < FOLLOWED_S:
        while changes < now_s * CHANGES_A_S:
            batch = [next(coming) for _ in range(25)]
            live.apply(batch)
            history.follow(batch)
            changes += len(batch)
        if asking is None or asking.done():
            if asking is not None:
                took_ms.append((time.perf_counter() - asked_s) * 1e3)
            asking, asked_s = asyncio.create_task(find.some(asked, 0, 50)), time.perf_counter()
        await asyncio.sleep(0.001)
    await asyncio.to_thread(_reached, history, live.position)
    took_s = time.perf_counter() - began
    took_ms.sort()
    return [
        _told(
            {
                "what": "followed, and asked by status and robot meanwhile",
                "changes_per_s": changes / took_s,
                "behind_s": took_s - FOLLOWED_S,
                "process_cpu_ratio": (time.process_time() - before_s) / took_s,
                "p50_ms": took_ms[len(took_ms) // 2],
                "max_ms": took_ms[-1],
            }
        )
    ]


def _reached(history: History, position: int) -> None:
    with history.moved:
        history.moved.wait_for(lambda: history.position >= position, timeout=60)


def _changes(position: int, at_ms: int) -> Iterator[AnyEvent]:
    number = LIVE
    while True:
        number += 1
        order = OrderId(f"TO29991231-{number:06}")
        robot = RobotName(f"AMB-{number % ROBOTS}")
        for blank in (
            OrderCreated(scene=SCENE, order=order, sealed=True, tasks=()),
            OrderAssigned(scene=SCENE, order=order, robot=robot, bin=0, cost_s=1.5),
            OrderFinished(scene=SCENE, order=order),
        ):
            position += 1
            yield stamped(blank, position, at_ms, "wms", CommandId(f"c{position}"))


def _memory_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def _told(row: Row) -> Row:
    print(", ".join(f"{k} {v:,.1f}" if isinstance(v, float) else str(v) for k, v in row.items()))
    sys.stdout.flush()
    return row


def _bench(path: Path, orders: int) -> list[Row]:
    live = Live(_fleet(orders))
    history = History(path, live)
    rows = []
    began = time.perf_counter()
    history.start(lambda after: iter([last_event(orders)][after - orders + 1 :]), _fleet, 60)
    rows.append(_told({"what": "opened", "took_s": time.perf_counter() - began}))
    reader = Reader(history.cursor, history.damaged)
    at_end = live.fleet.at_ms
    past = msgspec.structs.replace(live.fleet, orders={}, position=orders // 2)
    find = Find(live, reader, lambda at_ms: past, lambda: at_end)
    rows += asyncio.run(_ask(find, orders))
    rows.append(_told({"what": "memory of the read side", "mb": _memory_mb()}))
    rows += asyncio.run(_follow(find, history, live))
    rows.append(_told({"what": "memory after following", "mb": _memory_mb()}))
    reader.close()
    history.close()
    return rows


def main() -> list[Row]:
    """Make the file, or take the one that is there, and ask."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--orders", type=int, default=ORDERS)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.keep and options.keep.parent) as folder:
        path = Path(folder) / "history.duckdb"
        kept = options.keep or path
        if not kept.exists():
            began = time.perf_counter()
            # by a process of its own: its memory is not the read side's
            maker = get_context("spawn").Process(target=build, args=(kept, options.orders))
            maker.start()
            maker.join()
            _told({"what": "made", "took_s": time.perf_counter() - began})
        if kept != path:
            shutil.copyfile(kept, path)  # what follows changes it
        return _bench(path, options.orders)


if __name__ == "__main__":
    main()
