"""Find over memory and DuckDB, against every order there ever was."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ledger.errors import Refused
from ledger.ids import OrderId
from ledger.state import Fleet
from projections.fields import BY_NAME, FIELDS, row
from projections.find import Asked, Find, Page
from projections.live import Live
from projections.query import Asker, parse
from projections.reading import Reader, TooSlow
from projections.sorting import parse_sort
from tests.projections.past import Log, Side, all_orders, archive_of, long_log, scene_names

ASKER = Asker(user="alice", now_ms=0)
LOG = long_log()
DONE = {"type": "General", "field1": "status", "operator": "Eq", "value": "Done"}
URGENT = {"type": "General", "field1": "priority", "operator": "Gt", "value": 20}


@pytest.fixture
def side(tmp_path: Path) -> Iterator[Side]:
    side = Side(tmp_path, LOG, 250)
    yield side
    side.close()


def truth(log: Log, until: int) -> list[dict[str, Any]]:
    """All rows at a position, by ascending id."""
    orders = all_orders(Log(log.events[:until]))
    names = scene_names(Log(log.events[:until]))
    return [row(orders[id_], names[id_], FIELDS) for id_ in sorted(orders)]


def asked(query: Any = None, sort: list[str] | None = None, fuzzy: str | None = None) -> Asked:
    return Asked(condition=parse(query, ASKER), sort=parse_sort(sort), fuzzy=fuzzy, fields=FIELDS)


async def all_rows(find: Find, wanted: Asked, at_ms: int | None = None) -> list[dict[str, Any]]:
    _, chunks = await find.every(wanted, 0, None, at_ms)
    return [row async for chunk in chunks for row in chunk]


async def test_nothing_is_missing_or_twice_while_the_projector_follows(side: Side) -> None:
    for until in range(250, len(LOG.events) + 1, 25):
        side.go_on(until)
        expected = truth(LOG, until)
        assert await all_rows(side.find, asked()) == expected
        assert (await side.find.count(asked()))[0] == len(expected)
        done = [row for row in expected if row["status"] == "Done"]
        page = await side.find.page(asked(DONE), 3, 4)
        assert (list(page.rows), page.total) == (done[3:7], len(done))
        assert page.position == until


@pytest.mark.parametrize("sort", [[], ["-createdOn"], ["createdOn", "-id"], ["-doneOn", "status"]])
@pytest.mark.parametrize("query", [None, DONE, URGENT])
async def test_pages_partition_the_answer_of_many(side: Side, sort: list[str], query: Any) -> None:
    side.go_on(590)
    wanted = asked(query, sort)
    everything = await all_rows(side.find, wanted)
    pages: list[dict[str, Any]] = []
    for number in range(len(everything) // 7 + 1):
        page: Page = await side.find.page(wanted, number * 7, 7)
        assert page.total == len(everything)
        pages += page.rows
    assert pages == everything
    assert len({row["id"] for row in everything}) == len(everything)


async def test_newest_first_is_sorted_by_creation_and_then_by_id(side: Side) -> None:
    side.go_on(600)
    page = await side.find.page(asked(sort=["-createdOn"]), 0, 1000)
    expected = sorted(truth(LOG, 600), key=lambda row: (-row["createdOn"], row["id"]))
    assert list(page.rows) == expected


@pytest.mark.parametrize("kept", [0, 4, 30])
async def test_default_pages_are_the_same_however_many_orders_are_kept_for_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: int
) -> None:
    monkeypatch.setattr("projections.live.NEWEST_KEPT", kept)
    monkeypatch.setattr("projections.history.NEWEST_KEPT", kept)
    side = Side(tmp_path, LOG, 250)
    for until in (251, 330, 480, 600):
        side.go_on(until)
        expected = sorted(truth(LOG, until), key=lambda row: (-row["createdOn"], row["id"]))
        for skip in (0, 3, 11, 29):
            page = await side.find.page(asked(sort=["-createdOn"]), skip, 6)
            assert list(page.rows) == expected[skip : skip + 6]
    side.close()


async def test_the_past_is_answered_as_it_was_answered_then(side: Side) -> None:
    side.go_on(600)
    for position in range(5, 600, 45):
        at_ms = LOG.events[position - 1].at_ms
        until = max(e.position for e in LOG.events if e.at_ms <= at_ms)
        expected = truth(LOG, until)
        assert await all_rows(side.find, asked(), at_ms) == expected
        newest = sorted(expected, key=lambda row: (-row["createdOn"], row["id"]))
        page = await side.find.page(asked(sort=["-createdOn"]), 2, 5, at_ms)
        assert (list(page.rows), page.total, page.position) == (newest[2:7], len(newest), until)


async def test_the_future_cannot_be_asked_for(side: Side) -> None:
    with pytest.raises(Refused, match="future"):
        await side.find.count(asked(), LOG.events[-1].at_ms + 1)


async def test_fuzzy_finds_part_of_the_id_in_any_case(side: Side) -> None:
    side.go_on(600)
    found = await all_rows(side.find, asked(fuzzy="to20260922-00000"))
    assert [row["id"] for row in found] == [f"TO20260922-00000{n}" for n in range(1, 10)]


async def test_an_order_is_found_whole_wherever_it_is(side: Side) -> None:
    side.go_on(600)
    for id_, order in all_orders(LOG).items():
        assert await side.find.order(id_) == (order, 600)
    assert (await side.find.order(OrderId("TO1")))[0] is None


async def test_an_order_is_found_as_it_was(side: Side) -> None:
    side.go_on(600)
    at_ms = LOG.events[300].at_ms
    then = all_orders(Log([e for e in LOG.events if e.at_ms <= at_ms]))
    for id_ in all_orders(LOG):
        assert (await side.find.order(id_, at_ms))[0] == then.get(id_)


async def test_a_query_is_stopped_when_its_time_is_up() -> None:
    archive = archive_of([])
    reader = Reader(archive.cursor, query_s_max=0.02)
    with pytest.raises(TooSlow, match="narrow"):
        await reader.run(
            lambda c: c.execute("SELECT count(*) FROM range(1e12::BIGINT) t(i) WHERE sin(i) > 2")
        )
    reader.close()
    archive.close()


async def test_orders_that_were_not_created_in_order_are_sorted_all_the_same() -> None:
    log = long_log()
    fleet = log.fleet_at(400)
    fleet.orders = dict(reversed(fleet.orders.items()))
    archive = archive_of([])
    reader = Reader(archive.cursor)
    find = Find(Live(fleet), reader, lambda _: Fleet(), lambda: 0)
    page = await find.some(asked(sort=["-createdOn"]), 0, 2)
    newest = sorted(fleet.orders.values(), key=lambda o: (-o.created_ms, o.id))[:2]
    assert [r[BY_NAME["id"].name] for r in page.rows] == [o.id for o in newest]
    reader.close()
    archive.close()
