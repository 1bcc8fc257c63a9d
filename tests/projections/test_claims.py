"""Who waits for ground is woken by what happens, and by nothing else."""

import asyncio

import pytest

from ledger.events import MapResourcesAsked, MapResourcesGranted, MapResourcesReleased
from ledger.ids import UnitId
from ledger.state import Fleet, MapUnit
from projections import claims
from projections.claims import ClaimWatch
from tests.commands.site import SCENE
from tests.scenario import happened

U1, U2 = UnitId("u1"), UnitId("u2")


class Present:
    """A live state, and the watch on it."""

    def __init__(self, wait_s: float = 60.0) -> None:
        self.fleet = Fleet()
        self.watch = ClaimWatch(self.fleet.claims, wait_s)

    def happen(self, *events: object) -> None:
        happened(events, self.fleet)  # type: ignore[arg-type]
        self.watch.apply(events)  # type: ignore[arg-type]


def asked(*ids: UnitId) -> MapResourcesAsked:
    units = tuple(MapUnit(id=id_, owner="WMS", area=1, points=("AP110",)) for id_ in ids)
    return MapResourcesAsked(scene=SCENE, units=units)


def granted(*ids: UnitId) -> MapResourcesGranted:
    return MapResourcesGranted(scene=SCENE, units=ids)


def released(*ids: UnitId) -> MapResourcesReleased:
    return MapResourcesReleased(scene=SCENE, units=ids)


async def waiting(present: Present, *units: UnitId) -> "asyncio.Task[bool]":
    task = asyncio.ensure_future(present.watch.granted(units))
    await asyncio.sleep(0)  # let it begin
    return task


async def test_who_has_everything_does_not_wait() -> None:
    present = Present()
    present.happen(asked(U1), granted(U1))
    assert await present.watch.granted([U1])
    assert await present.watch.granted([])
    assert not await present.watch.granted([U1, U2])


async def test_a_grant_wakes_who_waits_for_all_of_it() -> None:
    present = Present()
    present.happen(asked(U1, U2))
    task = await waiting(present, U1, U2)
    present.happen(granted(U1))
    await asyncio.sleep(0)
    assert not task.done()
    present.happen(granted(U2))
    assert await task


async def test_a_release_ends_the_wait() -> None:
    present = Present()
    present.happen(asked(U1, U2))
    task = await waiting(present, U1, U2)
    present.happen(released(U2))
    assert not await task


async def test_nobody_waits_for_ever_and_nothing_is_left_behind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    present = Present(wait_s=0.0)
    present.happen(asked(U1))
    assert not await present.watch.granted([U1])
    monkeypatch.setattr(claims, "WAITERS_MAX", 1)
    present.watch._wait_s = 60.0
    first = await waiting(present, U1)
    assert not await present.watch.granted([U1])  # one too many
    first.cancel()
    await asyncio.gather(first, return_exceptions=True)
    assert not present.watch._waiters
