"""Who is told of orders' states, and how insistently (spec/protocols.md 1.7, callbacks)."""

from enum import StrEnum

import msgspec


class CallbackStatus(StrEnum):
    """What is told: the states of an order, and two on the way (spec/protocols.md 1.8)."""

    TO_BE_ALLOCATED = "ToBeAllocated"
    ALLOCATED = "Allocated"
    PENDING = "Pending"
    EXECUTING = "Executing"
    DONE = "Done"
    CANCELLED = "Cancelled"
    CANCELLING = "Cancelling"  # told just before Cancelled
    WITHDRAWING = "Withdrawing"  # told just before ToBeAllocated, when a robot loses the order


class CallbackConfig(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Callbacks of a scene's orders; the secret that signs them is not in the ledger."""

    enabled: bool = False
    statuses: tuple[CallbackStatus, ...] = ()  # empty = all
    urls: tuple[str, ...] = ()
    retries_max: int = 10  # of one callback; then it is given up, and the next one goes
    retry_s: float = 1.0  # before the first retry; doubles up to a minute
