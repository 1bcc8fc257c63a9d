"""Footprint classes: a robot has the shape of its group, empty or loaded.

Whoever takes a load needs the ground for it first: before the action begins it owns the loaded
body's ground at its place, so that nobody drives where the load will be. After an action that puts
the load down it gives back what it does not need any more. Moves are found for the widest class of
all, so that a place is as good for a loaded robot as for an empty one; only the cells differ.
"""

from collections.abc import Sequence

import shapely

from ledger.link import Report
from ledger.scene import XY, Group
from ledger.state import BinStatus, Robot
from scheduler.traffic.geometry import Floats, widened

ON_BOARD = frozenset({BinStatus.FILLED, BinStatus.CANCELLED})


def carries(robot: Robot, report: Report | None) -> bool:
    """Tell whether something lies on the robot: by the ledger, or by its own word.

    Either is enough: robots without sensors report no loads, and the ledger knows of no load that
    somebody put there by hand.
    """
    if report is not None and report.loads:
        return True
    return not ON_BOARD.isdisjoint([content.status for content in robot.bins])


def corners(group: Group, *, loaded: bool) -> tuple[XY, ...]:
    """Corners whose hull holds a body of this class; a load takes nothing away from the robot."""
    if not loaded or group.footprint_loaded is None:
        return group.footprint
    return (*group.footprint, *group.footprint_loaded)


def outline(group: Group, *, loaded: bool) -> shapely.Polygon:
    """The true body of this class, in the robot's frame; a load that lies apart from the robot
    counts with what is between them.
    """
    bodies = [group.footprint]
    if loaded and group.footprint_loaded is not None:
        bodies.append(group.footprint_loaded)
    whole = shapely.union_all([shapely.Polygon(body) for body in bodies])
    return whole if isinstance(whole, shapely.Polygon) else whole.convex_hull


class Classes:
    """The distinct footprints of some groups, numbered; widened hulls."""

    def __init__(self, groups: Sequence[Group]) -> None:
        """The last footprint contains all others and chooses the stops for all."""
        kinds = dict.fromkeys(
            corners(group, loaded=loaded) for group in groups for loaded in (False, True)
        )
        numbers = {kind: k for k, kind in enumerate(kinds)}
        self._numbers = {
            (group.id, loaded): numbers[corners(group, loaded=loaded)]
            for group in groups
            for loaded in (False, True)
        }
        self.footprints: list[Floats] = [widened(kind) for kind in kinds]
        if len(kinds) > 1:
            self.footprints.append(widened([corner for kind in kinds for corner in kind]))

    def of(self, group: int, *, loaded: bool = False) -> int:
        """Number of the footprint of a robot of this group."""
        return self._numbers[group, loaded]
