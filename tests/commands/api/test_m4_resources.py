"""The four calls of external map resources, on the real routes."""

import asyncio
import json
from collections.abc import Sequence
from typing import Any

import httpx
import msgspec
import pytest
from starlette.types import Message

from ledger.events import (
    CommandAnswered,
    MapResourcesAsked,
    MapResourcesGranted,
    MapResourcesReleased,
    SceneImported,
)
from ledger.ids import PointName, SceneId, UnitId
from ledger.proposals import GrantMapResources
from ledger.scene import Group, Path, Point
from tests.commands.api.application import Site, site
from tests.commands.site import SCENE, area, opened
from tests.golden import example, same_form

URL = "/api/fleet/external-map-res"
OF_EXAMPLES = SceneId("685A06C1373D9D2CFD46D1A4")
EXAMPLE_POINTS = (
    "AP1090 AP1089 AP1088 AP5 LM29 AP33 LM32 AP16 LM22 AP6"  # all that the examples name
)
EXAMPLE_PATHS = (("AP33", "LM32"), ("AP16", "LM22"), ("AP5", "AP6"))
UNIT = {"unitId": "u1", "owner": "WMS", "pointNames": ["AP110"]}


def of_examples() -> Site:
    points = tuple(
        Point(name=PointName(name), x_m=10.0 * n, y_m=0.0)
        for n, name in enumerate(EXAMPLE_POINTS.split())
    )
    paths = tuple(Path(start=PointName(a), end=PointName(b)) for a, b in EXAMPLE_PATHS)
    hall = msgspec.structs.replace(area(), id=0, points=points, paths=paths, bins=())
    scene = SceneImported(
        scene=OF_EXAMPLES,
        name="A",
        digest="d" * 64,
        areas=(hall,),
        groups=(Group(id=0, name="default"),),
    )
    return granting(site(scene))


def granting(there: Site) -> Site:
    """Traffic that has all ground at once."""

    async def watch(units: Sequence[UnitId]) -> bool:
        claims = there.handler.fleet.claims
        for unit in units:
            if unit in claims and not claims[unit].granted:
                scene = claims[unit].scene
                there.handler.propose([GrantMapResources(scene=scene, units=(unit,))])
        return True

    there.watch = watch
    return there


def happened(there: Site, kind: type[Any]) -> list[Any]:
    return [event for event in there.ledger.read(1) if isinstance(event, kind)]


@pytest.mark.parametrize("number", ["", ".2", ".3", ".4", ".5", ".6"])
async def test_the_examples_of_requests_are_granted(number: str) -> None:
    there = of_examples()
    asked = example("m4", f"external-map-res-request{number}.request")
    answer = await there.post(f"{URL}/request", asked)
    assert (answer.status_code, answer.json()) == (200, {"ok": True})
    assert answer.json() == example("m4", "external-map-res-request.response")
    claim = there.handler.fleet.claims[UnitId(asked[0]["unitId"])]
    assert claim.granted and claim.unit.owner == asked[0]["owner"] and claim.unit.reason == " "
    assert list(claim.unit.points) == asked[0].get("pointNames", [])
    assert list(claim.unit.paths) == asked[0].get("pathKeys", [])
    zones = [[[p["x"], p["y"]] for p in z["points"]] for z in asked[0].get("spatialZones", [])]
    assert json.loads(msgspec.json.encode(claim.unit.zones)) == zones


async def test_the_example_of_a_refusal_without_a_reason() -> None:
    there = of_examples()
    there.watch = site().watch
    answer = await there.post(f"{URL}/request", [UNIT | {"pointNames": ["AP5"]}])
    assert answer.status_code == 200
    assert answer.json() == example("m4", "external-map-res-request.2.response")
    assert there.handler.fleet.claims == {}
    assert [event.lapsed for event in happened(there, MapResourcesReleased)] == [True]


@pytest.mark.parametrize("owner", ["", " ", None])
async def test_the_example_of_a_refusal_with_a_reason(owner: str | None) -> None:
    answer = await site().post(f"{URL}/request", [UNIT | {"owner": owner}])
    wanted = example("m4", "external-map-res-request.3.response")
    assert answer.status_code == 400
    same_form(wanted, answer.json())
    assert (answer.json()["code"], answer.json()["args"]) == (wanted["code"], wanted["args"])
    without = {k: v for k, v in UNIT.items() if k != "owner"}
    absent = await site().post(f"{URL}/request", [without])
    assert absent.json() == answer.json()


@pytest.mark.parametrize(("number", "left"), [("", 0), (".2", 1), (".3", 1)])
async def test_the_examples_of_releases(number: str, left: int) -> None:
    """`A` and `B` stand for the id and the name of two scenes."""
    names = {"A": "other", "B": "B"}
    scenes = [
        SceneImported(
            scene=SceneId(id_),
            name=name,
            digest=id_ * 64,
            areas=(area(),),
            groups=(Group(id=0, name="default"),),
        )
        for id_, name in names.items()
    ]
    there = granting(site(*scenes))
    for id_ in names:
        unit = {"unitId": f"{id_}1", "owner": "AMB-06", "sceneId": id_, "pointNames": ["AP110"]}
        assert (await there.post(f"{URL}/request", [unit])).json() == {"ok": True}
    asked = example("m4", f"external-map-res-release-by-owner{number}.request")
    answer = await there.post(f"{URL}/release-by-owner", asked)
    assert (answer.status_code, answer.content) == (200, b"")
    assert len(there.handler.fleet.claims) == left


async def test_the_example_of_a_release_by_id() -> None:
    there = of_examples()
    await there.post(f"{URL}/request", example("m4", "external-map-res-request.5.request"))
    asked = example("m4", "external-map-res-release.request")
    for _ in range(2):
        answer = await there.post(f"{URL}/release", asked)
        assert (answer.status_code, answer.content) == (200, b"")
    assert there.handler.fleet.claims == {}


async def test_everything_is_released_without_a_body() -> None:
    there = granting(site())
    await there.post(f"{URL}/request", [UNIT])
    answer = await there.post(f"{URL}/release-all")
    assert (answer.status_code, answer.content) == (200, b"")
    assert there.handler.fleet.claims == {}


async def test_nothing_is_waited_for_when_it_is_there_already() -> None:
    there = granting(site())
    await there.post(f"{URL}/request", [UNIT])
    there.watch = site().watch
    again = await there.post(f"{URL}/request", [UNIT])
    assert again.json() == {"ok": True}
    assert len(happened(there, MapResourcesAsked)) == 1


async def test_a_grant_that_comes_as_time_runs_out_wins() -> None:
    there = granting(site())
    grant = there.watch

    async def late(units: Sequence[UnitId]) -> bool:
        await grant(units)
        return False

    there.watch = late
    assert (await there.post(f"{URL}/request", [UNIT])).json() == {"ok": True}
    assert there.handler.fleet.claims[UnitId("u1")].granted
    assert not happened(there, MapResourcesReleased)


async def test_the_answer_is_on_disk() -> None:
    there = granting(site())
    answer = await there.post(f"{URL}/request", [UNIT])
    assert there.waited[-1] == there.handler.fleet.position
    assert int(answer.headers["x-ledger-position"]) == there.handler.fleet.position


async def test_two_calls_wait_for_the_same_and_the_last_one_gives_up() -> None:
    there = site()
    ends = {name: asyncio.Event() for name in ("first", "second")}
    names = iter(ends)

    async def watch(units: Sequence[UnitId]) -> bool:
        await ends[next(names)].wait()
        return False

    there.watch = watch
    first = asyncio.ensure_future(there.post(f"{URL}/request", [UNIT]))
    while not there.handler.fleet.claims:
        await asyncio.sleep(0)
    second = asyncio.ensure_future(there.post(f"{URL}/request", [UNIT]))
    while not ends["second"]._waiters:  # type: ignore[attr-defined]
        await asyncio.sleep(0)
    ends["first"].set()
    assert (await first).json() == {"ok": False}
    assert UnitId("u1") in there.handler.fleet.claims  # somebody still waits for it
    ends["second"].set()
    assert (await second).json() == {"ok": False}
    assert there.handler.fleet.claims == {}


async def test_a_client_that_hangs_up_gives_up() -> None:
    there = site()

    async def never(units: Sequence[UnitId]) -> bool:
        await asyncio.Event().wait()
        return True

    there.watch = never
    body = json.dumps([UNIT]).encode()
    arrived: list[Message] = [
        {"type": "http.request", "body": body, "more_body": False},
        {"type": "http.disconnect"},
    ]
    sent: list[Message] = []

    async def receive() -> Message:
        return arrived.pop(0)

    async def send(message: Message) -> None:
        sent.append(message)

    path = f"{URL}/request"
    scope = {
        "type": "http",
        "method": "POST",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "headers": [],
        "state": {"user": "alice"},
    }
    await there.app(scope, receive, send)
    assert there.handler.fleet.claims == {}
    assert [event.lapsed for event in happened(there, MapResourcesReleased)] == [True]


KEY = {"Idempotency-Key": "k"}


async def test_a_repeated_key_gets_the_first_answer() -> None:
    there = granting(site())
    first = await there.post(f"{URL}/request", [UNIT], headers=KEY)
    await there.post(f"{URL}/release", ["u1"])
    again = await there.post(f"{URL}/request", [UNIT], headers=KEY)
    assert first.json() == again.json() == {"ok": True}
    assert there.handler.fleet.claims == {}  # nothing happened twice
    other = await there.post(f"{URL}/request", [UNIT | {"reason": "x"}], headers=KEY)
    assert (other.status_code, other.json()["code"]) == (400, "errIdempotencyKeyReused")


async def test_a_repeated_key_gets_the_first_no_too() -> None:
    there = site()
    vain = await there.post(f"{URL}/request", [UNIT], headers=KEY)
    granting(there)
    assert (await there.post(f"{URL}/request", [UNIT], headers=KEY)).json() == vain.json()
    other = {"Idempotency-Key": "l"}
    blank = await there.post(f"{URL}/request", [], headers=other)
    again = await there.post(f"{URL}/request", [], headers=other)
    assert (blank.status_code, blank.json()["code"]) == (400, "errExternalMapResUnitsEmpty")
    assert (again.status_code, again.json()) == (400, blank.json())
    assert len(happened(there, CommandAnswered)) == 2
    assert not happened(there, MapResourcesGranted)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"unitId": None}, "unitId"),
        ({"unitId": " "}, "unitId"),
        ({"unitId": "x" * 201}, "unitId"),
        ({"unitId": 7}, "unitId"),
        ({"areaId": "1"}, "areaId"),
        ({"areaId": 2**31}, "areaId"),
        ({"pointNames": "AP110"}, "pointNames"),
        ({"pointNames": ["AP110"] * 1001}, "pointNames"),
        ({"spatialZones": [{"points": [], "type": "Rect"}]}, "points"),
        ({"spatialZones": [{"points": [{"x": 0, "y": 0}] * 3}]}, "type"),
        ({"spatialZones": [{"points": [{"x": 0, "y": 0}] * 3, "type": "Circle"}]}, "type"),
        ({"spatialZones": [{"points": [{"x": 0}] * 3, "type": "Rect"}]}, "y"),
        ({"spatialZones": [{"points": [{"x": 1e7, "y": 0}] * 3, "type": "Rect"}]}, "x"),
        ({"spatialZones": [{"points": [{"x": 0, "y": 0}] * 201, "type": "Rect"}]}, "points"),
        ({"spatialZones": [{"points": [{"x": 0, "y": 0}] * 3, "type": "Rect"}]}, "no area"),
    ],
)
async def test_what_is_malformed_is_named(fields: dict[str, Any], words: str) -> None:
    there = granting(site())
    answer = await there.post(f"{URL}/request", [UNIT | fields])
    assert answer.status_code == 400
    assert words in answer.json()["message"]
    assert there.handler.fleet.claims == {}


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
async def test_coordinates_are_numbers(number: str) -> None:
    zone = f'{{"points":[{{"x":{number},"y":0}},{{"x":1,"y":0}},{{"x":1,"y":1}}],"type":"Other"}}'
    body = f'[{{"unitId":"u","owner":"w","spatialZones":[{zone}]}}]'
    answer = await site().post(f"{URL}/request", body.encode())
    assert answer.status_code == 400


@pytest.mark.parametrize("kind", ["Other", "Rect", "Concave"])
async def test_a_polygon_may_be_closed_and_of_any_kind(kind: str) -> None:
    there = granting(site())
    ring = [{"x": x, "y": y} for x, y in ((0, 0), (2, 0), (1, 0.5), (0, 2), (0, 0))]
    zones = [{"points": ring, "type": kind}]
    body = [{"unitId": "u", "owner": "w", "spatialZones": zones}]
    assert (await there.post(f"{URL}/request", body)).json() == {"ok": True}
    assert len(there.handler.fleet.claims[UnitId("u")].unit.zones[0]) == 4


@pytest.mark.parametrize("body", [b"[]", b'["a"]', b"[1]", b"{}", b"null", b'["\\u0000"]'])
async def test_a_release_takes_texts_only(body: bytes) -> None:
    answer: httpx.Response = await site(*opened()).post(f"{URL}/release", body)
    fine = body in (b"[]", b'["a"]', b'["\\u0000"]')
    assert answer.status_code == (200 if fine else 400)


async def test_the_scene_of_the_id_wins_over_the_one_of_the_name() -> None:
    there = granting(site())
    unit = UNIT | {"sceneId": SCENE, "sceneName": "nonsense", "areaId": 1, "areaName": "nonsense"}
    assert (await there.post(f"{URL}/request", [unit])).json() == {"ok": True}
