"""Where dispatch wants a robot, and how much that matters; traffic decides how it gets there."""

from ledger.ids import PointName
from ledger.scene import Value


class Goal(Value, frozen=True, kw_only=True):
    """A point to rest on. The smaller rank goes first wherever two robots want the same ground."""

    point: PointName
    rank: tuple[int, int, str]  # -priority, since when in ms, robot
