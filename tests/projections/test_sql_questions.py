"""Every question of docs/sql.md is asked over a history, by both ways, and answered rightly."""

import asyncio
from collections import Counter, defaultdict
from functools import partial
from pathlib import Path
from statistics import mean, quantiles
from typing import Any

import msgspec
import pytest

from fleetledger.analyst import Analyst
from fleetledger.config import Settings
from ledger.events import (
    AssignmentRejected,
    DeviceFaulted,
    DeviceRecovered,
    ExecutionRejected,
    MapResourcesAsked,
    MapResourcesGranted,
    MapResourcesReleased,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderFinished,
    OrderPrioritised,
    OrderSuspended,
    OrderUnsuspended,
    OrderWithdrawn,
    RobotConnected,
    RobotDisconnected,
    RobotGivenUp,
    RobotsWaited,
    StepsAdded,
    StepsChanged,
    StepsDeleted,
)
from ledger.evolve import evolve
from ledger.ids import UnitId
from ledger.link import InstructionKind
from ledger.moment import parse_time, time_text
from ledger.scan import read_folder
from ledger.state import Fleet, OrderStatus, StepStatus
from ledger.store import FileLedger
from projections.sql import run_sql
from projections.sql_questions import QUESTIONS, Question
from tests.projections.past import all_orders, long_log

HOUR_MS = 3_600_000
LOG = long_log(3_000, seed=5)
NEWEST_MS = LOG.events[-1].at_ms
ORDERS = all_orders(LOG).values()
DONE = [order for order in ORDERS if order.status is OrderStatus.DONE]
Row = list[Any]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    ledger = FileLedger.open(folder / "ledger")
    for start in range(0, len(LOG.events), 500):
        ledger.append(LOG.events[start : start + 500], start)
    ledger.close()
    return folder


async def all_answered(data: Path) -> dict[str, list[Row]]:
    """Ask as POST /api/sql does: a process of its own, whose limits are not those of the tests."""
    settings = Settings(data=data, sql_seconds=20.0, sql_memory_mb=1_000)
    analyst = Analyst(settings, lambda: len(LOG.events))
    found = {}
    for question in QUESTIONS:
        answered = await analyst.ask(question.sql, 100_000)
        assert (answered.status, answered.position) == (200, len(LOG.events)), answered.body
        found[question.title] = msgspec.json.decode(answered.body)["rows"]
    await analyst.close()
    return found


@pytest.fixture(scope="module")
def answers(data: Path) -> dict[str, list[Row]]:
    return asyncio.run(all_answered(data))


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda q: q.title)
def test_every_question_has_an_answer(question: Question, answers: dict[str, list[Row]]) -> None:
    assert answers[question.title]
    assert question.doc.endswith(".")


def test_the_command_line_answers_the_same(data: Path, answers: dict[str, list[Row]]) -> None:
    for question in QUESTIONS[::7]:  # each makes the tables anew
        found = run_sql(data, question.sql, partial(read_folder, data / "ledger"))
        assert msgspec.json.decode(msgspec.json.encode(found.rows)) == answers[question.title]


def test_there_are_twenty_at_least() -> None:
    assert len({question.title for question in QUESTIONS}) >= 20


def near(rows: list[Row]) -> list[Row]:
    return [[round(v, 6) if isinstance(v, float) else v for v in row] for row in rows]


def asked(answers: dict[str, list[Row]], word: str) -> list[Row]:
    (title,) = (title for title in answers if word in title)
    return near(answers[title])


def test_throughput(answers: dict[str, list[Row]]) -> None:
    hours = Counter(time_text((o.done_ms or 0) // HOUR_MS * HOUR_MS)[:19] + "Z" for o in DONE)
    assert asked(answers, "done in each hour") == [[hour, hours[hour]] for hour in sorted(hours)]


def test_waiting_by_reason(answers: dict[str, list[Row]]) -> None:
    """Found anew by going through each order's own events."""
    total_s: dict[tuple[str, str | None], float] = defaultdict(float)
    waits: Counter[tuple[str, str | None]] = Counter()
    for order in ORDERS:
        since: tuple[int, tuple[str, str | None]] | None = None
        for event in LOG.events:
            if getattr(event, "order", None) != order.id:
                continue
            match event:
                case OrderCreated() | OrderWithdrawn():
                    reason: tuple[str, str | None] | None = ("Assignment", None)
                case AssignmentRejected():
                    reason = ("Assignment", event.code)
                case ExecutionRejected():
                    reason = ("Execution", event.code) if event.code else None
                case OrderAssigned() | OrderFinished() | OrderCancelled():
                    reason = None
                case _:
                    continue
            if since is not None:
                total_s[since[1]] += (event.at_ms - since[0]) / 1000
            since = None if reason is None else (event.at_ms, reason)
            if reason is not None:
                waits[reason] += 1
        if since is not None:
            total_s[since[1]] += (NEWEST_MS - since[0]) / 1000
    found = {(row[0], row[1]): (row[2], row[4]) for row in asked(answers, "what do orders wait")}
    assert found == {key: (waits[key], round(total_s[key], 6)) for key in waits}


def test_lead_times(answers: dict[str, list[Row]]) -> None:
    took = [((o.done_ms or 0) - o.created_ms) / 1000 for o in DONE]
    cuts = quantiles(took, n=100, method="inclusive")
    (row,) = asked(answers, "take, by kind")
    assert row == near([["Business", len(took), cuts[49], cuts[89], cuts[98]]])[0]


def test_pairs_of_stations_and_places(answers: dict[str, list[Row]]) -> None:
    pairs: Counter[tuple[str, str]] = Counter()
    for order in ORDERS:
        source = next((s.task.location for s in order.steps if s.task.loads), None)
        target = next((s.task.location for s in order.steps if s.task.unloads), None)
        if source is not None and target is not None:
            pairs[source, target] += 1
    assert {(a, b): n for a, b, n, _ in asked(answers, "most carried")} == dict(pairs)
    done = [s for o in ORDERS for s in o.steps if s.status is StepStatus.DONE]
    places = {row[0]: tuple(row[1:]) for row in asked(answers, "are the busiest")}
    assert places == {
        place: (
            len(here),
            sum(s.task.loads for s in here),
            sum(s.task.unloads for s in here),
        )
        for place in {s.task.location for s in done}
        if (here := [s for s in done if s.task.location == place])
    }


def test_queue(answers: dict[str, list[Row]]) -> None:
    for minute, waiting in asked(answers, "long was the queue")[::7]:
        fleet = LOG.moment(parse_time(minute))
        assert waiting == sum(order.robot is None for order in fleet.orders.values()), minute


def test_who_cancels_and_what_is_withdrawn(answers: dict[str, list[Row]]) -> None:
    by = Counter(e.by for e in LOG.events if isinstance(e, OrderCancelled))
    assert {row[0]: row[1] for row in asked(answers, "cancels")} == by
    back = Counter((e.robot, e.reason) for e in LOG.events if isinstance(e, OrderWithdrawn))
    assert {(r, why): n for r, why, n, _ in asked(answers, "taken from their robot")} == back


def test_who_is_passed_over(answers: dict[str, list[Row]]) -> None:
    over: Counter[tuple[str, str]] = Counter()
    for event in LOG.events:
        if isinstance(event, AssignmentRejected):
            over.update(event.robots.items())
        elif isinstance(event, OrderAssigned):
            over.update((c.robot, c.reason) for c in event.candidates if c.reason is not None)
    assert {(r, why): n for r, why, n, _ in asked(answers, "passed over")} == over


def test_callers(answers: dict[str, list[Row]]) -> None:
    events = Counter(e.by for e in LOG.events)
    assert {row[0]: row[2] for row in asked(answers, "tells the server")} == events


def test_what_is_touched(answers: dict[str, list[Row]]) -> None:
    kinds = (
        *(StepsAdded, StepsChanged, StepsDeleted),
        *(OrderPrioritised, OrderSuspended, OrderUnsuspended),
    )
    changes = Counter(e.order for e in LOG.events if isinstance(e, kinds))
    rows = asked(answers, "touched")
    assert [row[1] for row in rows] == sorted(changes.values(), reverse=True)[:100]
    assert all(changes[row[0]] == row[1] for row in rows)


def test_outages_and_what_it_takes_to_mend(answers: dict[str, list[Row]]) -> None:
    since: dict[str, int] = {}
    offline_s: dict[str, float] = defaultdict(float)
    for event in LOG.events:
        if isinstance(event, RobotDisconnected | RobotGivenUp):
            since.setdefault(event.robot, event.at_ms)
        elif isinstance(event, RobotConnected) and event.robot in since:
            offline_s[event.robot] += (event.at_ms - since.pop(event.robot)) / 1000
    for robot, from_ms in since.items():
        offline_s[robot] += (NEWEST_MS - from_ms) / 1000
    found = {row[1]: (row[3], row[5]) for row in asked(answers, "not to be reached")}
    assert found == {r: (round(s, 6), r in since) for r, s in offline_s.items()}
    broken: dict[tuple[str, int], tuple[int, str]] = {}
    took: dict[tuple[str, str], list[float]] = defaultdict(list)
    for event in LOG.events:
        if isinstance(event, DeviceFaulted | DeviceRecovered):
            key = (str(event.kind), event.device)
            if key in broken:
                from_ms, reason = broken.pop(key)
                took[key[0], reason].append((event.at_ms - from_ms) / 1000)
            if isinstance(event, DeviceFaulted):
                broken[key] = (event.at_ms, event.reason)
    rows = [row for row in asked(answers, "to mend") if row[0] in ("Door", "Lift")]
    assert {(of, why): (n, s) for of, why, n, s, _ in rows} == {
        key: (len(some), round(mean(some), 6)) for key, some in took.items()
    }


def test_reservations(answers: dict[str, list[Row]]) -> None:
    owner: dict[UnitId, str] = {}
    since: dict[UnitId, int] = {}
    asked_for: Counter[str] = Counter()
    held_s: dict[str, float] = defaultdict(float)
    for event in LOG.events:
        if isinstance(event, MapResourcesAsked):
            owner |= {unit.id: unit.owner for unit in event.units}
            asked_for.update(unit.owner for unit in event.units)
        elif isinstance(event, MapResourcesGranted):
            since |= dict.fromkeys(event.units, event.at_ms)
        elif isinstance(event, MapResourcesReleased):
            for id_ in event.units:
                if id_ in since:
                    held_s[owner[id_]] += (event.at_ms - since.pop(id_)) / 1000
    for id_, from_ms in since.items():
        held_s[owner[id_]] += (NEWEST_MS - from_ms) / 1000
    found = {row[0]: (row[1], row[4]) for row in asked(answers, "reserved ground")}
    assert found == {name: (n, round(held_s[name], 6)) for name, n in asked_for.items()}


def test_who_makes_whom_wait(answers: dict[str, list[Row]]) -> None:
    waited: Counter[tuple[str, str]] = Counter()
    places: Counter[str] = Counter()
    for event in LOG.events:
        for wait in event.waits if isinstance(event, RobotsWaited) else ():
            if event.at_ms > NEWEST_MS - 24 * HOUR_MS:
                waited.update({(wait.robot, other): wait.total_ms for other in wait.blockers})
            places.update({wait.place: wait.total_ms} if wait.place else {})
    found = {(row[0], row[1]): row[3] for row in asked(answers, "made which others wait")}
    assert found == {pair: ms / 1000 for pair, ms in waited.items()}
    by_place = {row[0]: row[1] for row in asked(answers, "place causes most waiting")}
    assert by_place == {place: ms / 1000 for place, ms in places.items()}


def test_cycles_and_plannings(answers: dict[str, list[Row]]) -> None:
    noted = [event for event in LOG.events if isinstance(event, RobotsWaited)]
    seen = {tuple(cycle.robots) for event in noted for cycle in event.cycles}
    assert {tuple(row[0]) for row in asked(answers, "wait for each other")} == seen
    times: Counter[str] = Counter()
    for _, what, n in asked(answers, "push robots out of the way"):
        times[what] += n
    plannings = Counter({"Pushes": sum(event.pushes for event in noted)})
    for event in noted:
        plannings.update(event.plannings)
    assert times == plannings


def test_use_of_robots(answers: dict[str, list[Row]]) -> None:
    """Looked at after each event: with a business order, and nothing else in its way."""
    busy_ms: Counter[str] = Counter()
    all_ms: Counter[str] = Counter()
    fleet = Fleet()
    for event, following in zip(LOG.events, [*LOG.events[1:], LOG.events[-1]], strict=True):
        evolve(fleet, event)
        for robot in fleet.robots.values():
            told = {i.kind for i in robot.instructions if i.on}
            free = robot.online and not robot.config.disabled
            stopped = {InstructionKind.SOFT_STOP, InstructionKind.PAUSE} & told
            spent_ms = following.at_ms - event.at_ms
            all_ms[robot.name] += spent_ms
            if free and not stopped and robot.orders:  # there are only business orders here
                busy_ms[robot.name] += spent_ms
    found = {row[1]: row[2] for row in asked(answers, "busy is each")}
    assert found == {
        name: round(busy_ms[name] / all_ms[name], 6) if busy_ms[name] else None for name in all_ms
    }
