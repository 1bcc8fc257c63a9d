"""The zenoh bus on loopback: what MemoryBus promises, between sessions and processes."""

import queue
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from ledger.zenoh_bus import LOOPBACK, ZenohBus

WAIT_S = 10.0


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{LOOPBACK}:{probe.getsockname()[1]}"


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture
def core(endpoint: str) -> Iterator[ZenohBus]:
    bus = ZenohBus(endpoint)
    yield bus
    bus.close()


@pytest.fixture
def other(endpoint: str, core: ZenohBus) -> Iterator[ZenohBus]:
    bus = ZenohBus(None, [endpoint])
    # a subscription that has been heard of proves that the sessions know each other
    seen: queue.Queue[str] = queue.Queue()
    core.watch("ready", lambda key, alive: seen.put(key))
    bus.live("ready")
    assert seen.get(timeout=WAIT_S) == "ready"
    yield bus
    bus.close()


def test_a_message_reaches_the_subscribers_of_another_session(
    core: ZenohBus, other: ZenohBus
) -> None:
    got: queue.Queue[tuple[str, bytes]] = queue.Queue()
    other.subscribe("scenes/S/robots/*/tell", lambda key, payload: got.put((key, payload)))
    other.respond("subscribed", lambda question: [b"yes"])
    assert core.ask("subscribed") == [b"yes"]
    core.publish("scenes/S/robots/R 1#?*/tell", b"go")
    assert got.get(timeout=WAIT_S) == ("scenes/S/robots/R 1#?*/tell", b"go")


def test_messages_that_wait_for_slow_readers_arrive_all_and_in_order(
    core: ZenohBus, other: ZenohBus
) -> None:
    got: queue.Queue[bytes] = queue.Queue()
    other.subscribe("fleet/all", lambda key, payload: got.put(payload))
    other.respond("subscribed", lambda question: [b"yes"])
    assert core.ask("subscribed") == [b"yes"]
    sent = [str(n).encode() * 50 for n in range(5_000)]
    for payload in sent:
        core.publish("fleet/all", payload)
    assert [got.get(timeout=WAIT_S) for _ in sent] == sent


def test_all_answers_to_a_question_arrive_in_order(core: ZenohBus, other: ZenohBus) -> None:
    core.respond("many", lambda question: (question + str(n).encode() for n in range(300)))
    assert other.ask("many", b"n") == [b"n" + str(n).encode() for n in range(300)]


def test_nobody_to_answer_is_a_timeout(core: ZenohBus, other: ZenohBus) -> None:
    with pytest.raises(TimeoutError, match="nobody"):
        other.ask("nobody/answers/this", timeout_s=1.0)


def test_an_answer_that_fails_is_a_timeout(core: ZenohBus, other: ZenohBus) -> None:
    def fails(question: bytes) -> Iterator[bytes]:
        yield b"one"
        raise ValueError("and no more")

    core.respond("fails", fails)
    with pytest.raises(TimeoutError, match="and no more"):
        other.ask("fails")


def test_tokens_are_told_to_early_and_late_watchers(core: ZenohBus, other: ZenohBus) -> None:
    early: queue.Queue[tuple[str, bool]] = queue.Queue()
    late: queue.Queue[tuple[str, bool]] = queue.Queue()
    core.watch("scenes/S/robots/*/alive", lambda key, alive: early.put((key, alive)))
    let_go = other.live("scenes/S/robots/R1/alive")
    assert early.get(timeout=WAIT_S) == ("scenes/S/robots/R1/alive", True)
    core.watch("scenes/S/robots/*/alive", lambda key, alive: late.put((key, alive)))
    assert late.get(timeout=WAIT_S) == ("scenes/S/robots/R1/alive", True)
    let_go()
    let_go()
    assert early.get(timeout=WAIT_S) == ("scenes/S/robots/R1/alive", False)
    assert late.get(timeout=WAIT_S) == ("scenes/S/robots/R1/alive", False)


HOLDER = """
import sys
from ledger.zenoh_bus import ZenohBus
bus = ZenohBus(None, [sys.argv[1]])
bus.live("scenes/S/robots/R1/alive")
sys.stdin.read()
"""


def test_the_token_of_a_killed_process_vanishes(core: ZenohBus, endpoint: str) -> None:
    seen: queue.Queue[tuple[str, bool]] = queue.Queue()
    core.watch("scenes/S/robots/*/alive", lambda key, alive: seen.put((key, alive)))
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, endpoint], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL
    )
    try:
        assert seen.get(timeout=3 * WAIT_S) == ("scenes/S/robots/R1/alive", True)
        holder.send_signal(signal.SIGKILL)
        assert seen.get(timeout=3 * WAIT_S) == ("scenes/S/robots/R1/alive", False)
    finally:
        holder.kill()
        holder.communicate()


def test_a_closed_bus_lets_its_tokens_go(core: ZenohBus, other: ZenohBus) -> None:
    seen: queue.Queue[tuple[str, bool]] = queue.Queue()
    core.watch("a/token", lambda key, alive: seen.put((key, alive)))
    other.live("a/token")
    assert seen.get(timeout=WAIT_S) == ("a/token", True)
    other.close()
    other.close()
    assert seen.get(timeout=WAIT_S) == ("a/token", False)


def test_a_taken_endpoint_is_refused(core: ZenohBus, endpoint: str) -> None:
    with pytest.raises(Exception, match=r"(?i)address|listen|bind|use"):
        ZenohBus(endpoint)


def test_processes_may_start_in_any_order(endpoint: str) -> None:
    early = ZenohBus(None, [endpoint])
    try:
        early.live("early/token")
        seen: queue.Queue[tuple[str, bool]] = queue.Queue()
        late = ZenohBus(endpoint)
        try:
            late.watch("early/*", lambda key, alive: seen.put((key, alive)))
            assert seen.get(timeout=WAIT_S) == ("early/token", True)
        finally:
            late.close()
    finally:
        early.close()


def test_a_question_waits_for_somebody_to_answer_it(core: ZenohBus, other: ZenohBus) -> None:
    answers: queue.Queue[list[bytes]] = queue.Queue()
    asking = threading.Thread(target=lambda: answers.put(other.ask("late", timeout_s=WAIT_S)))
    asking.start()
    core.respond("late", lambda question: [b"here"])
    assert answers.get(timeout=WAIT_S) == [b"here"]
    asking.join()


def test_who_has_left_talks_to_nobody(endpoint: str) -> None:
    bus = ZenohBus(endpoint)
    bus.publish("fleet/events", b"[]")
    bus.close()
    bus.publish("fleet/events", b"[]")  # a decision may still be on its way to the disk
