"""Exactly once: a repeated key gets the first answer within the window, over all restarts."""

import os
import signal
import threading
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any

import httpx
import msgspec
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from commands.answers import SetAnswersWindow
from commands.handle import Handler, Reply
from commands.orders import CreateOrder
from commands.rejected import Reason, Rejected
from ledger.evolve import fold
from ledger.ids import CommandId
from ledger.scene import Value
from ledger.snapshot import check, to_bytes
from ledger.state import Fleet
from ledger.store import MemoryLedger
from tests.commands.site import SCENE, opened, task
from tests.fleetledger.server import order_body, serving, small_file, small_scene, still_there
from tests.laws.onlooker import bins_of
from tests.scenario import STORY_MS, happened

KEYS = st.sampled_from("abcd")


class First(Value, frozen=True, kw_only=True):
    """What the model remembers of an answer."""

    key: str
    digest: str
    at_ms: int
    reply: Reply


class Window(RuleBasedStateMachine):
    """A handler that is asked, restarted from snapshots and from nothing, and given new windows."""

    def __init__(self) -> None:
        super().__init__()
        self.at_ms = STORY_MS
        self.ledger = MemoryLedger()
        self.numbers = count(1)
        fleet = happened(opened())
        events = [
            msgspec.structs.replace(event, position=n, at_ms=STORY_MS)
            for n, event in enumerate(opened(), 1)
        ]
        self.ledger.append(events, 0)
        self.handler = self.made(fleet)
        self.snapshot = to_bytes(fleet)
        self.window = (10_000, 86_400_000)
        self.kept: list[First] = []  # the model: the oldest first
        self.starts_with_other_settings(3, 30)

    def made(self, fleet: Fleet) -> Handler:
        return Handler(fleet, self.ledger, lambda: self.at_ms, lambda: f"{next(self.numbers):024X}")

    def prune(self) -> None:
        count_max, age_ms = self.window
        young = [first for first in self.kept if self.at_ms - first.at_ms <= age_ms]
        self.kept = young[-count_max:]

    @rule(key=KEYS, digest=st.sampled_from("xxxy"), refused=st.booleans())
    def ask(self, key: str, digest: str, refused: bool) -> None:
        age_ms = self.window[1]
        due = [f for f in self.kept if f.key == key and self.at_ms - f.at_ms <= age_ms]
        before = self.ledger.position
        command = CreateOrder(
            id=CommandId(key),
            by="alice",
            at_ms=self.at_ms,
            scene=SCENE,
            tasks=() if refused else (task(),),
        )
        said = Reply(status=400 if refused else 200, body=f"answer {next(self.numbers)}")
        if due and due[0].digest != digest:
            try:
                self.handler.handle_once(command, digest, lambda _: said)
            except Rejected as no:
                assert no.reason is Reason.KEY_REUSED
                assert self.ledger.position == before
                return
            raise AssertionError("the key of another request was taken")
        answered = self.handler.handle_once(command, digest, lambda _: said)
        if due:
            assert answered.reply == due[0].reply, "not the first answer"
            assert self.ledger.position == before, "it happened twice"
            return
        assert answered.reply == said
        assert self.ledger.position == before + (1 if refused else 2)
        self.kept = [first for first in self.kept if first.key != key]
        self.kept.append(First(key=key, digest=digest, at_ms=self.at_ms, reply=said))
        self.prune()

    @rule(step_ms=st.sampled_from((500, 1_000, 1_001, 30_001, 90_000_000)))
    def time_passes(self, step_ms: int) -> None:
        self.at_ms += step_ms

    @rule(count_max=st.integers(1, 5), age_s_max=st.sampled_from((1, 30, 86_400)))
    def starts_with_other_settings(self, count_max: int, age_s_max: int) -> None:
        before = self.ledger.position
        window = (count_max, age_s_max * 1000)
        command = SetAnswersWindow(
            id=CommandId("w"),
            by="serve",
            at_ms=self.at_ms,
            count_max=count_max,
            age_s_max=age_s_max,
        )
        self.handler.handle(command)
        assert self.ledger.position == before + (window != self.window), "stated if it is another"
        if window != self.window:
            self.window = window
            self.prune()

    @rule()
    def keeps_a_snapshot(self) -> None:
        self.snapshot = to_bytes(self.handler.fleet)

    @rule()
    def restarts_from_the_snapshot(self) -> None:
        head, body = check(self.snapshot)
        fleet = msgspec.json.decode(body, type=Fleet)
        self.handler = self.made(fold(fleet, self.ledger.read(head.position)))

    @rule()
    def restarts_from_the_beginning(self) -> None:
        self.handler = self.made(fold(Fleet(), self.ledger.read(0)))

    @invariant()
    @precondition(lambda self: self.ledger.position < 60)
    def the_state_is_the_fold(self) -> None:
        assert fold(Fleet(), self.ledger.read(0)).canonical() == self.handler.fleet.canonical()


TestWindow = Window.TestCase
TestWindow.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)

BINS = bins_of(small_file())
CREATE = "/api/fleet/orders/create"


def sent(url: str, scene: str, key: str) -> tuple[int, bytes]:
    """Send the order of a key as any client would."""
    body = order_body(scene, BINS[0], BINS[-1])
    answer = httpx.post(f"{url}{CREATE}", json=body, headers={"Idempotency-Key": key}, timeout=30)
    return answer.status_code, answer.content


def test_keys_are_answered_once_over_kill_9_and_a_narrower_window(tmp_path: Path) -> None:
    """The scheduler of the killed server is held up, so that it lives on and keeps nothing."""
    data, scene_file = tmp_path / "data", small_scene(tmp_path)
    with serving(data, "--auth", "none", "--scene", str(scene_file)) as server:
        scene, url = server.scene, server.url
        ready = threading.Barrier(8)

        def at_once(_: int) -> tuple[int, bytes]:
            ready.wait()
            return sent(url, scene, "same")

        with ThreadPoolExecutor(8) as clients:
            answers = set(clients.map(at_once, range(8)))
        assert len(answers) == 1, "clients that asked at once were told different things"
        first = {f"k{n}": sent(url, scene, f"k{n}") for n in range(4)}
        first["same"] = answers.pop()
        assert {status for status, _ in first.values()} == {200}
        for number in server.children:
            os.kill(number, signal.SIGSTOP)
        left = server.children
        server.kill()
    try:
        with serving(data, "--auth", "none") as server:  # though children of the killed one live
            assert {key: sent(server.url, scene, key) for key in first} == first
            assert len(server.found()) == len(first)
            server.stop()
    finally:
        for number in left:
            os.kill(number, signal.SIGKILL)
    assert still_there(left) == []
    (data / "config.toml").write_text("answers_max = 2\n")
    with serving(data, "--auth", "none") as server:
        assert sent(server.url, scene, "k3") == first["k3"], "one of the newest two"
        assert sent(server.url, scene, "same") != first["same"], "outside the window it is new"
        orders: dict[str, Any] = server.found()
        assert len(orders) == len(first) + 1
        server.stop()
