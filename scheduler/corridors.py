"""Single-lane two-way corridors of a map: where robots of opposite directions cannot pass.

Dispatch holds the number of orders in each of them down: the largest single gain in aisles
(design notes, traffic §11 rule 10).
"""

import math
from collections.abc import Mapping
from typing import TypeAlias

from ledger.ids import PointName
from ledger.scene import XY, Area, Scene, Value

POINTS_MIN = 3  # a shorter one holds nobody up for long
NEIGHBOURS_MAX = 2  # of a point within a corridor; where there are more robots can evade

# In one of usual length, open at both ends (measured: design notes, traffic §11 rule 10).
ORDERS_MAX = 2
METRES_PER_ORDER = 10.0  # a longer one takes more, so that a map of one lane is not paralysed
# In a dead end: whoever is bound for deeper in it waits until it is empty, in the way of all others
# (seer_sample_3 with 8 robots: 0.31 of free flow with two, 0.44 with one; 30 robots in aisles, each
# fourth a dead end: 0.55 and 0.63; three seeds each, bench/maps.py and bench/floors.py).
DEAD_END_ORDERS_MAX = 1


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
            found.update(corridors_of(area))
    return found


def corridors_of(area: Area) -> dict[PointName, Corridor]:
    """The same of one area."""
    paths = {(path.start, path.end) for path in area.paths}
    near: dict[PointName, set[PointName]] = {point.name: set() for point in area.points}
    for start, end in paths:
        near[start].add(end)
        near[end].add(start)
    at_m = {point.name: (point.x_m, point.y_m) for point in area.points}
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
            out = sum(1 for point in chain for other in near[point] if other not in chain)
            orders_max = DEAD_END_ORDERS_MAX if out == 1 else _open_orders_max(chain, near, at_m)
            found.update(dict.fromkeys(chain, Corridor(name=first, orders_max=orders_max)))
    return found


def _open_orders_max(
    chain: set[PointName], near: Mapping[PointName, set[PointName]], at_m: Mapping[PointName, XY]
) -> int:
    links = ((a, b) for a in chain for b in near[a] & chain if a < b)
    length_m = sum(math.dist(at_m[a], at_m[b]) for a, b in links)
    return max(ORDERS_MAX, int(length_m / METRES_PER_ORDER))
