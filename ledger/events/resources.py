"""Events of ground that somebody outside reserves (spec/m4.md §7)."""

from typing import TypeAlias

from ledger.events.base import Event
from ledger.ids import UnitId
from ledger.state import MapUnit


class MapResourcesAsked(Event, frozen=True, kw_only=True):
    """An owner asks for ground (`external-map-res/request`); robots let it become free."""

    units: tuple[MapUnit, ...]


class MapResourcesGranted(Event, frozen=True, kw_only=True):
    """No robot holds the ground any more, and none will enter until it is released."""

    units: tuple[UnitId, ...]


class MapResourcesReleased(Event, frozen=True, kw_only=True):
    """Ground was given back (`external-map-res/release…`), or could not be had in time."""

    units: tuple[UnitId, ...]
    lapsed: bool = False  # never granted: robots did not leave in time


ResourceEvent: TypeAlias = MapResourcesAsked | MapResourcesGranted | MapResourcesReleased
