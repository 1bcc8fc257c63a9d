"""The shell around `decide`: newest state in, events to the ledger, newest state out.

One command after another, whoever calls: HTTP's thread, or the bus's with proposals.
The state here is ahead of the disk; nobody may be told of it before `Decision.position` is durable.
"""

import threading
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import msgspec

from commands.command import Command, Decision, Events
from commands.decide import AnyCommand, decide, decide_proposal
from commands.rejected import Reason, Rejected
from ledger.events import AnyEvent, CommandAnswered, stamped
from ledger.evolve import evolve
from ledger.evolve_answers import answer_to
from ledger.ids import CommandId, SceneId
from ledger.proposals import AnyProposal
from ledger.scene import Value
from ledger.state import Answer, Fleet

SCHEDULER = "scheduler"  # the author of what proposals lead to


class Appends(Protocol):
    """What of a ledger is needed here."""

    def append(self, events: Sequence[AnyEvent], expected: int) -> int:
        """Put stamped events behind position `expected`; raises LedgerError, also without any."""


class Reply(Value, frozen=True, kw_only=True):
    """An answer in the words of a dialect."""

    status: int  # of HTTP
    body: str


class Answered(Value, frozen=True, kw_only=True):
    """A reply, and the position that must be durable before it may be given."""

    reply: Reply
    position: int


class Proposed(Value, frozen=True, kw_only=True):
    """What became of proposals."""

    position: int  # of the newest event they rest on or state
    refused: tuple[str | None, ...]  # for each proposal the code of its refusal; None = accepted
    events: tuple[AnyEvent, ...]  # what the accepted ones led to, in order


class Handler:
    """Holds the newest state and is the only one who appends."""

    def __init__(
        self,
        fleet: Fleet,
        ledger: Appends,
        now_ms: Callable[[], int],
        new_id: Callable[[], str],
    ) -> None:
        """Take the state as of the ledger's newest position; ids have 24 hexadecimal digits."""
        self.fleet = fleet
        self.now_ms = now_ms
        self.new_id = new_id
        self._ledger = ledger
        self._lock = threading.RLock()

    def handle(self, command: AnyCommand) -> Decision:
        """Decide and append; raises Rejected or LedgerError, and then nothing has happened."""
        with self._lock:
            command = self._not_before_the_newest(command)
            decision = decide(self.fleet, command)
            events = self._append(decision.events, command)
            return msgspec.structs.replace(decision, events=events, position=self.fleet.position)

    def consider(self, command: AnyCommand) -> Decision:
        """Decide as `handle` would just now, and do nothing; raises Rejected or LedgerError.

        For what has to be kept elsewhere before the ledger tells of it.
        """
        with self._lock:
            decision = decide(self.fleet, self._not_before_the_newest(command))
            self._ledger.append((), self.fleet.position)
            return decision

    def handle_once(
        self,
        command: AnyCommand,
        digest: str,
        answer: Callable[[Decision | Rejected], Reply],
    ) -> Answered:
        """Do the same, but give a repeated command the first answer, a refusal included.

        Repeated is what comes within the window of answers; later it is a new command.

        The command's id is the caller's Idempotency-Key, the digest tells requests apart. The
        answer is appended with the events, so either both are kept or neither. The position of a
        repeated answer covers the first one's events, which may still be on their way to disk.
        """
        with self._lock:
            known = self.answered(command.id, digest)
            if known is not None:
                reply = Reply(status=known.status, body=known.body)
                return Answered(reply=reply, position=self.fleet.position)
            command = self._not_before_the_newest(command)
            outcome: Decision | Rejected
            events: Events = ()
            try:
                outcome = decide(self.fleet, command)
                events = outcome.events
            except Rejected as no:
                outcome = no
            reply = answer(outcome)
            scene = events[0].scene if events else getattr(command, "scene", SceneId(""))
            kept = CommandAnswered(scene=scene, digest=digest, status=reply.status, body=reply.body)
            self._append((*events, kept), command)
            return Answered(reply=reply, position=self.fleet.position)

    def answered(self, key: CommandId, digest: str) -> Answer | None:
        """Find the answer that this key got; refuse a key that came with another request."""
        known = self.answer_of(key)
        if known is not None and known.digest != digest:
            message = "Header 'Idempotency-Key' was used for another request."
            raise Rejected(Reason.KEY_REUSED, message)
        return known

    def answer_of(self, key: CommandId) -> Answer | None:
        """Find the answer that this key got within the window of answers."""
        return answer_to(self.fleet, key, max(self.now_ms(), self.fleet.at_ms))

    def propose(self, proposals: Iterable[AnyProposal]) -> Proposed:
        """Decide each on the state that the ones before it left, and append what came of it.

        Raises LedgerError where one cannot be appended; those before it stand, and whoever proposed
        hears of them by the feed.
        """
        with self._lock:
            at_ms = max(self.now_ms(), self.fleet.at_ms)
            command = Command(id=CommandId(self.new_id()), by=SCHEDULER, at_ms=at_ms)
            refused: list[str | None] = []
            events: list[AnyEvent] = []
            for proposal in proposals:
                try:
                    accepted = decide_proposal(self.fleet, proposal, at_ms)
                except Rejected as no:
                    refused.append(no.code)
                    continue
                refused.append(None)
                events += self._append(accepted, command)
            return Proposed(
                position=self.fleet.position, refused=tuple(refused), events=tuple(events)
            )

    def fall_back(self, fleet: Fleet) -> None:
        """Stand on what is on disk once the ledger has failed: it takes nothing more from here."""
        with self._lock:
            self.fleet = fleet

    def _not_before_the_newest(self, command: AnyCommand) -> AnyCommand:
        """Keep the instants of the ledger in order, whatever clock the command came from."""
        if command.at_ms >= self.fleet.at_ms:
            return command
        return msgspec.structs.replace(command, at_ms=self.fleet.at_ms)

    def _append(self, events: Events, command: Command) -> tuple[AnyEvent, ...]:
        ready = _stamped(events, command, self.fleet)
        self._append_stamped(ready)
        return tuple(ready)

    def _append_stamped(self, events: Sequence[AnyEvent]) -> None:
        if not events:
            return
        self._ledger.append(events, self.fleet.position)
        for event in events:
            evolve(self.fleet, event)


def _stamped(events: Events, command: Command, fleet: Fleet) -> list[AnyEvent]:
    return [
        stamped(event, position, command.at_ms, command.by, command.id)
        for position, event in enumerate(events, fleet.position + 1)
    ]
