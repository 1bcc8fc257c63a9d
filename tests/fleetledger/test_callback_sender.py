import threading
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import pytest

from fleetledger.callback_post import NO_SECRET, Post
from fleetledger.callback_sender import SENDING_MAX, Sender, host_of
from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.events import AnyEvent, CallbacksConfigured
from ledger.ids import OrderId, SceneId
from ledger.store import MemoryLedger
from projections.callbacks import Callback
from projections.outbox import Outbox
from tests.fleetledger.receiver import (
    ACCEPT,
    DROP,
    HANG,
    HOLD,
    NONSENSE,
    REFUSE,
    SEND_ELSEWHERE,
    SLOWLY,
    Got,
    Moody,
    Receiver,
    is_signed,
    no_step_back,
)
from tests.projections.told import OPENED, expected, fleet_at, told_history

SECRET = "0123456789abcdef"
WALL_MS = 1_800_000_000_000
TRY_S = 30.0  # on a busy machine
HANGING_S = 0.2  # so soon those are left who hang
WAIT_S = 60.0
NOTES_MAX = 10_000


class Desk:
    """Outbox and sender as the core has them, over a ledger in memory."""

    def __init__(
        self,
        path: Path,
        ledger: MemoryLedger,
        secret: str | None = SECRET,
        seed: int = 1,
        try_s: float = TRY_S,
    ) -> None:
        self.secret = secret
        self.wanted = True
        self.given_up: list[Callback] = []
        self._changed = threading.Condition()
        connect = partial(Post, self._secret, lambda: WALL_MS, try_s)
        self.sender = Sender(connect, self._give_up, lambda _: self.wanted, Random(seed))
        self.outbox = Outbox(path, self.sender.hear)
        self.ledger = ledger
        ledger.listen(self.outbox.follow)
        self.sender.start(self.outbox)
        events = list(ledger.read(0))
        self.outbox.start(
            ledger.read,
            lambda position: fleet_at(list(ledger.read(0)), position),
            fleet_at(events, len(events)),
        )

    def _secret(self, scene: SceneId) -> str | None:
        return self.secret

    def _give_up(self, callback: Callback) -> None:
        with self._changed:
            self.given_up.append(callback)
            self._changed.notify_all()

    def until_given_up(self, count: int) -> list[Callback]:
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.given_up) >= count, WAIT_S)
            return list(self.given_up)

    def append(self, events: Sequence[AnyEvent]) -> None:
        for event in events:
            self.ledger.append([event], event.position - 1)

    def close(self) -> None:
        self.sender.ask_to_stop()
        self.sender.join()
        self.outbox.close()


@contextmanager
def desk(path: Path, ledger: MemoryLedger | None = None, **options: Any) -> Iterator[Desk]:
    made = Desk(path, ledger or MemoryLedger(), **options)
    try:
        yield made
    finally:
        made.close()


def noted(made: Desk, enough: Callable[[list[Callback]], bool]) -> None:
    """Wait for what the outbox has noted, by letting it note something else behind it."""
    for _ in range(NOTES_MAX):
        if enough(made.outbox.waiting()):
            return
        made.outbox.settle(0).result(WAIT_S)
    raise AssertionError(made.outbox.waiting()[:3])


def config(*urls: str, **fields: Any) -> CallbackConfig:
    return CallbackConfig(
        enabled=True, urls=urls, **({"retries_max": 10_000, "retry_s": 0.001} | fields)
    )


def history_of(seed: int, settings: CallbackConfig, count: int = 120) -> list[AnyEvent]:
    """A history whose settings change no more."""
    events = told_history(seed, count, {OPENED: settings})
    kept = [e for e in events if not isinstance(e, CallbacksConfigured) or e.callbacks == settings]
    return [msgspec.structs.replace(e, position=n) for n, e in enumerate(kept, 1)]


Story = dict[tuple[str, str], list[tuple[str, int]]]  # path and order: states and positions


def story(got: Sequence[Got]) -> Story:
    """What came in for each address and order, repetitions left out."""
    told: Story = defaultdict(list)
    for one in got:
        lane = told[one.path, one.body["orderId"]]
        word = (one.body["status"], one.body["position"])
        if word not in lane:
            lane.append(word)
    return dict(told)


def due(events: Sequence[AnyEvent], receiver: Receiver) -> Story:
    told: Story = defaultdict(list)
    for one in expected(events):
        path = one.url.removeprefix(receiver.url(""))
        told[path, one.order].append((one.status.value, one.position))
    return dict(told)


def whole(events: Sequence[AnyEvent], receiver: Receiver) -> None:
    """Wait until all was accepted for certain, and compare with what was due."""
    count = len(list(expected(events)))
    receiver.until(
        lambda got: len({o.body["id"] for o in got if o.answer in (ACCEPT, SLOWLY)}) >= count
    )
    assert story(receiver.got) == due(events, receiver)


@pytest.mark.parametrize("seed", range(4))
def test_however_unreliable_a_receiver_is_it_hears_all_in_order(tmp_path: Path, seed: int) -> None:
    answers = [ACCEPT] * 6 + [REFUSE, REFUSE, DROP, NONSENSE, SEND_ELSEWHERE]
    behave = Moody(Random(seed), *answers, rare=(HANG, SLOWLY))
    with (
        Receiver(behave) as receiver,
        desk(tmp_path / "outbox.sqlite", seed=seed, try_s=HANGING_S) as made,
    ):
        events = history_of(seed, config(receiver.url("/a"), receiver.url("/b")))
        made.append(events)
        whole(events, receiver)
        no_step_back(receiver.got)
        assert all(is_signed(one, SECRET) for one in receiver.got)
        assert {one.headers["x-fleetledger-timestamp"] for one in receiver.got} == {str(WALL_MS)}
        assert all(one.headers["x-fleetledger-id"] == one.body["id"] for one in receiver.got)
        bodies: dict[str, bytes] = {}
        for one in receiver.got:
            assert bodies.setdefault(one.body["id"], one.raw) == one.raw
    assert made.given_up == []
    assert "/elsewhere" not in {one.path for one in receiver.got}


def test_over_restarts_nothing_is_missed(tmp_path: Path) -> None:
    ledger = MemoryLedger()
    with Receiver(Moody(Random(5), ACCEPT, REFUSE, DROP)) as receiver:
        events = history_of(5, config(receiver.url("/a")))
        for start in range(0, len(events), 30):
            with desk(tmp_path / "outbox.sqlite", ledger) as made:
                made.append(events[start : start + 30])
                if start:
                    receiver.until(lambda got: bool(got))
        with desk(tmp_path / "outbox.sqlite", ledger):
            whole(events, receiver)


def test_an_address_gets_so_many_at_once_and_no_more(tmp_path: Path) -> None:
    with Receiver(lambda _: HOLD) as receiver, desk(tmp_path / "outbox.sqlite") as made:
        events = history_of(11, config(receiver.url()), 250)
        made.append(events)
        all_of_it = list(expected(events))
        assert len({one.order for one in all_of_it}) > SENDING_MAX
        receiver.until(lambda got: len(got) == SENDING_MAX)
        receiver.let_go()
        receiver.until(lambda got: len(got) == len(all_of_it))
        assert receiver.at_once_max == SENDING_MAX


def test_what_is_never_accepted_is_given_up_and_the_next_one_goes(tmp_path: Path) -> None:
    def behave(body: dict[str, Any]) -> bytes:
        return REFUSE if body["status"] == "Allocated" else ACCEPT

    with Receiver(behave) as receiver, desk(tmp_path / "outbox.sqlite") as made:
        events = history_of(6, config(receiver.url("/a"), retries_max=2))
        made.append(events)
        all_of_it = list(expected(events))
        count = sum(one.status is CallbackStatus.ALLOCATED for one in all_of_it)
        assert count > 3
        given_up = made.until_given_up(count)
        receiver.until(lambda got: len({o.body["id"] for o in got}) == len(all_of_it))
        assert story(receiver.got) == due(events, receiver)
    assert {c.status for c in given_up} == {CallbackStatus.ALLOCATED}
    assert {(c.tries, c.error) for c in given_up} == {(3, "HTTP 500")}
    assert len({c.id for c in given_up}) == count
    tries = [one.body["id"] for one in receiver.got]
    assert all(tries.count(callback.id) == 3 for callback in given_up)


def test_what_an_address_missed_before_it_was_taken_out_is_tried_once_more(tmp_path: Path) -> None:
    with Receiver(lambda _: REFUSE) as receiver, desk(tmp_path / "outbox.sqlite") as made:
        events = history_of(12, config(receiver.url()), 40)
        made.append(events)
        receiver.until(lambda got: len(got) > 20)
        assert made.given_up == []
        made.wanted = False
        given_up = made.until_given_up(len(list(expected(events))))
    assert {callback.error for callback in given_up} == {"HTTP 500"}


def test_an_order_that_cannot_be_told_of_holds_up_no_other(tmp_path: Path) -> None:
    with Receiver(lambda body: REFUSE if body["orderId"] == stuck else ACCEPT) as receiver:
        events = history_of(7, config(receiver.url("/a")))
        by_order: dict[OrderId, int] = defaultdict(int)
        for one in expected(events):
            by_order[one.order] += 1
        stuck = next(iter(by_order))
        others = sum(by_order.values()) - by_order[stuck]
        with desk(tmp_path / "outbox.sqlite") as made:
            made.append(events)
            receiver.until(
                lambda got: len({o.body["id"] for o in got if o.answer == ACCEPT}) == others
            )
            receiver.until(lambda got: sum(o.body["orderId"] == stuck for o in got) > 3)
            noted(made, lambda waiting: {c.order for c in waiting} == {stuck})
            assert len({o.body["id"] for o in receiver.got if o.body["orderId"] == stuck}) == 1


def test_nobody_at_the_address_is_a_try_that_failed(tmp_path: Path) -> None:
    with Receiver() as gone:
        pass
    with desk(tmp_path / "outbox.sqlite") as made:
        events = history_of(8, config(gone.url(), "http://[::1/", retries_max=1), 30)
        made.append(events)
        given_up = made.until_given_up(len(list(expected(events))))
    assert {c.url for c in given_up} == {gone.url(), "http://[::1/"}
    assert all(c.tries == 2 for c in given_up)
    assert any("ConnectError" in c.error for c in given_up)


def test_nothing_goes_unsigned_and_waiting_for_a_secret_is_no_try(tmp_path: Path) -> None:
    with Receiver() as receiver, desk(tmp_path / "outbox.sqlite", secret=None) as made:
        events = history_of(9, config(receiver.url(), retries_max=0), 30)
        made.append(events)
        noted(made, lambda waiting: any(callback.error for callback in waiting))
        assert {(c.tries, c.error) for c in made.outbox.waiting() if c.error} == {(0, NO_SECRET)}
        assert receiver.got == []
        made.secret = SECRET
        whole(events, receiver)
    assert made.given_up == []


def test_what_was_accepted_waits_no_more(tmp_path: Path) -> None:
    with Receiver() as receiver:
        events = history_of(10, config(receiver.url()))
        with desk(tmp_path / "outbox.sqlite") as made:
            made.append(events)
            whole(events, receiver)
        with desk(tmp_path / "outbox.sqlite", made.ledger) as again:
            assert again.outbox.waiting() == []
    assert len(receiver.got) == len(list(expected(events))), "each came once"


def test_of_an_address_only_the_host_is_logged() -> None:
    assert host_of("https://wms.example:8443/hook?token=abc") == "wms.example"
    assert host_of("http://[::1/") == ""
