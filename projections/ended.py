"""Whether an order that has ended can match a condition: where none can, DuckDB is not asked."""

from collections.abc import Sequence
from typing import assert_never

from ledger.ids import OrderId, SceneId
from ledger.state import TERMINAL, Order, OrderStatus
from projections.condition_python import predicate
from projections.fields import BY_NAME
from projections.query import Both, Condition, Either, How, Not, Test

_STATUS = BY_NAME["status"]
# what every order has got that has ended
_GIVEN = frozenset(BY_NAME[name] for name in ("doneOn", "processingTime", "executingTime"))


def can_match(condition: Condition) -> bool:
    """Tell False only where no order matches that is Done or Cancelled."""
    return any(_holds(condition, status) is not False for status in sorted(TERMINAL))


def _holds(condition: Condition, status: OrderStatus) -> bool | None:
    """Tell whether it holds for orders that ended so: for all, for none, or None = some may."""
    match condition:
        case Both(items=items):
            return _least([_holds(item, status) for item in items], False)
        case Either(items=items):
            return _least([_holds(item, status) for item in items], True)
        case Not(item=item):
            held = _holds(item, status)
            return None if held is None else not held
        case Test(field=field, other=None) if field is _STATUS:
            return predicate(condition)(_ended(status), "")
        case Test(field=field, how=How.NULL) if field in _GIVEN:
            return False
        case Test():
            return None
        case _:
            assert_never(condition)


def _least(held: Sequence[bool | None], decides: bool) -> bool | None:
    if decides in held:
        return decides
    return None if None in held else not decides


def _ended(status: OrderStatus) -> Order:
    return Order(
        id=OrderId(""), scene=SceneId(""), status=status,
        created_ms=0, created_by="", modified_ms=0, modified_by="",
    )  # fmt: skip
