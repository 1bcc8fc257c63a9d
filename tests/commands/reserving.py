"""Words for stories of reserved ground."""

import msgspec

from commands.resource_target import Target
from commands.resources import RequestMapResources, UnitAsked
from ledger.events import (
    MapResourcesAsked,
    MapResourcesGranted,
    MapResourcesReleased,
    SceneImported,
)
from ledger.ids import SceneId, UnitId
from ledger.scene import Group
from ledger.state import MapUnit
from tests.commands.site import SCENE, area
from tests.scenario import ask

OTHER = SceneId("6870D00B569153590E058D40")
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


def scene(id_=SCENE, name="site", *, areas=((1, "hall", False),)):
    return SceneImported(
        scene=id_,
        name=name,
        digest="d" * 64,
        areas=tuple(
            msgspec.structs.replace(area(), id=n, name=word, disabled=disabled)
            for n, word, disabled in areas
        ),
        groups=(Group(id=0, name="default"),),
    )


def unit(id_="u1", owner="WMS", target=None, **fields):
    if not fields.keys() & {"points", "paths", "zones"}:
        fields = {**fields, "points": ("AP110",)}
    return UnitAsked(id=id_, owner=owner, target=target or Target(), **fields)


def reserve(*units):
    return ask(RequestMapResources, units=units)


def asked(id_="u1", owner="WMS", *, scene=SCENE, area=1, **fields):
    if not fields:
        fields = {"points": ("AP110",)}
    made = MapUnit(id=UnitId(id_), owner=owner, area=area, **fields)
    return MapResourcesAsked(scene=scene, units=(made,))


def granted(*ids, scene=SCENE):
    return MapResourcesGranted(scene=scene, units=tuple(UnitId(id_) for id_ in ids))


def released(*ids, scene=SCENE, lapsed=False):
    ids = tuple(UnitId(id_) for id_ in ids)
    return MapResourcesReleased(scene=scene, units=ids, lapsed=lapsed)
