"""Events of scenes."""

from typing import TypeAlias

from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.events.base import Event
from ledger.ids import OrderId
from ledger.scene import Area, ContainerType, Door, Group, Lift
from ledger.scene_config import SceneConfig


class SceneImported(Event, frozen=True, kw_only=True):
    """A new scene came from a scene file or from `scenes/import`."""

    name: str
    digest: str  # SHA-256 of the content
    areas: tuple[Area, ...]
    groups: tuple[Group, ...]
    container_types: tuple[ContainerType, ...] = ()
    config: SceneConfig = SceneConfig()
    doors: tuple[Door, ...] = ()
    lifts: tuple[Lift, ...] = ()


class SceneMapReplaced(Event, frozen=True, kw_only=True):
    """A changed scene file replaced maps, groups and container types; settings stay."""

    digest: str
    areas: tuple[Area, ...]
    groups: tuple[Group, ...]
    container_types: tuple[ContainerType, ...] = ()
    doors: tuple[Door, ...] = ()
    lifts: tuple[Lift, ...] = ()


class SceneConfigured(Event, frozen=True, kw_only=True):
    """Someone changed the settings of a scene (`scenes/{id}/config`)."""

    config: SceneConfig


class SceneRenamed(Event, frozen=True, kw_only=True):
    """A scene got another name or place in lists (`scenes/{id}/basic/patch`)."""

    name: str
    display_order: int


class SceneDisabled(Event, frozen=True, kw_only=True):
    """A scene was taken out of service (`scenes/{id}/disable`)."""


class SceneEnabled(Event, frozen=True, kw_only=True):
    """A disabled scene came back (`scenes/{id}/disable`)."""


class SceneDispatchPaused(Event, frozen=True, kw_only=True):
    """No order of the scene gets a robot from now on (`scenes/{id}/dispatch-pause`)."""


class SceneDispatchResumed(Event, frozen=True, kw_only=True):
    """Orders of the scene get robots again (`scenes/{id}/dispatch-pause`)."""


class SceneRemoved(Event, frozen=True, kw_only=True):
    """A scene without live orders was taken away, its robots with it (`scenes/remove`)."""


class CallbacksConfigured(Event, frozen=True, kw_only=True):
    """Someone chose who is told of the orders' states (`scenes/{id}/callbacks`)."""

    callbacks: CallbackConfig


class CallbackGivenUp(Event, frozen=True, kw_only=True):
    """A callback was not accepted however often it was sent; the receiver has missed it."""

    order: OrderId
    url: str
    status: CallbackStatus
    of_position: int  # of the event that it told of
    reason: str  # what the last try met


SceneEvent: TypeAlias = (
    SceneImported
    | SceneMapReplaced
    | SceneConfigured
    | SceneRenamed
    | SceneDisabled
    | SceneEnabled
    | SceneDispatchPaused
    | SceneDispatchResumed
    | SceneRemoved
    | CallbacksConfigured
    | CallbackGivenUp
)
