"""External reservations of one scene: from what the ledger says of them to traffic, and back."""

from collections.abc import Mapping, Sequence
from itertools import groupby

import shapely

from ledger.ids import SceneId, UnitId
from ledger.proposals import GrantMapResources
from ledger.scene import XY, Area, Path
from ledger.state import MapClaim, MapUnit
from scheduler.roads import TrafficLike
from scheduler.traffic.geometry import is_straight, poses_along

AROUND_M = 0.05  # to each side of a point (a square) and of a path (spec/m4.md, MapResourceUnit)
CURVE_SAMPLES = 64  # positions on a curved path


class Reservations:
    """Which claims traffic has been told of. Whoever starts anew tells them all again."""

    def __init__(self) -> None:
        self._told: dict[UnitId, MapUnit] = {}
        self._pending: list[list[MapClaim]] = []  # applications that have not been granted

    @property
    def pending(self) -> bool:
        """Whether an application has not been granted, as far as is known."""
        return bool(self._pending)

    def follow(
        self,
        claims: Sequence[MapClaim],
        areas: Sequence[Area],
        traffic: Mapping[int, TrafficLike],
    ) -> None:
        """Tell traffic what has changed. A unit that was given back and asked for again between
        two looks is another unit, whatever its id.
        """
        now = {claim.unit.id: claim for claim in claims}
        for id_, unit in list(self._told.items()):
            claim = now.get(id_)
            if claim is None or claim.unit is not unit:
                traffic[unit.area].unclaim(id_)
                del self._told[id_]
        grounds = {area.id: Ground(area) for area in areas if area.id in traffic}
        for id_, claim in now.items():
            unit = claim.unit
            if id_ not in self._told and unit.area in grounds:
                rings = grounds[unit.area].rings(unit)
                traffic[unit.area].claim(id_, unit.owner, rings, owned=claim.granted)
                self._told[id_] = unit
        waiting = sorted((c for c in claims if not c.granted), key=_application)
        self._pending = [list(group) for _, group in groupby(waiting, key=_application)]

    def due(self, scene: SceneId, traffic: Mapping[int, TrafficLike]) -> list[GrantMapResources]:
        """Give what traffic holds for its owners now: whole applications only."""
        return [
            GrantMapResources(scene=scene, units=tuple(claim.unit.id for claim in application))
            for application in self._pending
            if all(
                claim.unit.id in self._told and traffic[claim.unit.area].claimed(claim.unit.id)
                for claim in application
            )
        ]


def _application(claim: MapClaim) -> tuple[str, int, int]:
    """Units that were asked for together: by one owner, in one area, at one instant."""
    return claim.unit.owner, claim.at_ms, claim.unit.area


class Ground:
    """The ground of an area by the names of its points and paths."""

    def __init__(self, area: Area) -> None:
        self._points: dict[str, XY] = {p.name: (p.x_m, p.y_m) for p in area.points}
        self._paths: dict[str, Path] = {path.key: path for path in area.paths}

    def rings(self, unit: MapUnit) -> list[tuple[XY, ...]]:
        """Give the ground of a unit; names that the map has not any more stand for none."""
        at = self._points
        found = [*unit.zones, *(_square(at[name]) for name in unit.points if name in at)]
        paths = [self._paths[key] for key in unit.paths if key in self._paths]
        found += [_lane((at[path.start], *path.controls, at[path.end])) for path in paths]
        return found


def _square(at: XY) -> tuple[XY, ...]:
    x, y = at
    box = shapely.box(x - AROUND_M, y - AROUND_M, x + AROUND_M, y + AROUND_M)
    return _corners(box)


def _lane(curve: tuple[XY, ...]) -> tuple[XY, ...]:
    if is_straight(curve):
        line = [curve[0], curve[-1]]
    else:
        _, poses = poses_along(curve, CURVE_SAMPLES + 1, backward=False)
        line = poses[:, :2].tolist()
    return _corners(shapely.LineString(line).buffer(AROUND_M))


def _corners(polygon: shapely.Polygon) -> tuple[XY, ...]:
    return tuple((x, y) for x, y in shapely.get_coordinates(polygon.exterior)[:-1].tolist())
