"""The same question asked by many at once is answered once, and never older than it may be."""

import asyncio
from itertools import count

import pytest

from ledger.errors import Refused
from projections.shared import KEPT_MAX, Shared


class Place:
    """Questions at a position and a time that the test sets."""

    def __init__(self) -> None:
        self.position, self.now_s = 1, 0.0
        self.shared = Shared(lambda: self.position, lambda: self.now_s)
        self.numbers = count(1)
        self.gate = asyncio.Event()
        self.gate.set()

    async def make(self) -> int:
        number = next(self.numbers)
        await self.gate.wait()
        return number

    async def ask(self, question: str = "all", age_s_max: float = 1.0) -> int:
        return await self.shared.give(question, age_s_max, self.make)


async def test_who_asks_while_an_answer_is_made_waits_for_it() -> None:
    place = Place()
    place.gate.clear()
    asking = [asyncio.create_task(place.ask()) for _ in range(5)]
    await asyncio.sleep(0)
    place.gate.set()
    assert await asyncio.gather(*asking) == [1] * 5
    assert await place.ask("other") == 2


async def test_who_needs_a_newer_answer_waits_for_the_one_that_is_made_and_then_shares_one() -> (
    None
):
    place = Place()
    place.gate.clear()
    first = asyncio.create_task(place.ask())
    await asyncio.sleep(0)
    place.position = 2
    later = [asyncio.create_task(place.ask()) for _ in range(3)]
    await asyncio.sleep(0)
    place.gate.set()
    assert await first == 1
    assert await asyncio.gather(*later) == [2, 2, 2]


async def test_an_answer_is_given_again_only_while_it_is_young_and_nothing_has_happened() -> None:
    place = Place()
    assert [await place.ask(), await place.ask()] == [1, 1]
    place.position = 2
    assert [await place.ask(), await place.ask()] == [2, 2]
    place.now_s = 1.5
    assert await place.ask() == 3
    place.position = 3
    assert await place.ask(age_s_max=0.0) == 4


async def test_who_asked_first_may_leave_and_the_others_get_their_answer() -> None:
    place = Place()
    place.gate.clear()
    first = asyncio.create_task(place.ask())
    await asyncio.sleep(0)
    second = asyncio.create_task(place.ask())
    await asyncio.sleep(0)
    first.cancel()
    place.gate.set()
    assert await second == 1
    with pytest.raises(asyncio.CancelledError):
        await first


async def test_a_refusal_is_told_to_all_who_wait_and_then_forgotten() -> None:
    place = Place()

    async def refuse() -> int:
        await place.gate.wait()
        raise Refused("errNo", "No.")

    place.gate.clear()
    asking = [asyncio.create_task(place.shared.give("x", 1.0, refuse)) for _ in range(3)]
    await asyncio.sleep(0)
    place.gate.set()
    outcomes = await asyncio.gather(*asking, return_exceptions=True)
    assert [type(outcome) for outcome in outcomes] == [Refused] * 3
    assert await place.shared.give("x", 1.0, place.make) == 1


async def test_only_so_many_answers_are_kept() -> None:
    place = Place()
    for number in range(KEPT_MAX + 1):
        await place.ask(str(number))
    assert await place.ask("1") == 2
    assert await place.ask("0") == KEPT_MAX + 2, "the first one had to go"
