import threading
from collections.abc import Sequence
from itertools import count

import pytest

from commands.handle import Handler, Reply
from commands.orders import CancelOrder, CreateOrder
from commands.rejected import Reason, Rejected
from ledger.errors import LedgerBusy, Unknown
from ledger.events import AnyEvent, CommandAnswered, OrderCreated, stamped
from ledger.evolve import fold
from ledger.ids import CommandId, OrderId
from ledger.proposals import AssignOrder, ConnectRobot, DisconnectRobot
from ledger.state import Fleet
from ledger.store import MemoryLedger
from tests.commands.site import ORDER, R1, SCENE, SECOND, opened, task
from tests.scenario import STORY_MS, happened


class Broken:
    """A ledger whose disk has failed."""

    def append(self, events: object, expected: int) -> int:
        raise Unknown("disk is gone")


def handler(ledger: object = None, *given: AnyEvent) -> Handler:
    fleet = happened(given or opened(R1))
    ids = count(1)
    if ledger is None:
        ledger = MemoryLedger()
        ledger.append(_history(given or opened(R1)), 0)
    return Handler(fleet, ledger, lambda: STORY_MS, lambda: f"{next(ids):024X}")


def _history(events: tuple[AnyEvent, ...]) -> list[AnyEvent]:
    return [stamped(e, n, STORY_MS, "given", CommandId("")) for n, e in enumerate(events, 1)]


def create(id_: str = "c1", at_ms: int = STORY_MS, **fields: object) -> CreateOrder:
    return CreateOrder(
        id=CommandId(id_),
        by="alice",
        at_ms=at_ms,
        scene=SCENE,
        **{"tasks": (task(),), **fields},
    )


def test_what_was_decided_is_in_the_ledger_and_in_the_state() -> None:
    ledger = MemoryLedger()
    ledger.append(_history(opened(R1)), 0)
    h = handler(ledger)
    decision = h.handle(create())
    (event,) = decision.events
    assert isinstance(event, OrderCreated)
    assert (event.position, event.at_ms, event.by, event.command) == (4, STORY_MS, "alice", "c1")
    assert decision.position == ledger.position == h.fleet.position == 4
    assert fold(Fleet(), ledger.read(0)).canonical() == h.fleet.canonical()


def test_a_refusal_leaves_everything_as_it_was() -> None:
    h = handler()
    before = h.fleet.canonical()
    with pytest.raises(Rejected):
        h.handle(create(tasks=()))
    assert h.fleet.canonical() == before


def test_a_decision_that_nothing_happens_names_the_newest_position() -> None:
    h = handler()
    h.handle(create())
    cancel = CancelOrder(id=CommandId("c2"), by="alice", at_ms=STORY_MS, scene=SCENE, order=ORDER)
    assert h.handle(cancel).position == 5
    again = h.handle(cancel)
    assert (again.events, again.position) == ((), 5)


def test_the_state_is_not_ahead_of_a_failed_append() -> None:
    h = handler(Broken())
    before = h.fleet.canonical()
    with pytest.raises(Unknown):
        h.handle(create())
    with pytest.raises(Unknown):
        h.propose([DisconnectRobot(scene=SCENE, robot=R1)])
    with pytest.raises(Unknown):
        h.handle_once(create(), "digest", lambda _: Reply(status=200, body=""))
    assert h.fleet.canonical() == before


def test_instants_never_go_back() -> None:
    h = handler()
    (event,) = h.handle(create(at_ms=5)).events
    assert event.at_ms == STORY_MS


def test_each_proposal_is_decided_after_the_ones_before_it() -> None:
    ledger = MemoryLedger()
    ledger.append(_history(opened(R1)), 0)
    h = handler(ledger)
    h.handle(create("c1"))
    h.handle(create("c2"))
    assign = [
        AssignOrder(scene=SCENE, order=order, robot=R1, bin=0, cost_s=1.0)
        for order in (ORDER, SECOND)
    ]
    proposed = h.propose([*assign, ConnectRobot(scene=SCENE, robot=R1)])
    assert proposed.refused == (None, Reason.ROBOT_BIN_TAKEN.value, None)
    assert [e.position for e in proposed.events] == [6]
    assert proposed.position == h.fleet.position == ledger.position == 6
    assert proposed.events[0].by == "scheduler"
    assert fold(Fleet(), ledger.read(0)).canonical() == h.fleet.canonical()


def test_nothing_proposed_is_nothing_appended() -> None:
    h = handler()
    proposed = h.propose([])
    assert (proposed.position, proposed.refused, proposed.events) == (3, (), ())


def ok(outcome: object) -> Reply:
    if isinstance(outcome, Rejected):
        return Reply(status=400, body=outcome.code)
    return Reply(status=200, body=outcome.made)


def test_a_repeated_key_gets_the_first_answer_and_nothing_happens_twice() -> None:
    h = handler()
    first = h.handle_once(create("alice/k"), "digest", ok)
    assert first.reply == Reply(status=200, body=ORDER)
    again = h.handle_once(create("alice/k"), "digest", ok)
    assert again.reply == first.reply
    assert again.position == first.position == 5
    assert list(h.fleet.orders) == [ORDER]


def test_a_refusal_is_remembered_too() -> None:
    h = handler()
    first = h.handle_once(create("alice/k", tasks=()), "digest", ok)
    assert first.reply == Reply(status=400, body=Reason.ORDER_WITHOUT_GOAL.value)
    assert h.handle_once(create("alice/k", tasks=()), "digest", ok).reply == first.reply
    assert h.fleet.position == 4


def test_a_key_is_for_one_request_and_for_one_caller() -> None:
    h = handler()
    h.handle_once(create("alice/k"), "digest", ok)
    with pytest.raises(Rejected) as refusal:
        h.handle_once(create("alice/k"), "other", ok)
    assert refusal.value.reason is Reason.KEY_REUSED
    assert h.handle_once(create("bob/k"), "other", ok).reply.body == SECOND


def test_an_answer_is_kept_in_the_same_append_as_its_events() -> None:
    ledger = MemoryLedger()
    ledger.append(_history(opened(R1)), 0)
    heard: list[list[AnyEvent]] = []
    ledger.listen(lambda events: heard.append(list(events)))
    handler(ledger).handle_once(create("alice/k"), "digest", ok)
    ((made, kept),) = heard
    assert isinstance(made, OrderCreated)
    assert isinstance(kept, CommandAnswered)
    assert (kept.command, kept.by, kept.status, kept.body) == ("alice/k", "alice", 200, ORDER)
    assert made.order == OrderId(ORDER)


def test_callers_on_several_threads_are_served_one_after_another() -> None:
    ledger = MemoryLedger()
    ledger.append(_history(opened(R1)), 0)
    h = handler(ledger)
    disconnect, connect = (
        DisconnectRobot(scene=SCENE, robot=R1),
        ConnectRobot(scene=SCENE, robot=R1),
    )

    def ask_often() -> None:
        for n in range(100):
            h.handle(create(f"c{n}"))

    def propose_often() -> None:
        for _ in range(100):
            h.propose([disconnect, connect])

    callers = [threading.Thread(target=f) for f in (ask_often, propose_often, ask_often)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert ledger.position == h.fleet.position == 3 + 100 + 200 + 100
    assert fold(Fleet(), ledger.read(0)).canonical() == h.fleet.canonical()


def test_what_is_only_considered_does_not_happen() -> None:
    h = handler()
    before = h.fleet.canonical()
    considered = h.consider(create())
    assert h.fleet.canonical() == before
    assert considered.made == h.handle(create()).made
    with pytest.raises(Rejected):
        h.consider(create(tasks=()))


class Full(MemoryLedger):
    """A ledger that takes so many appends more."""

    def __init__(self, events: list[AnyEvent], left: int) -> None:
        super().__init__(events)
        self.left = left

    def append(self, events: Sequence[AnyEvent], expected: int) -> int:
        if not self.left:
            raise LedgerBusy("too much waits for the disk already")
        self.left -= 1
        return super().append(events, expected)


@pytest.mark.parametrize("left", [0, 1, 2])
def test_the_state_is_what_was_appended_also_where_a_batch_of_proposals_breaks_off(
    left: int,
) -> None:
    ledger = Full(_history(opened(R1)), left)
    h = handler(ledger)
    disconnect, connect = (kind(scene=SCENE, robot=R1) for kind in (DisconnectRobot, ConnectRobot))
    with pytest.raises(LedgerBusy):
        h.propose([disconnect, connect, disconnect])
    assert h.fleet.position == ledger.position == 3 + left
    assert fold(Fleet(), ledger.read(0)).canonical() == h.fleet.canonical()
