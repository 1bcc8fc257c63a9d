"""Who waits for reserved ground is woken when it is granted, or cannot be had any more."""

import asyncio
from collections.abc import Mapping, Sequence
from itertools import count

from ledger.events import AnyEvent
from ledger.events.resources import ResourceEvent
from ledger.ids import UnitId
from ledger.state import MapClaim

WAIT_S = 5.0  # for ground that robots have to leave first
WAITERS_MAX = 1_000


class ClaimWatch:
    """Looks at the claims that queries see, so what it tells is on disk."""

    def __init__(self, claims: Mapping[UnitId, MapClaim], wait_s: float = WAIT_S) -> None:
        """Take the live claims; they change under us, and `apply` says when."""
        self._claims = claims
        self._wait_s = wait_s
        self._waiters: dict[int, tuple[Sequence[UnitId], asyncio.Future[bool]]] = {}
        self._number = count()

    def apply(self, events: Sequence[AnyEvent]) -> None:
        """Look again, if any of these events is about reservations; they have been taken in."""
        if not self._waiters or not any(isinstance(event, ResourceEvent) for event in events):
            return
        for units, waiter in self._waiters.values():
            outcome = self._outcome(units)
            if outcome is not None and not waiter.done():
                waiter.set_result(outcome)

    def _outcome(self, units: Sequence[UnitId]) -> bool | None:
        """None = still to be waited for."""
        claims = [self._claims.get(unit) for unit in units]
        if any(claim is None for claim in claims):
            return False
        return True if all(claim is not None and claim.granted for claim in claims) else None

    async def granted(self, units: Sequence[UnitId]) -> bool:
        """Wait until all of these are granted; False if not in time, or one of them has gone."""
        outcome = self._outcome(units)
        if outcome is not None:
            return outcome
        if len(self._waiters) >= WAITERS_MAX:
            return False
        waiter: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        number = next(self._number)
        self._waiters[number] = (units, waiter)
        try:
            async with asyncio.timeout(self._wait_s):
                return await waiter
        except TimeoutError:
            return False
        finally:
            del self._waiters[number]
