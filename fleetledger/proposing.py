"""The core's ear for the scheduler: proposals in, what became of them out, all on disk."""

from collections.abc import Callable, Iterable

import msgspec

from commands.handle import Handler
from ledger.errors import LedgerError, Unknown
from ledger.proposals import AnyProposal
from ledger.scene import Value
from ledger.store import Ledger

WAIT_S = 10.0  # for the disk; who waits longer is told that nobody knows


class ProposalRefused(Value, frozen=True, kw_only=True):
    """A proposal that did not fit the newest state."""

    index: int
    code: str


class ProposalsAnswer(Value, frozen=True, kw_only=True):
    """The core's answer to a batch of proposals."""

    position: int  # the events up to here are on disk, and on their way to all who follow
    refused: tuple[ProposalRefused, ...] = ()
    unavailable: str = ""  # why the ledger takes nothing now: none of the batch was accepted


_proposals = msgspec.json.Decoder(list[AnyProposal])


def responder(handler: Handler, ledger: Ledger) -> Callable[[bytes], Iterable[bytes]]:
    """Give the bus's answer to `fleet/propose`; it runs on the bus's thread and may wait there."""

    def respond(question: bytes) -> Iterable[bytes]:
        try:
            outcome = handler.propose(_proposals.decode(question))
            if not ledger.wait(outcome.position, WAIT_S):
                raise Unknown(f"position {outcome.position} did not reach the disk in {WAIT_S} s")
        except LedgerError as trouble:  # it proposes again, and the fleet waits where it is
            none = ProposalsAnswer(position=ledger.durable, unavailable=str(trouble))
            return (msgspec.json.encode(none),)
        refused = (
            ProposalRefused(index=index, code=code)
            for index, code in enumerate(outcome.refused)
            if code is not None
        )
        answer = ProposalsAnswer(position=outcome.position, refused=tuple(refused))
        return (msgspec.json.encode(answer),)

    return respond
