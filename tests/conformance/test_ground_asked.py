"""What each field of a request about reserved ground does, from the wire into the claim."""

from collections.abc import Sequence
from typing import Any

import msgspec
import pytest

from ledger.events import SceneImported
from ledger.ids import SceneId, UnitId
from ledger.proposals import GrantMapResources
from ledger.scene import Group
from tests.commands.api.application import Site, site
from tests.commands.site import area

URL = "/api/fleet/external-map-res"
SCENES = {"1" * 24: "north", "2" * 24: "south"}
ONE, TWO = SCENES
CORNERS = ((1.0, 2.0), (3.0, 2.5), (3.0, 4.0), (1.0, 3.5))


def scene(id_: str, name: str) -> SceneImported:
    areas = [msgspec.structs.replace(area(), id=n, name=w) for n, w in ((1, "hall"), (2, "loft"))]
    groups = (Group(id=0, name="default"),)
    return SceneImported(
        scene=SceneId(id_), name=name, digest=id_, areas=tuple(areas), groups=groups
    )


def free() -> Site:
    """Two scenes of two areas each, where all ground is had at once."""
    there = site(*(scene(id_, name) for id_, name in SCENES.items()))

    async def watch(units: Sequence[UnitId]) -> bool:
        claims = there.handler.fleet.claims
        for unit in units:
            there.handler.propose([GrantMapResources(scene=claims[unit].scene, units=(unit,))])
        return True

    there.watch = watch
    return there


@pytest.fixture(scope="module")
def shared() -> Site:
    return free()


@pytest.fixture
def there(shared: Site) -> Site:
    shared.handler.fleet.claims.clear()
    return shared


WHOLE = {
    "unitId": "u1",
    "owner": "WMS",
    "reason": "crane",
    "sceneId": ONE,
    "areaId": 1,
    "pointNames": ["AP110"],
    "pathKeys": ["AP110->AP125"],
    "spatialZones": [{"type": "Rect", "points": [{"x": x, "y": y} for x, y in CORNERS]}],
}


async def claimed(there: Site, without: tuple[str, ...] = (), **fields: Any) -> tuple[Any, Any]:
    """Reserve; gives the scene and what of it is claimed."""
    body = {k: v for k, v in (WHOLE | fields).items() if k not in without}
    answer = await there.post(f"{URL}/request", [body])
    assert (answer.status_code, answer.json()) == (200, {"ok": True}), answer.text
    (claim,) = there.handler.fleet.claims.values()
    there.handler.fleet.claims.clear()
    return claim.scene, claim.unit


PARTS: dict[str, tuple[Any, str, Any]] = {
    "unitId": ("u2", "id", "u2"),
    "owner": ("MES", "owner", "MES"),
    "reason": ("paint", "reason", "paint"),
    "areaId": (2, "area", 2),
    "pointNames": (["AP125", "PP1"], "points", ("AP125", "PP1")),
    "pathKeys": (["AP125->AP110"], "paths", ("AP125->AP110",)),
    "spatialZones": (
        [{"type": "Other", "points": [{"x": 7, "y": 0}, {"x": 8, "y": 0}, {"x": 7, "y": 1}]}],
        "zones",
        (((7.0, 0.0), (8.0, 0.0), (7.0, 1.0)),),
    ),
}


@pytest.mark.parametrize("field", PARTS)
async def test_a_field_of_a_unit_is_kept_and_changes_nothing_else(there: Site, field: str) -> None:
    value, kept_as, kept = PARTS[field]
    _, before = await claimed(there)
    _, after = await claimed(there, **{field: value})
    assert before.zones == (CORNERS,)
    assert after == msgspec.structs.replace(before, **{kept_as: kept}) != before


async def test_a_scene_is_found_by_its_id_or_else_by_its_name(there: Site) -> None:
    assert (await claimed(there))[0] == ONE
    assert (await claimed(there, sceneId=TWO))[0] == TWO
    assert (await claimed(there, sceneId=TWO, sceneName="north"))[0] == TWO
    assert (await claimed(there, ("sceneId",), sceneName="south"))[0] == TWO
    assert (await claimed(there, ("sceneId",), sceneName="north"))[0] == ONE


async def test_an_area_is_found_by_its_id_or_else_by_its_name(there: Site) -> None:
    assert (await claimed(there, areaName="loft"))[1].area == 1
    assert (await claimed(there, ("areaId",), areaName="loft"))[1].area == 2
    assert (await claimed(there, ("areaId",), areaName="hall"))[1].area == 1


async def test_a_reason_that_is_not_given_is_blank(there: Site) -> None:
    assert (await claimed(there, ("reason",)))[1].reason == " "


@pytest.mark.parametrize("kind", ["Rect", "Other"])
async def test_both_kinds_of_polygon_are_ground(there: Site, kind: str) -> None:
    zone = WHOLE["spatialZones"][0] | {"type": kind}  # type: ignore[index]
    assert (await claimed(there, spatialZones=[zone]))[1].zones == (CORNERS,)


async def test_what_is_not_free_yet_is_answered_with_no() -> None:
    there = site(scene(ONE, "north"))  # where nobody gets anything
    answer = await there.post(f"{URL}/request", [WHOLE])
    assert (answer.status_code, answer.json()) == (200, {"ok": False})
    assert there.handler.fleet.claims == {}


# each of the eight: 1 and 2 of which scene, h and l of which area, W and M of which owner
UNITS = [f"{s}{a}{o}" for s in "12" for a in "hl" for o in "WM"]
OWNED = {"1h", "1l", "2h", "2l"}


@pytest.mark.parametrize(
    ("fields", "gone"),
    [
        ({}, OWNED),
        ({"owner": "M"}, OWNED),
        ({"sceneId": TWO}, {"2h", "2l"}),
        ({"sceneName": "south"}, {"2h", "2l"}),
        ({"sceneId": ONE, "sceneName": "south"}, {"1h", "1l"}),
        ({"sceneId": ONE, "areaId": 2}, {"1l"}),
        ({"sceneId": ONE, "areaName": "loft"}, {"1l"}),
        ({"sceneId": ONE, "areaId": 1, "areaName": "loft"}, {"1h"}),
    ],
)
async def test_an_owner_gives_back_what_is_his_where_he_says(
    there: Site, fields: dict[str, Any], gone: set[str]
) -> None:
    for number, unit in enumerate(UNITS):
        x, y = 10 * number, 100
        corners = [(x, y), (x + 1, y), (x, y + 1)]
        zone = {"type": "Other", "points": [{"x": x, "y": y} for x, y in corners]}
        body = {
            "unitId": unit,
            "owner": unit[2],
            "sceneId": ONE if unit[0] == "1" else TWO,
            "areaId": 1 if unit[1] == "h" else 2,
            "spatialZones": [zone],
        }
        assert (await there.post(f"{URL}/request", [body])).json() == {"ok": True}
    body = {"owner": "W"} | fields
    answer = await there.post(f"{URL}/release-by-owner", body)
    assert (answer.status_code, answer.content) == (200, b"")
    left = set(there.handler.fleet.claims)
    assert set(UNITS) - left == {place + body["owner"] for place in gone}
    assert (await there.post(f"{URL}/release", ["1hW", "2lM"])).status_code == 200
    assert set(there.handler.fleet.claims) == left - {"1hW", "2lM"}
    assert (await there.post(f"{URL}/release-all")).status_code == 200
    assert not there.handler.fleet.claims
