"""Where the console and the ledger's own endpoints get what they show, live and past."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path

from ledger.events import AnyEvent
from ledger.ids import OrderId, RobotKey, RobotName, SceneId
from ledger.link import Plan, Report
from ledger.snapshot import Read
from ledger.state import Fleet, Order
from ledger.telemetry_read import plans_at, reports_at
from replay.moment import Moments
from replay.recent import Recent

Story = Callable[[OrderId], Sequence[AnyEvent]]  # all events of one order, in order
# orders of a scene that had ended before a position, newest created first, so many at most
Finished = Callable[[SceneId, int, int], Sequence[Order]]


class Source:
    """Functions and folders that the front door hands in. What it shows is on disk."""

    def __init__(
        self,
        data: Path,
        moments: Moments,
        *,
        now_ms: Callable[[], int],
        live: Callable[[], Fleet],
        comes: Callable[[int], Awaitable[bool]],
        reports: Mapping[RobotKey, Report],
        plans: Mapping[RobotKey, Plan],
        story: Story | None = None,
        finished: Finished | None = None,
    ) -> None:
        """Take them; `comes` waits some seconds for a position to be readable.

        `live` and the mappings are read on the event loop; all else in worker threads.
        Without `story` and `finished` the ledger itself is searched, as `recent` does it.
        """
        self.moments = moments
        self.now_ms, self.live, self.comes = now_ms, live, comes
        self.reports, self.plans = reports, plans
        self.read: Read = moments.read
        recent = Recent(self.read)
        self.finished: Finished = finished or recent.finished
        self.story: Story = story or (lambda order: recent.story(order, live().position))
        self._telemetry = data / "telemetry"
        self._first_ms: int | None = None

    def reports_at(self, scene: SceneId, at_ms: int) -> dict[RobotName, Report]:
        """Give what robots had last reported."""
        return reports_at(self._telemetry, scene, at_ms)

    def plans_at(self, scene: SceneId, at_ms: int) -> dict[RobotName, Plan]:
        """Give what traffic had last intended."""
        return plans_at(self._telemetry, scene, at_ms)

    def first_ms(self) -> int | None:
        """Give the time of the first event of all; None while there is none."""
        if self._first_ms is None:
            first = next(self.read(0, 1), None)
            self._first_ms = first.at_ms if first is not None else None
        return self._first_ms
