"""Wire model of the scene settings (spec/m4.md, SceneConfig), and both translations.

Unknown fields are refused here, unlike elsewhere: a setting that is not heard must not seem to be.
"""

from typing import Annotated, Any, TypeVar

import msgspec
from pydantic import ConfigDict, Field

from commands.api.m4_models import Int, Text, Wire
from commands.scene_settings import (
    CHARGING,
    COST_S_MAX,
    DISTANCE_M_MAX,
    LONG_MAX,
    PUSH_M_MAX,
    SELECTION_CHARS_MAX,
    SETTINGS,
    SORT_FIELDS_MAX,
    WEIGHT_MAX,
    Setting,
    in_force,
    only_value,
)
from ledger.scene_config import (
    ChargingConfig,
    ChargingLevels,
    CollisionCheckMode,
    DispatchMethod,
    SceneConfig,
    TrafficMethod,
)

GROUPS_MAX = 1_000
NOT_OF_THE_CATALOGUE = "parkIdleTime"  # told under the schema's newConfig only

Ratio = Annotated[float, Field(ge=0, le=1)]
Metres = Annotated[float, Field(ge=0, le=DISTANCE_M_MAX)]
Seconds = Annotated[int, Field(ge=0, le=LONG_MAX)]
Selection = Annotated[str, Field(max_length=SELECTION_CHARS_MAX)]
SortFields = Annotated[list[Text], Field(max_length=SORT_FIELDS_MAX)]

_LEVELS = {setting.name: setting.field for setting in CHARGING}
_SETTINGS = {setting.name: setting.field for setting in SETTINGS}
_STRUCTURED = {"dispatchSort"}  # a list on the wire
_KNOWN = {setting.name: setting for setting in (*SETTINGS, *CHARGING)}


def _says(name: str) -> Any:
    """Describe an optional field by what its setting does, or why it cannot be changed."""
    setting = _KNOWN[name]
    return Field(None, description=_words(setting))


def _words(setting: Setting) -> str:
    unit = f" ({setting.unit})" if setting.unit else ""
    if setting.fixed:
        return f"Not supported but for {only_value(setting)}{unit}: {setting.fixed}."
    return f"{setting.effect}{unit}"


class Settings(Wire):
    """Base: what is not known is refused."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class BasicChargingConfig(Settings):
    """When a robot charges; chargeOnly <= chargeNeed <= chargeOk <= chargeFull."""

    chargeOnly: Ratio | None = _says("chargeOnly")
    chargeNeed: Ratio | None = _says("chargeNeed")
    chargeOk: Ratio | None = _says("chargeOk")
    chargeFull: Ratio | None = _says("chargeFull")
    minChargingTime: Annotated[Int, Field(ge=0)] | None = _says("minChargingTime")
    idleTime: Annotated[Int, Field(ge=0)] | None = _says("idleTime")

    def levels(self, before: ChargingLevels) -> ChargingLevels:
        """Translate; what is absent stays."""
        return _patched(before, self, _LEVELS)


class SceneChargingConfig(Settings):
    """Charging levels, by robot group where they differ."""

    defaultConfig: BasicChargingConfig | None = Field(None, description="For all other groups.")
    groupedConfigs: dict[int, BasicChargingConfig] | None = Field(
        None, max_length=GROUPS_MAX, description="By group id; replaces the whole map if given."
    )

    def charging(self, before: ChargingConfig) -> ChargingConfig:
        """Translate; what a group's levels leave open is as before, or as in the default."""
        default = before.default
        if self.defaultConfig is not None:
            default = self.defaultConfig.levels(default)
        by_group = before.by_group
        if self.groupedConfigs is not None:
            by_group = {
                group: levels.levels(before.by_group.get(group, default))
                for group, levels in self.groupedConfigs.items()
            }
        return ChargingConfig(default=default, by_group=by_group)


class SceneConfigAll(Settings):
    """Settings of a scene (spec/m4.md §8). In an answer all are there."""

    robotStateFetchDelay: Annotated[int, Field(ge=10, le=60_000)] | None = _says(
        "robotStateFetchDelay"
    )
    robotStateFailureNumToAutoConnect: Annotated[Int, Field(ge=1)] | None = _says(
        "robotStateFailureNumToAutoConnect"
    )
    robotStateErrorToAutoReconnectMax: Annotated[Int, Field(ge=0)] | None = _says(
        "robotStateErrorToAutoReconnectMax"
    )
    noOpLog: bool | None = _says("noOpLog")
    opLogKeepDays: Int | None = _says("opLogKeepDays")
    noRbkMsgLog: bool | None = _says("noRbkMsgLog")
    dispatchMethod: DispatchMethod | None = _says("dispatchMethod")
    withdrawnMinCost: Annotated[float, Field(ge=0, le=COST_S_MAX)] | None = _says(
        "withdrawnMinCost"
    )
    robotPlanPausedOnSelfReportErrorOrFatal: bool | None = _says(
        "robotPlanPausedOnSelfReportErrorOrFatal"
    )
    notCancelRobot: bool | None = _says("notCancelRobot")
    parkingCollisionCheckMode: CollisionCheckMode | None = _says("parkingCollisionCheckMode")
    parkingPaused: bool | None = _says("parkingPaused")
    noReallocation: bool | None = _says("noReallocation")
    dispatchSort: SortFields | None = _says("dispatchSort")
    dispatchAcceptableTimeout: Seconds | None = _says("dispatchAcceptableTimeout")
    chargingPaused: bool | None = _says("chargingPaused")
    chargingConfig: SceneChargingConfig | None = Field(None, description="When robots charge.")
    cpnEnabled: bool | None = _says("cpnEnabled")
    cpnDispatchPeriod: int | None = _says("cpnDispatchPeriod")
    trafficPlanPaused: bool | None = _says("trafficPlanPaused")
    trafficPlanPausedOnFailedPlan: bool | None = _says("trafficPlanPausedOnFailedPlan")
    closePointDistance: Metres | None = _says("closePointDistance")
    closePathDistance: Metres | None = _says("closePathDistance")
    trafficPlanIntervalMs: Annotated[int, Field(ge=1, le=3_600_000)] | None = _says(
        "trafficPlanIntervalMs"
    )
    trafficDevConfigStr: str | None = _says("trafficDevConfigStr")
    cbsHighW: Annotated[float, Field(ge=1, le=WEIGHT_MAX)] | None = _says("cbsHighW")
    cbsLowW: Annotated[float, Field(ge=1, le=WEIGHT_MAX)] | None = _says("cbsLowW")
    linkMinDistance: Annotated[float, Field(ge=0, le=PUSH_M_MAX)] | None = _says("linkMinDistance")
    linkMaxDistance: Annotated[float, Field(ge=0, le=PUSH_M_MAX)] | None = _says("linkMaxDistance")
    reverseDeadlock: bool | None = _says("reverseDeadlock")
    enablePrevent: bool | None = _says("enablePrevent")
    preRotate: bool | None = _says("preRotate")
    trafficMethod: TrafficMethod | None = _says("trafficMethod")
    selectConfig: Selection | None = _says("selectConfig")


class SceneConfigPatch(SceneConfigAll):
    """Settings of a scene that are to change; what is absent or null stays as it is."""

    parkIdleTime: Annotated[Int, Field(ge=0)] | None = _says("parkIdleTime")

    def config(self, before: SceneConfig) -> SceneConfig:
        """Translate; what is absent stays."""
        before = in_force(before)
        flat = {name: field for name, field in _SETTINGS.items() if name not in _STRUCTURED}
        after = _patched(before, self, flat)
        if self.dispatchSort is not None:
            sort = tuple(name.removeprefix("+") for name in self.dispatchSort)
            after = msgspec.structs.replace(after, dispatch_sort=sort)
        if self.chargingConfig is not None:
            charging = self.chargingConfig.charging(before.charging)
            after = msgspec.structs.replace(after, charging=charging)
        return after


def wire(config: SceneConfig) -> dict[str, Any]:
    """Spell the settings of the specification's SceneConfig, as they are obeyed."""
    said = wire_whole(config)
    del said[NOT_OF_THE_CATALOGUE]
    return said


def wire_whole(config: SceneConfig) -> dict[str, Any]:
    """Spell all settings (spec/protocols.md 1.6, newConfig)."""
    by_group = {str(g): _spelt(c, _LEVELS) for g, c in config.charging.by_group.items()}
    return {
        **_spelt(in_force(config), _SETTINGS),
        "chargingConfig": {
            "defaultConfig": _spelt(config.charging.default, _LEVELS),
            "groupedConfigs": by_group,
        },
    }


S = TypeVar("S", bound=msgspec.Struct)


def _spelt(values: msgspec.Struct, names: dict[str, str]) -> dict[str, Any]:
    return {name: getattr(values, field) for name, field in names.items()}


def _patched(before: S, patch: Wire, names: dict[str, str]) -> S:
    given = {field: getattr(patch, name) for name, field in names.items()}
    return msgspec.structs.replace(before, **{f: v for f, v in given.items() if v is not None})
