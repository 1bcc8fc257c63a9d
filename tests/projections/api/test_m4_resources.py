from ledger.events import MapResourcesAsked, MapResourcesGranted
from ledger.ids import SceneId, UnitId
from ledger.state import MapUnit
from projections.api.m4_resources import external_map_res
from tests.commands.site import SCENE, opened
from tests.scenario import happened


def test_the_scene_shows_what_is_reserved_in_it() -> None:
    zone = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    units = (
        MapUnit(id=UnitId("u1"), owner="WMS", area=1, points=("AP110",), reason="crane"),
        MapUnit(id=UnitId("u2"), owner="WMS", area=9, paths=("AP110->AP125",), zones=(zone,)),
    )
    asked = MapResourcesAsked(scene=SCENE, units=units)
    elsewhere = MapUnit(id=UnitId("u3"), owner="MES", area=1, points=("AP110",))
    other = MapResourcesAsked(scene=SceneId("other"), units=(elsewhere,))
    granted = MapResourcesGranted(scene=SCENE, units=(UnitId("u1"),))
    fleet = happened([*opened(), asked, other, granted])
    first, second = external_map_res(fleet, fleet.scenes[SCENE])
    assert first == {
        "unitId": "u1",
        "owner": "WMS",
        "reason": "crane",
        "areaId": 1,
        "areaName": "hall",
        "pointNames": ["AP110"],
        "pathKeys": [],
        "spatialZones": [],
        "granted": True,
    }
    assert (second["areaName"], second["granted"]) == ("", False)
    corners = [{"x": 0.0, "y": 0.0}, {"x": 1.0, "y": 0.0}, {"x": 1.0, "y": 1.0}]
    assert second["spatialZones"] == [{"points": corners, "type": "Other"}]
