"""The guard refuses before the disk is full, and only then; proposals meanwhile end nobody."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from commands.handle import Handler, Reply
from commands.orders import CreateOrder
from fleetledger.disk_guard import DiskGuard, free_bytes
from fleetledger.proposing import ProposalsAnswer, responder
from ledger.errors import DiskFull, Unknown
from ledger.events import AnyEvent
from ledger.ids import CommandId
from ledger.proposals import AnyProposal, DisconnectRobot
from ledger.store import MemoryLedger
from tests.commands.site import R1, SCENE, opened, task
from tests.scenario import STORY_MS, happened

RESERVE = 64_000_000


class Disk:
    """Has as much room as a test says."""

    def __init__(self, free: int | None = 10 * RESERVE) -> None:
        self.free = free

    def __call__(self, folder: Path) -> int:
        if self.free is None:
            raise OSError(5, "Input/output error")
        return self.free


def guarded(disk: Disk) -> tuple[Handler, MemoryLedger, DiskGuard]:
    ledger = MemoryLedger()
    events = [
        msgspec.structs.replace(event, position=n, at_ms=STORY_MS)
        for n, event in enumerate(opened(R1), 1)
    ]
    ledger.append(events, 0)
    guard = DiskGuard(ledger, Path("ledger"), RESERVE, disk)
    return Handler(happened(opened(R1)), guard, lambda: STORY_MS, lambda: "id"), ledger, guard


def create(key: str) -> CreateOrder:
    return CreateOrder(id=CommandId(key), by="alice", at_ms=STORY_MS, scene=SCENE, tasks=(task(),))


@given(st.lists(st.one_of(st.none(), st.integers(0, 2 * RESERVE)), max_size=20))
def test_commands_are_taken_while_and_only_while_there_is_room(frees: list[int | None]) -> None:
    disk = Disk()
    handler, ledger, guard = guarded(disk)
    known = None  # the last free space that could be measured
    for n, free in enumerate(frees):
        disk.free = free
        guard.look()
        known = known if free is None else free
        before, state = ledger.position, handler.fleet.canonical()
        if known is not None and known < RESERVE:
            with pytest.raises(DiskFull, match="64 MB must stay free"):
                handler.handle_once(create(f"k{n}"), "d", lambda _: Reply(status=200, body=""))
            assert (ledger.position, handler.fleet.canonical()) == (before, state)
        else:
            handler.handle_once(create(f"k{n}"), "d", lambda _: Reply(status=200, body=""))
            assert ledger.position == before + 2


def test_a_repeated_key_is_answered_without_room() -> None:
    disk = Disk()
    handler, _, guard = guarded(disk)
    first = handler.handle_once(create("k"), "d", lambda _: Reply(status=200, body="first"))
    disk.free = 0
    guard.look()
    again = handler.handle_once(create("k"), "d", lambda _: Reply(status=200, body="second"))
    assert again.reply == first.reply


def test_a_start_without_room_says_what_to_do() -> None:
    _, _, guard = guarded(Disk(RESERVE - 1))
    with pytest.raises(DiskFull) as full:
        guard.check()
    assert "lower disk_reserve_mb" in full.value.hint


def test_free_space_is_that_of_the_folder(tmp_path: Path) -> None:
    assert free_bytes(tmp_path) >= 0


class Failed(MemoryLedger):
    """A ledger whose disk has failed."""

    def append(self, events: Sequence[AnyEvent], expected: int) -> int:
        raise Unknown("the disk is gone")


def proposed(handler: Handler, ledger: MemoryLedger) -> ProposalsAnswer:
    proposals: list[AnyProposal] = [DisconnectRobot(scene=SCENE, robot=R1)]
    (answer,) = responder(handler, ledger)(msgspec.json.encode(proposals))
    return msgspec.json.decode(answer, type=ProposalsAnswer)


def test_a_scheduler_is_told_that_nothing_is_taken_and_asks_again() -> None:
    disk = Disk(0)
    handler, ledger, guard = guarded(disk)
    guard.look()
    before = handler.fleet.canonical()
    answer = proposed(handler, ledger)
    assert "must stay free" in answer.unavailable
    assert (answer.position, handler.fleet.canonical()) == (3, before)
    disk.free = 10 * RESERVE
    guard.look()
    assert proposed(handler, ledger) == ProposalsAnswer(position=4)
    broken = Handler(happened(opened(R1)), Failed(), lambda: STORY_MS, lambda: "id")
    assert "the disk is gone" in proposed(broken, ledger).unavailable
