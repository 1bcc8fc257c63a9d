"""A proposal that changed nothing is not repeated at once, nor as often as before."""

from collections.abc import Sequence
from typing import TypeAlias

from ledger.evolve_resources import device_key
from ledger.ids import robot_key
from ledger.link import InstructionKind
from ledger.proposals import (
    AnyProposal,
    AssignOrder,
    ConnectRobot,
    CreateSystemOrder,
    DisconnectRobot,
    FaultDevice,
    GiveUpRobot,
    GrantMapResources,
    LiftStop,
    NoteWaits,
    RecoverDevice,
    StopRobot,
)
from ledger.state import Fleet

FIRST_MS = 1_000
LONGEST_MS = 30_000
REMEMBERED_MAX = 10_000

Subject: TypeAlias = tuple[
    str, str, str, int
]  # what, of which order, with which robot, in which state


class Backoff:
    """Remembers proposals by what they were about and the state that it was in."""

    def __init__(self) -> None:
        self._until: dict[Subject, tuple[int, int]] = {}  # when again, and the pause after that

    def fit(self, fleet: Fleet, proposals: Sequence[AnyProposal], now_ms: int) -> list[AnyProposal]:
        """Give those that are new, or may be tried again; they count as tried from now on.

        If one is accepted its subject changes, so whatever comes up next is new.
        """
        fit: list[AnyProposal] = []
        for proposal in proposals:
            subject = _subject(fleet, proposal)
            until_ms, pause_ms = self._until.pop(subject, (now_ms, FIRST_MS))
            if now_ms < until_ms:
                self._until[subject] = (until_ms, pause_ms)
                continue
            fit.append(proposal)
            self._until[subject] = (now_ms + pause_ms, min(2 * pause_ms, LONGEST_MS))
        while len(self._until) > REMEMBERED_MAX:  # the least lately tried first
            del self._until[next(iter(self._until))]
        return fit


def _subject(fleet: Fleet, proposal: AnyProposal) -> Subject:
    what = type(proposal).__name__
    if isinstance(proposal, ConnectRobot | DisconnectRobot | CreateSystemOrder | GiveUpRobot):
        robot = fleet.robots.get(robot_key(proposal.scene, proposal.robot))
        state = 0 if robot is None else robot.idle_since_ms + robot.online
        return (what, proposal.scene, proposal.robot, state)
    if isinstance(proposal, StopRobot | LiftStop):
        robot = fleet.robots.get(robot_key(proposal.scene, proposal.robot))
        told = None if robot is None else robot.told(InstructionKind.SOFT_STOP)
        return (what, proposal.scene, proposal.robot, 0 if told is None else told.number)
    if isinstance(proposal, FaultDevice | RecoverDevice):
        fault = fleet.device_faults.get(device_key(proposal.scene, proposal.kind, proposal.device))
        device = f"{proposal.kind}/{proposal.device}"
        return (what, proposal.scene, device, 0 if fault is None else fault.at_ms)
    if isinstance(proposal, GrantMapResources):
        claims = (fleet.claims.get(unit) for unit in proposal.units)
        return (
            what,
            proposal.scene,
            " ".join(sorted(proposal.units)),
            sum(c.at_ms for c in claims if c),
        )
    if isinstance(proposal, NoteWaits):
        return (what, proposal.scene, "", proposal.from_ms)
    order = fleet.orders.get(proposal.order)
    named = proposal.robot if isinstance(proposal, AssignOrder) else ""
    return (what, proposal.order, named, -1 if order is None else order.version)
