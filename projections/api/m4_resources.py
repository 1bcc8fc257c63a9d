"""Reserved ground as the scene query shows it (spec/protocols.md §1.5, externalMapRes)."""

from ledger.scene import Scene
from ledger.state import Fleet, MapUnit
from projections.fields import Row

SHAPE = "Other"  # of the zones: which one a client had said is not kept, for it means nothing


def external_map_res(fleet: Fleet, scene: Scene) -> list[Row]:
    """Give the units of a scene as they were applied for, and whether their ground is clear."""
    areas = {area.id: area.name for area in scene.areas}
    return [
        {
            "unitId": claim.unit.id,
            "owner": claim.unit.owner,
            "reason": claim.unit.reason,
            "areaId": claim.unit.area,
            "areaName": areas.get(claim.unit.area, ""),
            "pointNames": list(claim.unit.points),
            "pathKeys": list(claim.unit.paths),
            "spatialZones": _zones(claim.unit),
            "granted": claim.granted,
        }
        for claim in fleet.claims.values()
        if claim.scene == scene.id
    ]


def _zones(unit: MapUnit) -> list[Row]:
    return [{"points": [{"x": x, "y": y} for x, y in zone], "type": SHAPE} for zone in unit.zones]
