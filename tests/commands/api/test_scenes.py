import msgspec
import pytest

from commands.api.m4_scene_config import (
    _LEVELS,
    _SETTINGS,
    BasicChargingConfig,
    SceneConfigPatch,
    wire,
    wire_whole,
)
from commands.scene_settings import CHARGING, SETTINGS
from ledger.scene_config import ChargingLevels, SceneConfig
from tests.commands.api.application import site
from tests.commands.site import SCENE
from tests.strategies import grid

IMPORT = "/api/fleet/scenes/import"
CONFIG = f"/api/fleet/scenes/{SCENE}/config"
FOLDER = "/api/fleet/scenes"


async def test_a_scene_file_is_imported_once() -> None:
    there = site()
    raw = msgspec.json.encode(grid(robots=2))
    first = await there.post(IMPORT, raw)
    assert first.status_code == 200
    id_ = first.json()["id"]
    assert len(id_) == 24
    assert there.handler.fleet.scenes[id_].name == "grid"
    again = await there.post(IMPORT, msgspec.json.format(raw, indent=2))
    assert again.json() == {"id": id_}
    changed = await there.post(IMPORT, msgspec.json.encode(grid(robots=3)))
    assert changed.json() == {"id": id_}
    assert len(there.handler.fleet.robots) == 3


async def test_what_is_no_scene_file_is_refused() -> None:
    for raw in (b"", b"{", b"[]", b'{"name": 7}', b'{"name": "x", "areas": []}'):
        answer = await site().post(IMPORT, raw)
        assert answer.status_code == 400, raw
        assert answer.json()["message"]


async def test_settings_are_told_in_the_words_of_the_specification() -> None:
    there = site()
    answer = await there.get(CONFIG)
    assert answer.status_code == 200
    assert there.waited == [1]
    told = answer.json()
    assert told["trafficPlanIntervalMs"] == 5000
    assert told["dispatchMethod"] == "KM"
    assert told["chargingConfig"]["defaultConfig"]["chargeOk"] == 0.8
    assert told["chargingConfig"]["groupedConfigs"] == {}


def test_every_setting_has_one_name_on_the_wire() -> None:
    assert set(_SETTINGS.values()) == set(SceneConfig.__struct_fields__) - {"charging"}
    assert set(_LEVELS.values()) == set(ChargingLevels.__struct_fields__)
    named = {*_SETTINGS, "chargingConfig"}
    assert set(SceneConfigPatch.model_fields) == set(wire_whole(SceneConfig())) == named
    assert set(BasicChargingConfig.model_fields) == set(_LEVELS)
    assert set(wire(SceneConfig())) == named - {"parkIdleTime"}


def test_the_document_has_the_bounds_that_are_kept() -> None:
    document = SceneConfigPatch.model_json_schema()
    levels = document["$defs"]["BasicChargingConfig"]
    for settings, properties in (
        (SETTINGS, document["properties"]),
        (CHARGING, levels["properties"]),
    ):
        for setting in settings:
            said = properties[setting.name]
            assert said["description"], setting.name
            if setting.bounds is not None:
                number = said["anyOf"][0]
                assert (number["minimum"], number["maximum"]) == setting.bounds, setting.name


async def test_what_was_told_can_be_sent_back_and_is_nothing_new() -> None:
    there = site()
    told = (await there.get(CONFIG)).json()
    answer = await there.post(CONFIG, told)
    assert (answer.status_code, answer.content) == (200, b"")
    assert there.handler.fleet.position == 1


async def test_only_what_is_sent_changes() -> None:
    there = site()
    charging = {"defaultConfig": {"chargeOk": 0.7}, "groupedConfigs": {"1": {"chargeNeed": 0.5}}}
    body = {
        "parkingPaused": True,
        "dispatchSort": ["-priority", "+createdOn"],
        "chargingConfig": charging,
    }
    answer = await there.post(CONFIG, body)
    assert (answer.status_code, answer.content) == (200, b"")
    config = there.handler.fleet.scenes[SCENE].config
    assert config.parking_paused
    assert config.dispatch_sort == ("-priority", "createdOn")
    assert config.charging.default == ChargingLevels(charge_ok=0.7)
    assert config.charging.by_group == {1: ChargingLevels(charge_ok=0.7, charge_need=0.5)}
    await there.post(CONFIG, {"chargingConfig": {"groupedConfigs": {"1": {"idleTime": 7}}}})
    config = there.handler.fleet.scenes[SCENE].config
    assert config.charging.by_group[1].charge_need == 0.5
    assert config.charging.by_group[1].idle_s == 7
    assert config.parking_paused
    told = (await there.get(CONFIG)).json()
    assert told["chargingConfig"]["groupedConfigs"]["1"]["idleTime"] == 7


async def test_bad_settings_are_refused_by_name() -> None:
    bad = {
        "robotStateFetchDelay": 0,
        "withdrawnMinCost": -1,
        "dispatchMethod": "Random",
        "parkingPaused": "true",
        "chargingConfig": {"defaultConfig": {"chargeFull": 1.5}},
    }
    for field, value in bad.items():
        answer = await site().post(CONFIG, {field: value})
        assert answer.status_code == 400
        assert field in answer.json()["message"]
    levels = {"chargingConfig": {"defaultConfig": {"chargeOnly": 0.9}}}
    answer = await site().post(CONFIG, levels)
    assert answer.json()["code"] == "errSceneConfigInvalid"
    groups = {"chargingConfig": {"groupedConfigs": {"9": {}}}}
    assert (await site().post(CONFIG, groups)).json()["code"] == "errRobotGroupNotFound"
    assert (await site().get("/api/fleet/scenes/S/config")).status_code == 400
    sort = await site().post(CONFIG, {"dispatchSort": ["status"]})
    assert sort.json()["code"] == "errSceneConfigInvalid"


@pytest.mark.parametrize(
    "body",
    [
        {"parkingPause": True},
        {"parkingPaused": True, "x": 1},
        {"chargingConfig": {"default": {}}},
        {"chargingConfig": {"defaultConfig": {"chargeok": 0.5}}},
        {"chargingConfig": {"groupedConfigs": {"1": {"chargeok": 0.5}}}},
    ],
)
async def test_a_setting_that_is_misspelt_is_refused_by_its_name(body: dict[str, object]) -> None:
    there = site()
    answer = await there.post(f"{CONFIG}/patch", body)
    assert answer.status_code == 400
    assert answer.json()["code"] == "errFieldUnknown"
    assert answer.json()["args"][0].rsplit(".")[-1] in str(body)
    assert there.handler.fleet.position == 1


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("noOpLog", True),
        ("opLogKeepDays", -1),
        ("cpnEnabled", True),
        ("cpnDispatchPeriod", -5),
        ("trafficPlanPausedOnFailedPlan", True),
        ("trafficDevConfigStr", "x" * 5_000),
    ],
)
async def test_a_setting_without_effect_is_refused_and_says_why(field: str, value: object) -> None:
    there = site()
    told = (await there.get(CONFIG)).json()
    answer = await there.post(CONFIG, {"parkingPaused": True, field: value})
    assert answer.status_code == 400
    no = answer.json()
    assert no["code"] == "errSceneConfigUnsupported"
    assert no["args"] == [field, told[field]]
    assert field in no["message"] and ", for " in no["message"]
    assert (await there.get(CONFIG)).json() == told


async def test_the_time_before_parking_is_taken_and_not_in_the_catalogues_answer() -> None:
    there = site()
    assert (await there.post(f"{CONFIG}/patch", {"parkIdleTime": 99})).content == b""
    assert there.handler.fleet.scenes[SCENE].config.parking_idle_s == 99
    assert "parkIdleTime" not in (await there.get(CONFIG)).json()


async def test_a_scene_is_made_and_filled_by_its_file() -> None:
    there = site()
    made = await there.post(f"{FOLDER}/create", {"name": "grid"})
    assert made.status_code == 200
    filled = await there.post(IMPORT, msgspec.json.encode(grid(robots=2)))
    assert filled.json() == made.json()
    assert len(there.handler.fleet.robots) == 2
    again = await there.post(f"{FOLDER}/create", {"name": "grid"})
    assert (again.status_code, again.json()["code"]) == (400, "errSceneNameTaken")


async def test_the_calls_about_a_scene_answer_without_a_body() -> None:
    there = site()
    scene = there.handler.fleet.scenes
    for path, body in (
        (f"{SCENE}/basic/patch", {"name": "hall", "displayOrder": 3}),
        (f"{SCENE}/disable", {"disabled": True}),
        (f"{SCENE}/dispatch-pause", {"paused": True}),
        (f"{SCENE}/config/patch", {"parkingPaused": True}),
    ):
        answer = await there.post(f"{FOLDER}/{path}", body)
        assert (answer.status_code, answer.content) == (200, b""), path
    now = scene[SCENE]
    assert (now.name, now.display_order, now.disabled, now.dispatch_paused) == (
        "hall", 3, True, True,
    )  # fmt: skip
    await there.post(f"{FOLDER}/{SCENE}/basic/patch", {"displayOrder": 4})
    assert (scene[SCENE].name, scene[SCENE].display_order) == ("hall", 4)
    answer = await there.post(f"{FOLDER}/remove", {"ids": [SCENE]})
    assert (answer.status_code, answer.content) == (200, b"")
    assert scene[SCENE].removed
    for path, body in (("disable", {"disabled": False}), ("config/patch", {})):
        answer = await there.post(f"{FOLDER}/{SCENE}/{path}", body)
        assert (answer.status_code, answer.json()["code"]) == (400, "errSceneNotFound")
    assert (await there.get(CONFIG)).status_code == 400


@pytest.mark.parametrize(
    ("path", "body", "field"),
    [
        ("create", {}, "name"),
        ("create", {"name": ""}, "name"),
        ("create", {"name": "x" * 201}, "name"),
        ("create", {"name": 7}, "name"),
        ("remove", {}, "ids"),
        ("remove", {"ids": ["nowhere"]}, "nowhere"),
        ("remove", {"ids": SCENE}, "ids"),
        ("remove", {"ids": [SCENE, "nowhere"]}, "nowhere"),
        (f"{SCENE}/disable", {}, "disabled"),
        (f"{SCENE}/disable", {"disabled": "yes"}, "disabled"),
        (f"{SCENE}/dispatch-pause", {"paused": None}, "paused"),
        (f"{SCENE}/basic/patch", {"displayOrder": 2**31}, "displayOrder"),
        (f"{SCENE}/basic/patch", {"name": "\t"}, "name"),
        ("%20/disable", {"disabled": True}, "sceneId"),
    ],
)
async def test_what_is_wrong_with_a_call_about_scenes_is_named(
    path: str, body: object, field: str
) -> None:
    there = site()
    answer = await there.post(f"{FOLDER}/{path}", body)
    assert answer.status_code == 400
    assert field in answer.json()["message"]
    assert there.handler.fleet.position == 1


async def test_a_repeated_key_makes_one_scene() -> None:
    there = site()
    key = {"Idempotency-Key": "k"}
    first = await there.post(f"{FOLDER}/create", {"name": "new"}, headers=key)
    again = await there.post(f"{FOLDER}/create", {"name": "new"}, headers=key)
    assert first.json() == again.json()
    assert len(there.handler.fleet.scenes) == 2
