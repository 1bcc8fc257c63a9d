"""Which area of which scene a reservation is for: ids win over names, and one of each suffices."""

from commands.rejected import Reason, Rejected
from ledger.ids import SceneId
from ledger.scene import Area, Scene, Value
from ledger.state import Fleet


class Target(Value, frozen=True, kw_only=True):
    """What a client says of scene and area; nothing at all is allowed too."""

    scene_id: str | None = None
    scene_name: str | None = None  # counts only without an id
    area_id: int | None = None
    area_name: str | None = None  # counts only without an id

    @property
    def names_area(self) -> bool:
        """Does it say anything of an area."""
        return self.area_id is not None or bool(self.area_name)


def target_of(fleet: Fleet, target: Target) -> tuple[Scene, Area]:
    """Find the one area that is meant; refuse what is not there, disabled or not clear."""
    scene = scene_named(fleet, target)
    if scene is None:
        scene = _only_scene(fleet)
    elif scene.disabled and target.scene_id:
        message = f'the scene with id "{scene.id}" is disabled'
        raise Rejected(Reason.RESOURCE_SCENE_ID_DISABLED, message, scene.id)
    elif scene.disabled:
        message = f'the scene named "{scene.name}" is disabled'
        raise Rejected(Reason.RESOURCE_SCENE_NAME_DISABLED, message, scene.name)
    return scene, _area(scene, target)


def scene_named(fleet: Fleet, target: Target) -> Scene | None:
    """Find the scene that is named, disabled or not; None if none is named."""
    if target.scene_id:
        scene = fleet.scenes.get(SceneId(target.scene_id))
        if scene is None or scene.removed:
            message = f'there is no scene with id "{target.scene_id}"'
            raise Rejected(Reason.RESOURCE_SCENE_ID_UNKNOWN, message, target.scene_id)
        return scene
    if target.scene_name:
        named = [s for s in fleet.scenes.values() if s.name == target.scene_name and not s.removed]
        if not named:
            message = f'there is no scene named "{target.scene_name}"'
            raise Rejected(Reason.RESOURCE_SCENE_NAME_UNKNOWN, message, target.scene_name)
        return min(named, key=lambda scene: scene.disabled)  # an enabled one first
    return None


def _only_scene(fleet: Fleet) -> Scene:
    enabled = [s for s in fleet.scenes.values() if not (s.disabled or s.removed)]
    if not enabled:
        raise Rejected(Reason.RESOURCE_NO_SCENE, "no scene is enabled")
    if len(enabled) > 1:
        message = "several scenes are enabled; give explicit scene information"
        raise Rejected(Reason.RESOURCE_SEVERAL_SCENES, message)
    return enabled[0]


def areas_named(scene: Scene, target: Target, *, strict: bool = True) -> frozenset[int]:
    """Give the areas that are named, disabled or not; none is named = none. `strict` refuses what
    is not there.
    """
    if target.area_id is not None:
        found = frozenset(a.id for a in scene.areas if a.id == target.area_id)
        if strict and not found:
            raise _no_area_id(scene, target.area_id)
        return found
    if target.area_name:
        found = frozenset(a.id for a in scene.areas if a.name == target.area_name)
        if strict and not found:
            raise _no_area_name(scene, target.area_name)
        return found
    return frozenset()


def _area(scene: Scene, target: Target) -> Area:
    where = _where(scene)
    named = areas_named(scene, target)
    if named:
        areas = [area for area in scene.areas if area.id in named]
        area = min(areas, key=lambda a: a.disabled)
        if not area.disabled:
            return area
        if target.area_id is not None:
            message = f"{where} the area with id {area.id} is disabled; its name is {area.name}"
            raise Rejected(
                Reason.RESOURCE_AREA_ID_DISABLED, message, scene.id, scene.name, area.id, area.name
            )
        message = f"{where} the area named {area.name} is disabled"
        raise Rejected(Reason.RESOURCE_AREA_NAME_DISABLED, message, scene.id, scene.name, area.name)
    enabled = [area for area in scene.areas if not area.disabled]
    if not enabled:
        message = f"{where} all areas are disabled"
        raise Rejected(Reason.RESOURCE_NO_AREA, message, scene.id, scene.name)
    if len(enabled) > 1:
        message = (
            f"the target scene (ID={scene.id}, name={scene.name}) has several enabled areas; "
            "give explicit area information"
        )
        raise Rejected(Reason.RESOURCE_SEVERAL_AREAS, message, scene.id, scene.name)
    return enabled[0]


def _where(scene: Scene) -> str:
    return f"in the target scene (ID={scene.id}, name={scene.name})"


def _no_area_id(scene: Scene, area: int) -> Rejected:
    message = f"{_where(scene)} there is no area with id {area}"
    return Rejected(Reason.RESOURCE_AREA_ID_UNKNOWN, message, scene.id, scene.name, area)


def _no_area_name(scene: Scene, area: str) -> Rejected:
    message = f"{_where(scene)} there is no area named {area}"
    return Rejected(Reason.RESOURCE_AREA_NAME_UNKNOWN, message, scene.id, scene.name, area)
