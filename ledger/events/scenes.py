"""Events of scenes."""

from typing import TypeAlias

from ledger.events.base import Event
from ledger.scene import Area, ContainerType, Group
from ledger.scene_config import SceneConfig


class SceneImported(Event, frozen=True, kw_only=True):
    """A new scene came from a scene file or from `scenes/import`."""

    name: str
    digest: str  # SHA-256 of the content
    areas: tuple[Area, ...]
    groups: tuple[Group, ...]
    container_types: tuple[ContainerType, ...] = ()
    config: SceneConfig = SceneConfig()


class SceneMapReplaced(Event, frozen=True, kw_only=True):
    """A changed scene file replaced maps, groups and container types; settings stay."""

    digest: str
    areas: tuple[Area, ...]
    groups: tuple[Group, ...]
    container_types: tuple[ContainerType, ...] = ()


class SceneConfigured(Event, frozen=True, kw_only=True):
    """Someone changed the settings of a scene (`scenes/{id}/config`)."""

    config: SceneConfig


SceneEvent: TypeAlias = SceneImported | SceneMapReplaced | SceneConfigured
