"""The past as a film: what the ledger and the telemetry log say, brought to common instants."""

from collections.abc import Iterator
from typing import Generic, TypeVar

from ledger.events import AnyEvent
from ledger.evolve import evolve
from ledger.ids import RobotName
from ledger.link import Plan, Report
from ledger.state import Fleet

T = TypeVar("T")


class Picture:
    """Everything at one instant. The next picture goes on in the same fleet and dictionaries."""

    def __init__(
        self, fleet: Fleet, reports: dict[RobotName, Report], plans: dict[RobotName, Plan]
    ) -> None:
        """Take what was known before the first instant."""
        self.at_ms = 0
        self.fleet, self.reports, self.plans = fleet, reports, plans
        self.events: list[AnyEvent] = []  # since the last picture
        self.changed = True  # does anything differ from the last picture


class _Ahead(Generic[T]):
    """An iterator that can be looked into."""

    def __init__(self, items: Iterator[tuple[int, T]]) -> None:
        self._items = items
        self._next = next(items, None)

    def until(self, at_ms: int) -> Iterator[T]:
        """Take what happened up to an instant."""
        while self._next is not None and self._next[0] <= at_ms:
            yield self._next[1]
            self._next = next(self._items, None)


def film(
    first: Picture,
    events: Iterator[AnyEvent],
    reports: Iterator[Report],
    plans: Iterator[Plan],
    from_ms: int,
    to_ms: int,
    step_ms: int,
) -> Iterator[Picture]:
    """Give the same picture again and again, a step later each time; take what is needed at once.

    The last picture is at `to_ms` exactly.
    """
    happened = _Ahead((e.at_ms, e) for e in events)
    reported = _Ahead((r.at_ms, r) for r in reports)
    planned = _Ahead((p.at_ms, p) for p in plans)
    picture, at_ms = first, from_ms
    while True:
        picture.at_ms = at_ms
        picture.events = list(happened.until(at_ms))
        for event in picture.events:
            evolve(picture.fleet, event)
        changed = bool(picture.events) or at_ms == from_ms
        for report in reported.until(at_ms):
            picture.reports[report.robot] = report
            changed = True
        for plan in planned.until(at_ms):
            picture.plans[plan.robot] = plan
            changed = True
        picture.changed = changed
        yield picture
        if at_ms >= to_ms:
            return
        at_ms = min(at_ms + step_ms, to_ms)
