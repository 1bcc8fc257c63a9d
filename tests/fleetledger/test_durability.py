import asyncio

import pytest

from fleetledger.durability import Durability
from ledger.errors import Unknown
from ledger.events import AnyEvent, OrderSealed
from ledger.ids import OrderId, SceneId


def _commit(*positions: int) -> list[AnyEvent]:
    return [OrderSealed(position=p, scene=SceneId("s"), order=OrderId("o")) for p in positions]


async def test_a_commit_is_visible_before_those_who_wait_for_it_wake() -> None:
    seen: list[int] = []
    durability = Durability(
        asyncio.get_running_loop(), 0, lambda events: seen.extend(e.position for e in events)
    )
    waiting = asyncio.ensure_future(durability.reached(2))

    await asyncio.to_thread(durability.heard, _commit(1))
    await asyncio.to_thread(durability.heard, _commit(2, 3))
    await waiting

    assert seen == [1, 2, 3]
    assert durability.position == 3
    assert durability.idle


async def test_a_failed_disk_wakes_everybody_with_the_failure_and_refuses_who_comes_later() -> None:
    durability = Durability(asyncio.get_running_loop(), 0, lambda events: None)
    waiting = asyncio.ensure_future(durability.reached(1))

    await asyncio.to_thread(durability.failed, Unknown("disk full"))

    with pytest.raises(Unknown, match="disk full"):
        await waiting
    with pytest.raises(Unknown, match="disk full"):
        await durability.reached(2)


async def test_a_client_that_has_gone_holds_nobody_up() -> None:
    durability = Durability(asyncio.get_running_loop(), 0, lambda events: None)
    gone = asyncio.ensure_future(durability.reached(1))
    stays = asyncio.ensure_future(durability.reached(2))
    await asyncio.to_thread(lambda: None)
    gone.cancel()

    await asyncio.to_thread(durability.heard, _commit(1, 2))
    await stays

    assert gone.cancelled()


async def test_the_committer_wakes_when_all_that_has_come_is_decided() -> None:
    loop = asyncio.get_running_loop()
    durability = Durability(loop, 0, lambda events: None)
    happened: list[str] = []
    loop.call_soon(lambda: durability.gather(lambda: happened.append("woken")))
    loop.call_soon(lambda: happened.append("decided"))
    loop.call_soon(lambda: happened.append("decided"))

    await asyncio.to_thread(lambda: durability.gather(lambda: happened.append("at once")))
    await asyncio.sleep(0)

    assert [what for what in happened if what != "at once"] == ["decided", "decided", "woken"]
    assert "at once" in happened
