"""The dispatch phases in their fixed order; each sees what the ones before it have proposed."""

from collections.abc import Callable
from typing import TypeAlias

from ledger.proposals import AnyProposal
from scheduler.dispatch.assign import assign
from scheduler.dispatch.charge import charge
from scheduler.dispatch.continue_ import continue_
from scheduler.dispatch.park import avoid, park
from scheduler.dispatch.withdraw import withdraw
from scheduler.view import View

# (state and reports, proposals so far, now) -> further proposals
Phase: TypeAlias = Callable[[View, tuple[AnyProposal, ...], int], list[AnyProposal]]

QUICK: tuple[Phase, ...] = (withdraw, continue_)  # cheap: every tick
ALL: tuple[Phase, ...] = (*QUICK, assign, charge, park, avoid)


def dispatch(view: View, now_ms: int, phases: tuple[Phase, ...] = ALL) -> tuple[AnyProposal, ...]:
    """Propose what should happen next in one scene. The same view gives the same proposals."""
    proposals: tuple[AnyProposal, ...] = ()
    for phase in phases:
        proposals += tuple(phase(view, proposals, now_ms))
    return proposals
