"""The same question asked by many at once is answered once.

Dashboards ask the same things again and again. While nothing has become durable since an answer
was begun, and it is younger than it may be, whoever asks the same gets the same; who comes while it
is being made waits for it. So an answer is never older than what its asker has been acknowledged.
"""

import asyncio
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Hashable
from typing import Any, TypeVar

from ledger.scene import Value

KEPT_MAX = 16  # questions: an answer may have megabytes

T = TypeVar("T")


class _Kept(Value, frozen=True, kw_only=True):
    position: int
    begun_s: float
    answer: asyncio.Future[Any]


class Shared:
    """Answers that are shared. For one event loop."""

    def __init__(self, position: Callable[[], int], now_s: Callable[[], float]) -> None:
        """Take the position that queries see, and a clock that only goes forward."""
        self._position = position
        self._now_s = now_s
        self._kept: OrderedDict[Hashable, _Kept] = OrderedDict()

    async def give(
        self, question: Hashable, age_s_max: float, make: Callable[[], Awaitable[T]]
    ) -> T:
        """Give the answer that is there or on its way, or make it; failures are not kept.

        It is made in a task of its own, so that who asked first may leave.
        """
        kept = self._kept.get(question)
        while kept is not None and not self._holds(kept, age_s_max):
            if kept.answer.done():
                kept = None
            else:  # too old for us already; two at a time would only slow each other down
                await asyncio.wait({kept.answer})
                kept = self._kept.get(question)
        if kept is None:
            made = asyncio.ensure_future(_coroutine(make))
            kept = _Kept(position=self._position(), begun_s=self._now_s(), answer=made)
            self._kept[question] = kept
            self._kept.move_to_end(question)
            while len(self._kept) > KEPT_MAX:
                self._kept.popitem(last=False)
        answer: T = await asyncio.shield(kept.answer)
        return answer

    def _holds(self, kept: _Kept, age_s_max: float) -> bool:
        if kept.position != self._position() or self._now_s() - kept.begun_s > age_s_max:
            return False
        failed = kept.answer.done() and (
            kept.answer.cancelled() or kept.answer.exception() is not None
        )
        return not failed


async def _coroutine(make: Callable[[], Awaitable[T]]) -> T:
    return await make()
