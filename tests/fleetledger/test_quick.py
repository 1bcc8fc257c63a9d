"""Quick calls over a real socket: nobody can tell them from those that go the ordinary way."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

import commands.api.m4
from fleetledger.access.callers import Anybody
from fleetledger.api import build
from fleetledger.durability import Then
from fleetledger.http import ThinRoute
from fleetledger.listening import served
from ledger.errors import Unknown
from tests.commands.api.application import Site, site
from tests.commands.site import SCENE

CREATE = "/api/fleet/orders/create"
ORDER = {"sceneId": SCENE, "keyLocations": ["AP125"]}
ORDINARY = ("X-Wait-Position: 0",)  # who waits for a position cannot be served at once


class Disk:
    """Says when a position is on it: only once let go."""

    def __init__(self) -> None:
        self.waiting: list[Then] = []
        self.slow = False
        self.failure: Unknown | None = None

    def when(self, position: int, then: Then) -> None:
        if self.slow:
            self.waiting.append(then)
        else:
            then(self.failure)


@asynccontextmanager
async def _serving(
    disk: Disk, refused: Callable[[str, str, str, str], None] = lambda *_: None
) -> AsyncIterator[tuple[Site, int]]:
    here = site()

    async def wait(position: int) -> bool:
        return True

    router = commands.api.m4.router(
        here.handler, here.durable, ThinRoute, here.keep_secrets, lambda u: here.watch(u)
    )
    app = build(
        [router],
        callers=Anybody(),
        refused=refused,
        position=lambda: here.ledger.durable,
        wait=wait,
        when=disk.when,
    )
    async with served(app, "127.0.0.1", 0) as port:
        yield here, port


def _call(body: Any, *headers: str, path: str = CREATE) -> bytes:
    raw = body if isinstance(body, bytes) else json.dumps(body).encode()
    lines = [f"POST {path} HTTP/1.1", "host: localhost", f"content-length: {len(raw)}", *headers]
    return "\r\n".join((*lines, "", "")).encode() + raw


async def _answer(reader: asyncio.StreamReader) -> tuple[str, dict[str, str], bytes]:
    head = (await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 30)).decode()
    status, *lines = head.strip().split("\r\n")
    headers = dict(line.split(": ", 1) for line in lines)
    return status, headers, await reader.readexactly(int(headers["content-length"]))


async def _answers(
    port: int, *sent: bytes, count: int = 1
) -> list[tuple[str, dict[str, str], bytes]]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        for piece in sent:
            writer.write(piece)
            await asyncio.sleep(0)
        return [await _answer(reader) for _ in range(count)]
    finally:
        writer.close()
        await writer.wait_closed()


CASES: dict[str, tuple[Any, tuple[str, ...], str]] = {
    "good": (ORDER, (), CREATE),
    "without a body to answer": ({"sceneId": SCENE}, (), "/api/fleet/orders/cancel-all"),
    "refused by a rule": ({"sceneId": "nowhere", "keyLocations": ["AP125"]}, (), CREATE),
    "with a field missing": ({"sceneId": SCENE, "steps": [{}]}, (), CREATE),
    "no JSON": (b"{", (), CREATE),
    "with a key": (ORDER, ("Idempotency-Key: 1",), CREATE),
    "with a bad key": (ORDER, (f"Idempotency-Key: {'x' * 201}",), CREATE),
    "by another host": (ORDER, ("host: evil.example",), CREATE),
    "from another's page": (ORDER, ("Origin: http://evil.example",), CREATE),
    "with too long a head": (ORDER, (f"x-much: {'x' * 40_000}",), CREATE),
    "that closes": (ORDER, ("connection: close",), CREATE),
    "in old words": (ORDER, ("expect: 100-nothing",), CREATE),
}
GOOD = ("good", "without a body to answer", "with a key", "that closes", "in old words")


@pytest.mark.parametrize("case", CASES)
async def test_a_quick_call_is_answered_as_the_ordinary_way_answers(case: str) -> None:
    body, headers, path = CASES[case]
    told: list[list[str]] = [[], []]
    found = []
    for way, more in enumerate(((), ORDINARY)):
        refused = lambda *what: told[way].append(what[-1])  # noqa: E731, B023
        async with _serving(Disk(), refused) as (_, port):
            [(status, got, raw)] = await _answers(port, _call(body, *headers, *more, path=path))
        got.pop("date")
        found.append((status, got, raw))
    assert found[0] == found[1]
    assert (case in GOOD) == ("200 OK" in found[0][0])
    assert told[0] == told[1]


async def test_a_key_gets_its_first_answer_on_either_way() -> None:
    async with _serving(Disk()) as (here, port):
        key = "Idempotency-Key: 7"
        [first] = await _answers(port, _call(ORDER, key))
        [again] = await _answers(port, _call(ORDER, key))
        [ordinary] = await _answers(port, _call(ORDER, key, *ORDINARY))
        [other] = await _answers(port, _call({**ORDER, "priority": 1}, key))
    assert first[2] == again[2] == ordinary[2]
    assert len(here.handler.fleet.orders) == 1
    assert other[0].startswith("HTTP/1.1 400") and b"errIdempotencyKeyReused" in other[2]


async def test_nothing_is_answered_before_it_is_on_disk_and_all_in_order() -> None:
    disk = Disk()
    disk.slow = True
    async with _serving(disk) as (here, port):
        asking = asyncio.ensure_future(_answers(port, _call(ORDER) * 2, count=2))
        while not disk.waiting:
            await asyncio.sleep(0)
        assert len(here.handler.fleet.orders) == 1
        assert not asking.done()
        disk.slow = False
        disk.waiting.pop()(None)
        first, second = await asking
    assert int(first[1]["x-ledger-position"]) < int(second[1]["x-ledger-position"])


async def test_a_disk_that_fails_is_told_to_who_waits() -> None:
    disk = Disk()
    disk.failure = Unknown("disk full")
    async with _serving(disk) as (_, port):
        [(status, _, raw)] = await _answers(port, _call(ORDER))
    assert status.startswith("HTTP/1.1 503")
    assert json.loads(raw)["code"] == "errLedgerUnavailable"


async def test_a_body_may_come_in_pieces() -> None:
    raw = _call(ORDER)
    async with _serving(Disk()) as (here, port):
        for cut in (len(raw) - 1, raw.index(b"\r\n\r\n") + 4, raw.index(b"\r\n\r\n") + 9):
            [(status, _, _)] = await _answers(port, raw[:cut], raw[cut:])
            assert status == "HTTP/1.1 200 OK"
    assert len(here.handler.fleet.orders) == 3


async def test_who_goes_before_the_answer_holds_nobody_up() -> None:
    disk = Disk()
    disk.slow = True
    async with _serving(disk) as (here, port):
        _, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(_call(ORDER))
        while not disk.waiting:
            await asyncio.sleep(0)
        writer.transport.abort()
        await asyncio.sleep(0)
        disk.slow = False
        disk.waiting.pop()(None)
        [(status, _, _)] = await _answers(port, _call(ORDER))
    assert status == "HTTP/1.1 200 OK"
    assert len(here.handler.fleet.orders) == 2
