"""A small model of what clients can know for sure: what they asked for, and whether it was right.

It says nothing of what robots do; where they may have been quicker, it allows both.
"""

from dataclasses import dataclass, field

CELL_M = 2.0  # reservations are squares of this size on a grid far from all robots


@dataclass
class Order:
    """What a client has made of an order."""

    steps: int
    sealed: bool
    priority: int
    external_id: str | None
    cancelled: bool = False
    suspended: bool = False


@dataclass
class Robot:
    """What operators have made of a robot."""

    simulated: bool
    off_duty: bool = False
    disabled: bool = False
    remark: str | None = None


@dataclass
class Model:
    """Everything that was acknowledged."""

    orders: dict[str, Order] = field(default_factory=dict)
    robots: dict[str, Robot] = field(default_factory=dict)
    units: dict[str, tuple[str, int]] = field(default_factory=dict)  # owner, square

    def may_change(self, order: str) -> bool:
        """Tell whether the order is certain not to have ended: it is open, and not cancelled."""
        known = self.orders[order]
        return not known.cancelled and not known.sealed

    def free_for(self, unit: str, owner: str, square: int) -> bool:
        """Tell whether this reservation is to be granted; the same once more is the same."""
        if unit in self.units:
            return self.units[unit] == (owner, square)
        return all(o == owner for o, taken in self.units.values() if taken == square)
