"""Callbacks of the real server, from outside."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

from fleetledger.callback_post import signature
from fleetledger.clock import wall_ms
from projections.callbacks import OrderCallback
from tests.fleetledger.receiver import (
    ACCEPT,
    DROP,
    REFUSE,
    Got,
    Moody,
    Receiver,
    is_signed,
    no_step_back,
)
from tests.fleetledger.server import Server, serving, small_file, small_scene
from tests.laws.onlooker import bins_of

BINS = bins_of(small_file())
OPTIONS = ("--simulate", "--auth", "none", "--speed", "20")
SECRET = "0123456789abcdef"
PAGE = Path(__file__).parents[2] / "docs" / "callbacks.md"
IN_ORDER = ("ToBeAllocated", "Allocated", "Executing", "Done")


def enable(server: Server, *urls: str, **fields: Any) -> dict[str, Any]:
    body = {"enableOrderCallback": True, "callbackUrlList": list(urls), "retryInterval": 0.1}
    answer = server.post(f"/api/fleet/scenes/{server.scene}/callbacks", body | fields)
    assert isinstance(answer, dict)
    return answer


def waiting(server: Server) -> dict[str, Any]:
    found = server.get(f"/api/fleet/scenes/{server.scene}/callbacks/waiting")
    assert isinstance(found, dict)
    return found


def done(got: Sequence[Got], orders: set[str], path: str) -> bool:
    """Whether the last state of each order has been accepted at an address."""
    ended = {
        one.body["orderId"]
        for one in got
        if one.path == path and one.answer == ACCEPT and one.body["status"] in ("Done", "Cancelled")
    }
    return orders <= ended


def states(server: Server, order: str) -> list[tuple[str, int]]:
    """An order's states and their positions, by the events of the ledger."""
    words = {
        "OrderCreated": ["ToBeAllocated"],
        "OrderAssigned": ["Allocated"],
        "StepStarted": ["Executing"],
        "OrderWithdrawn": ["Withdrawing", "ToBeAllocated"],
        "OrderFinished": ["Done"],
        "OrderCancelled": ["Cancelling", "Cancelled"],
    }
    found: list[tuple[str, int]] = []
    for event in server.get("/api/ledger/events", limit=10_000):
        if event.get("order") == order and event["type"] in words:
            found += [
                (word, event["position"])
                for word in words[event["type"]]
                if not found or found[-1][0] != word
            ]
    return found


def heard(got: Sequence[Got], order: str, path: str) -> list[tuple[str, int]]:
    found: list[tuple[str, int]] = []
    for one in got:
        word = (one.body["status"], one.body["position"])
        if one.path == path and one.body["orderId"] == order and word not in found:
            found.append(word)
    return found


def test_after_kill_9_at_any_instant_nothing_is_missing(tmp_path: Path) -> None:
    random = Random(3)
    data, scene = tmp_path / "data", small_scene(tmp_path)
    orders: set[str] = set()
    with Receiver(Moody(Random(3), ACCEPT, ACCEPT, REFUSE, DROP)) as receiver:
        paths = ("/a", "/b")
        for round_ in range(2):
            with serving(data, *OPTIONS, "--scene", str(scene)) as server:
                if round_ == 0:
                    enable(server, *map(receiver.url, paths), secret=SECRET, retryTimes=10_000)
                before = len(receiver.got)
                for _ in range(6):
                    orders.add(server.order(*random.sample(BINS, 2)))
                wanted = before + random.randint(1, 25)
                receiver.until(lambda got, n=wanted: len(got) >= n)  # type: ignore[misc]
                server.kill()
        with serving(data, *OPTIONS) as server:
            for path in paths:
                receiver.until(lambda got, path=path: done(got, orders, path))  # type: ignore[misc]
            for order in orders:
                for path in paths:
                    assert heard(receiver.got, order, path) == states(server, order)
            assert server.stop() == 0
        no_step_back(receiver.got)
        assert all(is_signed(one, SECRET) for one in receiver.got)
        assert {one.body["orderId"] for one in receiver.got} == orders


def test_settings_waiting_giving_up_and_a_quick_stop(tmp_path: Path) -> None:
    data, scene = tmp_path / "data", small_scene(tmp_path)
    with Receiver() as good, Receiver(lambda _: REFUSE) as bad:
        with serving(data, *OPTIONS, "--scene", str(scene)) as server:
            first = server.order(BINS[0], BINS[1])
            made = enable(server, good.url(), callbackStatusList=["Done"])
            server.until_finished(first)
            good.until(lambda got: done(got, {first}, "/orders"))
            assert [one.body["status"] for one in good.got] == ["Done"]
            assert is_signed(good.got[0], made["secret"])
            enable(server, bad.url("/hook?token=t0ken"), callbackStatusList=[], retryTimes=1)
            second = server.order(BINS[1], BINS[0])
            given_up = server.until(lambda event: event["type"] == "CallbackGivenUp")
            assert given_up["order"] == second
            assert (given_up["status"], given_up["by"]) == ("ToBeAllocated", "callbacks")
            assert given_up["reason"] == "HTTP 500"
            enable(server, bad.url("/hook?token=t0ken"), retryTimes=10_000, retryInterval=60)
            third = server.order(BINS[0], BINS[1])
            bad.until(lambda got: any(one.body["orderId"] == third for one in got))
            found = waiting(server)
            assert found["urls"][0]["url"] == bad.url("/hook?token=t0ken")
            assert len(good.got) == 1, "what was taken out of the settings hears no more"
            assert server.stop() == 0
        log = server.log.read_text()
        assert "callback given up" in log
        assert "t0ken" not in log
        assert made["secret"] not in log
        for file in (data / "ledger").iterdir():
            assert made["secret"].encode() not in file.read_bytes()
        with serving(data, *OPTIONS) as server:
            oldest = waiting(server)["urls"][0]["oldest"]
            assert oldest["orderId"] in (second, third)


def test_the_page_tells_receivers_how_to_check_a_signature() -> None:
    code = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(code) == 1
    names: dict[str, Any] = {}
    exec(code[0], names)
    is_genuine = names["is_genuine"]
    body = json.dumps({"status": "Done"}).encode()
    now, old = (str(wall_ms() - age) for age in (0, 3_600_000))
    assert is_genuine(SECRET, now, signature(SECRET, now, body), body)
    assert not is_genuine(SECRET, now, signature(SECRET, now, body), body + b" ")
    assert not is_genuine("another", now, signature(SECRET, now, body), body)
    assert not is_genuine(SECRET, now, signature(SECRET, old, body), body)
    assert not is_genuine(SECRET, old, signature(SECRET, old, body), body)
    assert not is_genuine(SECRET, now, "sha256=\u00e9", body)


def test_the_page_shows_what_comes_in_full() -> None:
    text = PAGE.read_text()
    shown = json.loads(re.search(r"\n(\{\"id\".*?\})\n```", text, re.DOTALL)[1])  # type: ignore[index]
    assert tuple(shown) == OrderCallback.__struct_fields__
