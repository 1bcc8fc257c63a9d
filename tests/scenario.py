"""Decisions told as stories: `given(*events).when(command).then(*events)`, or what came instead."""

from collections.abc import Iterable

import msgspec

from commands.command import Decision
from commands.decide import AnyCommand, decide, decide_proposal
from commands.rejected import Reason, Rejected
from ledger.events import AnyEvent, stamped
from ledger.evolve import evolve
from ledger.ids import CommandId
from ledger.proposals import AnyProposal, Proposal
from ledger.state import Fleet

STORY_MS = 1_754_467_200_000  # 2025-08-06 08:00 UTC, when everything given happens


def happened(events: Iterable[AnyEvent], fleet: Fleet | None = None) -> Fleet:
    """Fold events after giving them the headers that they lack."""
    fleet = fleet or Fleet()
    for event in events:
        at_ms = event.at_ms or max(fleet.at_ms, STORY_MS)
        evolve(fleet, stamped(event, fleet.position + 1, at_ms, event.by or "given", CommandId("")))
    return fleet


class Outcome:
    """What a decision came to."""

    def __init__(self, fleet: Fleet, decision: Decision | Rejected) -> None:
        self.fleet = fleet
        self.decision = decision

    def then(self, *events: AnyEvent) -> Fleet:
        """Exactly these events; gives the state after them."""
        assert isinstance(self.decision, Decision), self.decision
        assert self.decision.events == events
        return happened(events, self.fleet)

    def nothing(self) -> None:
        """Accepted, and nothing happened."""
        self.then()

    def rejected(self, reason: Reason, *words: str) -> None:
        """Refused for this reason, in words that hold these."""
        assert isinstance(self.decision, Rejected), "accepted"
        assert self.decision.reason is reason, self.decision
        for word in words:
            assert word in self.decision.message

    def refused(self, **entries: Reason) -> "Outcome":
        """Exactly these entries of a batch were refused."""
        assert isinstance(self.decision, Decision), self.decision
        found = {key: no.reason for key, no in self.decision.refused.items()}
        assert found == {key.replace("__", "-"): reason for key, reason in entries.items()}
        return self


class Given:
    """A state that events led to."""

    def __init__(self, *events: AnyEvent) -> None:
        self.fleet = happened(events)

    def when(self, asked: AnyCommand | AnyProposal) -> Outcome:
        """Decide; the state itself must not change by that."""
        before = self.fleet.canonical()
        try:
            decision = self._decide(asked)
        except Rejected as no:
            decision = no
        assert self.fleet.canonical() == before
        return Outcome(self.fleet, decision)

    def _decide(self, asked: AnyCommand | AnyProposal) -> Decision | Rejected:
        if isinstance(asked, Proposal):
            return Decision(events=decide_proposal(self.fleet, asked, STORY_MS))
        return decide(self.fleet, asked)


given = Given


def ask(kind: type[msgspec.Struct], **fields: object) -> AnyCommand:
    """Make a command of the story's time."""
    command = kind(id=CommandId("c"), by="alice", at_ms=STORY_MS, **fields)
    assert isinstance(command, AnyCommand)
    return command
