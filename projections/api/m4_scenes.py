"""Scenes as clients draw them: the list, and the map."""

from functools import lru_cache

import msgspec

from ledger.errors import Refused
from ledger.ids import SceneId
from ledger.scene import Area, Scene
from ledger.state import Fleet
from projections.fields import Row

MAPS_KEPT = 16  # encoded, newest used


def scene_list(fleet: Fleet) -> list[Row]:
    """Give the scenes that are there, in the order in which clients are to show them."""
    present = [scene for scene in fleet.scenes.values() if not scene.removed]
    return [
        {
            "id": scene.id,
            "name": scene.name,
            "disabled": scene.disabled,
            "version": scene.version,
            "displayOrder": scene.display_order,
            "lastModifiedOn": scene.modified_ms,
        }
        for scene in sorted(present, key=lambda s: (s.display_order, s.name))
    ]


def scene_asked(fleet: Fleet, id_: str | None, name: str | None) -> Scene:
    """Find the scene of a request; the id goes before the name. A removed scene is none."""
    if id_:
        scene = fleet.scenes.get(SceneId(id_))
    elif name:
        named = (s for s in fleet.scenes.values() if s.name == name)
        scene = next((s for s in named if not s.removed), None)
    else:
        raise Refused("errSceneIdBlank", "One of the fields 'sceneId', 'sceneName' is required.")
    if scene is None or scene.removed:
        field, value = ("sceneId", id_) if id_ else ("sceneName", name)
        raise Refused("errSceneNotFound", f"Field '{field}': there is no scene '{value}'.", value)
    return scene


def scene_map(scene: Scene) -> bytes:
    """Give the JSON of a scene's map; encoded once for each version of the scene."""
    return _encoded(scene.id, scene.digest, scene.version, Unhashed(scene))


class Unhashed:
    """Carries a scene past the cache, which knows it by id, digest and version."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Unhashed)

    def __hash__(self) -> int:
        return 0


@lru_cache(maxsize=MAPS_KEPT)
def _encoded(id_: SceneId, digest: str, version: int, carrier: Unhashed) -> bytes:
    scene = carrier.scene
    body = {
        "id": id_,
        "name": scene.name,
        "version": digest,
        "areas": [_area(area) for area in scene.areas],
        "groups": [
            {
                "id": group.id,
                "name": group.name,
                "footprint": group.footprint,
                "footprintLoaded": group.footprint_loaded,
            }
            for group in scene.groups
        ],
    }
    return msgspec.json.encode(body)


def _area(area: Area) -> Row:
    return {
        "id": area.id,
        "name": area.name,
        "disabled": area.disabled,
        "map": area.map_name,
        "mapMd5": area.map_digest,
        "bound": bound(area),
        **drawn(area),
        "walls": area.walls,
    }


def bound(area: Area) -> Row:
    """Give the box around points and walls, metres."""
    xs = [p.x_m for p in area.points] + [x for wall in area.walls for x, _ in wall]
    ys = [p.y_m for p in area.points] + [y for wall in area.walls for _, y in wall]
    return {
        "xMin": min(xs, default=0.0),
        "yMin": min(ys, default=0.0),
        "xMax": max(xs, default=0.0),
        "yMax": max(ys, default=0.0),
    }


def drawn(area: Area) -> Row:
    """Give points, paths and bins."""
    return {
        "points": [
            {
                "name": point.name,
                "x": point.x_m,
                "y": point.y_m,
                "kind": point.kind,
                "direction": point.heading_rad,
            }
            for point in area.points
        ],
        "paths": [
            {
                "key": path.key,
                "start": path.start,
                "end": path.end,
                "controls": path.controls,
                "backward": path.backward,
            }
            for path in area.paths
        ],
        "bins": [
            {"name": b.name, "point": b.point, "tasks": [task.name for task in b.tasks]}
            for b in area.bins
        ],
    }
