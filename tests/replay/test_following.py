"""Streams of events: resumed by position, and let go where nobody reads."""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from replay.following import (
    ABORT,
    BATCH_EVENTS_MAX,
    FOLLOWERS_MAX,
    AheadOfLedger,
    Followers,
    TooManyFollowers,
)
from tests.replay.site import TURN_MS, Site


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    site = Site(tmp_path)
    site.run(3)
    yield site
    site.close()


def parts(text: bytes) -> list[dict[str, Any]]:
    """Each event: its id, its name, its content."""
    found = []
    for part in text.decode().strip().split("\n\n"):
        id_, kind, data = part.split("\n")
        event = msgspec.json.decode(data.removeprefix("data: "))
        assert id_ == f"id: {event['position']}"
        assert kind == f"event: {event['type']}"
        found.append(event)
    return found


async def test_a_stream_resumes_behind_the_last_event_seen_and_goes_on(site: Site) -> None:
    position = site.fleet.position
    stream = Followers(site.source).texts(position - 2)
    assert [e["position"] for e in parts(await anext(stream))] == [position - 1, position]
    assert (await anext(stream)).startswith(b": ")
    site.run(TURN_MS / 1000)
    more = parts(await anext(stream))
    assert [e["position"] for e in more] == list(range(position + 1, site.fleet.position + 1))
    await stream.aclose()


async def test_who_is_far_behind_catches_up_in_parts(site: Site) -> None:
    site.run(TURN_MS / 1000)
    stream = Followers(site.source).texts(0)
    events = parts(await anext(stream))
    assert len(events) == min(BATCH_EVENTS_MAX, site.fleet.position)
    await stream.aclose()


async def test_who_has_events_that_are_not_there_is_told(site: Site) -> None:
    ahead = site.fleet.position + 1
    with pytest.raises(AheadOfLedger, match=f"Position {ahead} is not in this ledger"):
        Followers(site.source).follow(ahead)


async def never() -> dict[str, Any]:
    await asyncio.Event().wait()
    raise AssertionError


def scope(aborted: list[bool]) -> dict[str, Any]:
    return {"type": "http", "extensions": {ABORT: {"call": lambda: aborted.append(True)}}}


async def test_a_client_that_does_not_read_is_let_go_and_holds_one_piece(site: Site) -> None:
    followers = Followers(site.source, stall_s=0.01)
    answer = followers.follow(0)
    sent: list[Any] = []
    aborted: list[bool] = []

    async def send(message: Any) -> None:
        sent.append(message)
        if message["type"] == "http.response.body":
            await asyncio.Event().wait()  # its buffer is full

    await answer(scope(aborted), never, send)
    assert aborted == [True]
    assert [m["type"] for m in sent] == ["http.response.start", "http.response.body"]
    assert followers.count == 0


async def test_a_client_that_leaves_makes_room_for_another(site: Site) -> None:
    followers = Followers(site.source)
    leave = asyncio.Event()
    began: asyncio.Queue[str] = asyncio.Queue()

    async def receive() -> dict[str, Any]:
        await leave.wait()
        return {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        if message["type"] == "http.response.start":
            began.put_nowait("began")

    answers = [followers.follow(0) for _ in range(FOLLOWERS_MAX)]
    serving = [asyncio.create_task(answer(scope([]), receive, send)) for answer in answers]
    for _ in answers:
        await began.get()
    with pytest.raises(TooManyFollowers):
        followers.follow(0)
    leave.set()
    await asyncio.gather(*serving)
    assert followers.count == 0
    followers.follow(0)


async def test_what_goes_wrong_in_a_stream_is_not_hidden(site: Site) -> None:
    answer = Followers(site.source).follow(0)

    async def send(message: Any) -> None:
        if message["type"] == "http.response.body":
            raise RuntimeError("a bug")

    with pytest.raises(RuntimeError, match="a bug"):
        await answer(scope([]), never, send)
