"""Settings: what takes effect is taken, what does not is refused, and the list of them is whole."""

from typing import Any

import msgspec
import pytest
from hypothesis import given as forall

from commands.rejected import Reason
from commands.scene_config import ConfigureScene
from commands.scene_settings import CHARGING, FIXED, SETTINGS, Setting, in_force
from commands.scenes import ImportScene, scene_digest
from ledger.events import SceneConfigured, SceneDisabled, SceneRemoved
from ledger.ids import SceneId
from ledger.scene_config import ChargingConfig, ChargingLevels, SceneConfig
from tests.commands.site import R1, SCENE, opened
from tests.scenario import ask, given
from tests.strategies import grid, values

replace = msgspec.structs.replace
OTHER: dict[str, Any] = {
    "operation_log_off": True,
    "operation_log_days": 31,
    "optical_on": True,
    "optical_dispatch_period": 1,
    "traffic_pause_on_failed_plan": True,
    "traffic_settings": "x",
}
_FIXED = [s for s in SETTINGS if s.field in OTHER]


def configure(config: SceneConfig) -> object:
    return ask(ConfigureScene, scene=SCENE, config=config)


def test_the_list_has_every_setting_once() -> None:
    structured = {"charging"}
    assert sorted(s.field for s in SETTINGS) == sorted(
        set(SceneConfig.__struct_fields__) - structured
    )
    assert sorted(s.field for s in CHARGING) == sorted(ChargingLevels.__struct_fields__)
    for setting in (*SETTINGS, *CHARGING):
        assert bool(setting.effect) != bool(setting.fixed), setting.name
    assert FIXED.keys() - OTHER.keys() == {"parking_collision_check"}  # has one value by its type


def test_settings_are_replaced_and_only_news_is_stated() -> None:
    config = SceneConfig(parking_paused=True)
    event = SceneConfigured(scene=SCENE, config=config)
    given(*opened(R1)).when(configure(config)).then(event)
    given(*opened(R1), event).when(configure(config)).nothing()


def test_a_scene_out_of_service_can_be_configured_and_a_removed_one_cannot() -> None:
    config = SceneConfig(parking_paused=True)
    disabled = given(*opened(), SceneDisabled(scene=SCENE))
    disabled.when(configure(config)).then(SceneConfigured(scene=SCENE, config=config))
    removed = given(*opened(), SceneRemoved(scene=SCENE))
    removed.when(configure(config)).rejected(Reason.SCENE_UNKNOWN)


@pytest.mark.parametrize("setting", _FIXED, ids=lambda s: s.name)
def test_what_nobody_would_obey_is_refused_with_the_reason(setting: Setting) -> None:
    config = replace(SceneConfig(), **{setting.field: OTHER[setting.field]})
    only = msgspec.json.encode(FIXED[setting.field]).decode()
    words = (setting.name, setting.field, only, setting.fixed)
    given(*opened()).when(configure(config)).rejected(Reason.SCENE_CONFIG_UNSUPPORTED, *words)
    file = replace(grid(), config=config)
    taken = ask(ImportScene, scene=SceneId("1" * 24), digest=scene_digest(file), file=file)
    given().when(taken).rejected(Reason.SCENE_CONFIG_UNSUPPORTED, *words)


def test_what_older_ledgers_hold_unheard_is_told_and_taken_as_it_is_obeyed() -> None:
    old = replace(SceneConfig(operation_log_days=7), parking_paused=True)
    scene = given(*opened(), SceneConfigured(scene=SCENE, config=old))
    told = in_force(old)
    assert told == SceneConfig(parking_paused=True)
    scene.when(configure(told)).nothing()
    scene.when(configure(old)).rejected(Reason.SCENE_CONFIG_UNSUPPORTED, "opLogKeepDays")


@forall(values(SceneConfig))
def test_settings_in_force_are_refused_for_their_bounds_alone(config: SceneConfig) -> None:
    calm = replace(in_force(config), charging=ChargingConfig(), dispatch_sort=(), selection="")
    inside = all(
        s.bounds is None or s.bounds[0] <= getattr(calm, s.field) <= s.bounds[1] for s in SETTINGS
    )
    outcome = given(*opened()).when(configure(calm))
    if not inside:
        outcome.rejected(Reason.SCENE_CONFIG_INVALID)
    elif calm == SceneConfig():
        outcome.nothing()
    else:
        outcome.then(SceneConfigured(scene=SCENE, config=calm))


@pytest.mark.parametrize(
    "sort", [("priority",), ("-priority", "createdOn"), ("externalId", "-id"), ()]
)
def test_orders_can_be_sorted_by_what_dispatch_knows(sort: tuple[str, ...]) -> None:
    config = SceneConfig(dispatch_sort=sort)
    outcome = given(*opened()).when(configure(config))
    outcome.then(*([SceneConfigured(scene=SCENE, config=config)] if sort else []))


@pytest.mark.parametrize("sort", [("",), ("-",), ("--id",), ("priority", "status"), ("id",) * 51])
def test_a_sorting_that_dispatch_does_not_know_is_refused(sort: tuple[str, ...]) -> None:
    config = SceneConfig(dispatch_sort=sort)
    given(*opened()).when(configure(config)).rejected(Reason.SCENE_CONFIG_INVALID, "dispatchSort")


def test_a_clients_own_text_has_a_limit() -> None:
    given(*opened()).when(configure(SceneConfig(selection="x" * 2_001))).rejected(
        Reason.SCENE_CONFIG_INVALID, "selectConfig"
    )


@pytest.mark.parametrize(
    "levels",
    [
        ChargingLevels(charge_only=0.5, charge_need=0.4),
        ChargingLevels(charge_need=0.9),
        ChargingLevels(charge_ok=0.99),
        ChargingLevels(charge_full=1.01),
        ChargingLevels(charge_only=-0.1),
        ChargingLevels(charge_only=float("nan")),
        ChargingLevels(idle_s=-1),
        ChargingLevels(charging_min_s=2**31),
    ],
)
def test_charging_levels_must_be_in_order(levels: ChargingLevels) -> None:
    everywhere = SceneConfig(charging=ChargingConfig(default=levels))
    given(*opened()).when(configure(everywhere)).rejected(
        Reason.SCENE_CONFIG_INVALID, "defaultConfig"
    )
    one_group = SceneConfig(charging=ChargingConfig(by_group={1: levels}))
    given(*opened()).when(configure(one_group)).rejected(
        Reason.SCENE_CONFIG_INVALID, "groupedConfigs.1"
    )


def test_levels_are_for_groups_that_exist() -> None:
    config = SceneConfig(charging=ChargingConfig(by_group={7: ChargingLevels()}))
    given(*opened()).when(configure(config)).rejected(Reason.GROUP_UNKNOWN, "7")
    file = replace(grid(), config=config)
    taken = ask(ImportScene, scene=SceneId("1" * 24), digest=scene_digest(file), file=file)
    given().when(taken).rejected(Reason.GROUP_UNKNOWN, "7")


def test_a_bound_of_the_wire_is_not_a_float_in_words() -> None:
    config = SceneConfig(traffic_plan_interval_ms=0)
    given(*opened()).when(configure(config)).rejected(
        Reason.SCENE_CONFIG_INVALID, "'trafficPlanIntervalMs' must be from 1 to 3600000"
    )
