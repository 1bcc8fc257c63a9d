"""Where the names of a scene are: points, and bins by the point they are reached from."""

from collections.abc import Mapping
from typing import TypeAlias

from ledger.ids import PointName
from ledger.scene import Area, Bin, Point, Scene, Value


class Place(Value, frozen=True, kw_only=True):
    """What a location name of a step stands for."""

    area: int
    point: Point
    bin: Bin | None = None


Places: TypeAlias = Mapping[str, Place]


def find_places(scene: Scene) -> dict[str, Place]:
    """Index all locations of the enabled areas.

    A bin that has the name of a point goes first: only a bin can be asked for a bin task.
    """
    places: dict[str, Place] = {}
    for area in scene.areas:
        if not area.disabled:
            places.update(_of_area(area))
    return places


def _of_area(area: Area) -> dict[str, Place]:
    points: dict[PointName, Point] = {point.name: point for point in area.points}
    places: dict[str, Place] = {n: Place(area=area.id, point=p) for n, p in points.items()}
    for spot in area.bins:
        if spot.point in points:
            places[spot.name] = Place(area=area.id, point=points[spot.point], bin=spot)
    return places
