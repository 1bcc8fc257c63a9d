"""What a fault mix does round about the robots of a shift, by the commands that anybody may send.

Paths are closed whoever is on them, ground across lanes is reserved, vehicles that are no robots of
ours cross on ground reserved for them, and schedulers and cores die and come back.
"""

import math
import random
from collections import Counter
from collections.abc import Callable

from commands.command import Command
from commands.rejected import Rejected
from commands.resources import ReleaseMapResources, RequestMapResources, UnitAsked
from fleetledger.shift import Shift
from ledger.ids import CommandId, UnitId
from ledger.scene import XY, Area, Value
from sim.faults import FaultMix

STRANGER_MPS = 0.5
STRANGER_M = (0.8, 0.5)  # long and wide
ROOM_M = 0.1  # round it
STRANGER_S_MAX = 120.0  # it does not wait for longer
RESERVED_M_MAX = 1.5


class Stranger(Value, frozen=True, kw_only=True):
    """A vehicle that is no robot of ours: it crosses once its ground is granted, and is gone."""

    start: XY
    end: XY
    way_m: float = 0.0

    @property
    def length_m(self) -> float:
        """From where it appears to where it is gone."""
        return math.dist(self.start, self.end)

    @property
    def gone(self) -> bool:
        """It has crossed."""
        return self.way_m >= self.length_m

    def further(self, dt_s: float) -> "Stranger":
        """The same a little later."""
        return Stranger(start=self.start, end=self.end, way_m=self.way_m + STRANGER_MPS * dt_s)

    def corners(self) -> tuple[XY, ...]:
        """Where its body is."""
        return self._box(self.way_m, self.way_m, 0.0)

    def ground(self) -> tuple[XY, ...]:
        """All that it needs."""
        return self._box(0.0, self.length_m, ROOM_M)

    def _box(self, from_m: float, to_m: float, room_m: float) -> tuple[XY, ...]:
        (x, y), (to_x, to_y) = self.start, self.end
        along = (to_x - x) / self.length_m, (to_y - y) / self.length_m
        half_m, side_m = STRANGER_M[0] / 2 + room_m, STRANGER_M[1] / 2 + room_m
        ends = (from_m - half_m, -side_m), (to_m + half_m, -side_m)
        back = (to_m + half_m, side_m), (from_m - half_m, side_m)
        return tuple(
            (x + u * along[0] - v * along[1], y + u * along[1] + v * along[0])
            for u, v in (*ends, *back)
        )


class Surroundings:
    """Call `step` after each step of the shift. Deterministic by its generator of chance."""

    def __init__(self, shift: Shift, mix: FaultMix, rng: random.Random) -> None:
        self._shift = shift
        self._rng = rng
        self._kinds: dict[str, tuple[float, Callable[[], None]]] = {
            "closed": (mix.closed_per_h, lambda: self._close(mix.closed_mean_s)),
            "reserved": (mix.reserved_per_h, lambda: self._reserve(mix.reserved_mean_s)),
            "stranger": (mix.stranger_per_h, self._cross),
            "scheduler": (mix.scheduler_restarts_per_h, shift.restart_scheduler),
            "core": (mix.core_restarts_per_h, shift.restart_core),
        }
        self._due_ms: dict[str, float] = {}
        self._ends_ms: dict[UnitId, float] = {}
        self._numbers = 0
        self.strangers: dict[UnitId, Stranger] = {}
        self.happened: Counter[str] = Counter()

    @property
    def crossing(self) -> list[Stranger]:
        """Strangers that are on the floor."""
        claims = self._shift.fleet.claims
        return [s for id_, s in self.strangers.items() if id_ in claims and claims[id_].granted]

    def step(self) -> None:
        """Let it go on, end and begin."""
        now_ms = self._shift.now_ms
        claims = self._shift.fleet.claims
        for id_, stranger in self.strangers.items():
            if id_ in claims and claims[id_].granted:
                self.strangers[id_] = stranger.further(self._shift.step_ms / 1000)
                if self.strangers[id_].gone:
                    self._ends_ms[id_] = now_ms
        for id_ in [id_ for id_, end_ms in self._ends_ms.items() if now_ms >= end_ms]:
            self._release(id_)
        for kind, (per_h, happen) in self._kinds.items():
            if not per_h:
                continue
            if now_ms >= self._due_ms.get(kind, math.inf):
                self.happened[kind] += 1
                happen()
                del self._due_ms[kind]
            if kind not in self._due_ms:
                self._due_ms[kind] = now_ms + self._rng.expovariate(per_h / 3_600_000)

    def _area(self) -> Area:
        return self._rng.choice(self._shift.fleet.scenes[self._shift.scene].areas)

    def _close(self, mean_s: float) -> None:
        self._ask("closed", mean_s, paths=(self._rng.choice(self._area().paths).key,))

    def _reserve(self, mean_s: float) -> None:
        x, y = self._ends()[0]
        wide = self._rng.uniform(0.3, RESERVED_M_MAX)
        high = self._rng.uniform(0.3, RESERVED_M_MAX)
        zone = ((x, y), (x + wide, y), (x + wide, y + high), (x, y + high))
        self._ask("reserved", mean_s, zones=(zone,))

    def _cross(self) -> None:
        start, end = self._ends()
        stranger = Stranger(start=start, end=end)
        id_ = self._ask("stranger", None, zones=(stranger.ground(),))
        if id_ is not None:
            self.strangers[id_] = stranger

    def _ends(self) -> tuple[XY, XY]:
        area = self._area()
        path = self._rng.choice(area.paths)
        at = {point.name: (point.x_m, point.y_m) for point in area.points}
        return at[path.start], at[path.end]

    def _ask(
        self,
        owner: str,
        mean_s: float | None,
        *,
        paths: tuple[str, ...] = (),
        zones: tuple[tuple[XY, ...], ...] = (),
    ) -> UnitId | None:
        self._numbers += 1
        id_ = UnitId(f"{owner}-{self._numbers}")
        unit = UnitAsked(id=id_, owner=id_, paths=paths, zones=zones)
        lasts_s = STRANGER_S_MAX if mean_s is None else self._rng.expovariate(1.0 / mean_s)
        if not self._command(RequestMapResources, units=(unit,)):
            return None  # somebody else has ground there
        self._ends_ms[id_] = self._shift.now_ms + lasts_s * 1000
        return id_

    def _release(self, id_: UnitId) -> None:
        del self._ends_ms[id_]
        self.strangers.pop(id_, None)
        self._command(ReleaseMapResources, units=(id_,))

    def _command(self, kind: type[Command], **fields: object) -> bool:
        handler = self._shift.handler
        head = {"id": CommandId(handler.new_id()), "by": "faults", "at_ms": self._shift.now_ms}
        try:
            handler.handle(kind(**head, **fields))  # type: ignore[arg-type]
        except Rejected:
            return False
        return True
