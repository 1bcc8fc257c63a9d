"""Single-lane two-way corridors of a map: where robots of opposite directions cannot pass.

Dispatch holds the number of orders in each of them down: the largest single gain in aisles
(design notes, traffic §11 rule 10).
"""

from collections.abc import Mapping
from typing import TypeAlias

from ledger.ids import PointName
from ledger.scene import Area, Scene, Value

POINTS_MIN = 3  # a shorter one holds nobody up for long
NEIGHBOURS_MAX = 2  # of a point within a corridor; where there are more robots can evade

ORDERS_MAX = 2  # in one corridor of usual length (measured: design notes, traffic §11 rule 10)
POINTS_PER_ORDER = 8  # a longer one takes more; a guess, so that a map of one lane is not paralysed


class Corridor(Value, frozen=True, kw_only=True):
    """One chain of points without branches."""

    name: PointName  # its first point by name
    orders_max: int


Corridors: TypeAlias = Mapping[PointName, Corridor]  # by point


def find_corridors(scene: Scene) -> dict[PointName, Corridor]:
    """Find the chains of points that are joined both ways and have no branches."""
    found: dict[PointName, Corridor] = {}
    for area in scene.areas:
        if not area.disabled:
            found.update(_of_area(area))
    return found


def _of_area(area: Area) -> dict[PointName, Corridor]:
    paths = {(path.start, path.end) for path in area.paths}
    near: dict[PointName, set[PointName]] = {point.name: set() for point in area.points}
    for start, end in paths:
        near[start].add(end)
        near[end].add(start)
    narrow = {
        name
        for name, others in near.items()
        if len(others) <= NEIGHBOURS_MAX and all((o, name) in paths for o in others)
    }
    found: dict[PointName, Corridor] = {}
    seen: set[PointName] = set()
    for first in sorted(narrow):
        if first in seen:
            continue
        chain, ahead = {first}, [first]
        while ahead:
            further = (near[ahead.pop()] & narrow) - chain
            chain |= further
            ahead.extend(sorted(further))
        seen |= chain
        if len(chain) >= POINTS_MIN:
            orders_max = max(ORDERS_MAX, len(chain) // POINTS_PER_ORDER)
            found.update(dict.fromkeys(chain, Corridor(name=first, orders_max=orders_max)))
    return found
