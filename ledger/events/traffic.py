"""Events of traffic: sums over a stretch of time, for each move of each robot would be too much."""

from typing import TypeAlias

from ledger.events.base import Event
from ledger.waits import CycleSeen, WaitSum


class RobotsWaited(Event, frozen=True, kw_only=True):
    """What robots have waited for since a moment, summed up by the scheduler; moments themselves
    are in the telemetry log, for days.
    """

    from_ms: int
    waits: tuple[WaitSum, ...]  # the longest in all first; those that are left out are short
    left_out_ms: int = 0
    cycles: tuple[CycleSeen, ...] = ()
    pushes: int = 0  # robots sent out of the way of others
    plannings: dict[str, int] = {}  # by what made them due


TrafficEvent: TypeAlias = RobotsWaited
