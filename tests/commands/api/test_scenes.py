import msgspec

from commands.api.m4_scene_config import _LEVELS, _SETTINGS, wire
from ledger.scene_config import ChargingLevels, SceneConfig
from tests.commands.api.application import site
from tests.commands.site import SCENE
from tests.strategies import grid

IMPORT = "/api/fleet/scenes/import"
CONFIG = f"/api/fleet/scenes/{SCENE}/config"
NOT_OF_THE_WIRE = {"parking_idle_s"}  # no name in the specification's SceneConfig


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
    structured = {"dispatch_sort", "charging"}
    fields = set(SceneConfig.__struct_fields__) - structured - NOT_OF_THE_WIRE
    assert set(_SETTINGS.values()) == fields
    assert set(_LEVELS.values()) == set(ChargingLevels.__struct_fields__)
    assert len(wire(SceneConfig())) == len(_SETTINGS) + 2


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
        "trafficMethod": "Venus",
        "dispatchSort": ["a"],
        "chargingConfig": charging,
    }
    answer = await there.post(CONFIG, body)
    assert (answer.status_code, answer.content) == (200, b"")
    config = there.handler.fleet.scenes[SCENE].config
    assert config.parking_paused
    assert config.dispatch_sort == ("a",)
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
