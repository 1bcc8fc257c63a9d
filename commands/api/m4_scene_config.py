"""Wire model of the scene settings (spec/m4.md, SceneConfig), and both translations."""

from typing import Annotated, Any, TypeVar

import msgspec
from pydantic import Field

from commands.api.m4_models import Int, Remark, Text, Wire
from ledger.scene_config import (
    ChargingConfig,
    ChargingLevels,
    CollisionCheckMode,
    DispatchMethod,
    SceneConfig,
    TrafficMethod,
)

LONG_MAX = 10**12  # of intervals and waits: more than thirty years of milliseconds
GROUPS_MAX = 1_000

Ratio = Annotated[float, Field(ge=0, le=1)]
Metres = Annotated[float, Field(ge=0, le=10_000)]
Natural = Annotated[int, Field(ge=0, le=LONG_MAX)]
Weight = Annotated[float, Field(ge=1, le=1_000)]


class BasicChargingConfig(Wire):
    """When a robot charges; chargeOnly <= chargeNeed <= chargeOk <= chargeFull."""

    chargeOnly: Ratio | None = Field(None, description="Below: only charges, up to chargeOk.")
    chargeNeed: Ratio | None = Field(None, description="Below: charges when idle.")
    chargeOk: Ratio | None = Field(None, description="A forced charge ends here at the earliest.")
    chargeFull: Ratio | None = Field(None, description="Above: leaves the charger.")
    minChargingTime: Int | None = Field(None, ge=0, description="Shortest charge, s.")
    idleTime: Int | None = Field(None, ge=0, description="Idle before it charges, s.")

    def levels(self, before: ChargingLevels) -> ChargingLevels:
        """Translate; what is absent stays."""
        return _patched(before, self, _LEVELS)


class SceneChargingConfig(Wire):
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


class SceneConfigPatch(Wire):
    """Settings of a scene. In a change, what is absent or null stays as it is."""

    robotStateFetchDelay: Annotated[int, Field(ge=10, le=60_000)] | None = Field(
        None, description="Interval of fetching robot states, ms."
    )
    robotStateFailureNumToAutoConnect: Int | None = Field(
        None, ge=1, description="Failed reads in a row before connecting anew."
    )
    robotStateErrorToAutoReconnectMax: Int | None = Field(
        None, ge=0, description="Automatic reconnections in a row before giving up."
    )
    noOpLog: bool | None = Field(None, description="No run log.")
    opLogKeepDays: Annotated[int, Field(ge=0, le=36_500)] | None = Field(
        None, description="Days to keep the run log."
    )
    noRbkMsgLog: bool | None = Field(None, description="Do not log messages of robots.")
    dispatchMethod: DispatchMethod | None = Field(None, description="Assignment strategy.")
    withdrawnMinCost: Annotated[float, Field(ge=0, le=1e9)] | None = Field(
        None, description="Difference in cost that is worth re-assigning an order, s."
    )
    robotPlanPausedOnSelfReportErrorOrFatal: bool | None = Field(
        None, description="A robot that reports an Error or Fatal gets no orders."
    )
    notCancelRobot: bool | None = Field(
        None, description="Do not tell the robot when an executing step is cancelled."
    )
    parkingCollisionCheckMode: CollisionCheckMode | None = Field(
        None, description="Collision check for parking and charging."
    )
    parkingPaused: bool | None = Field(None, description="No parking orders.")
    noReallocation: bool | None = Field(None, description="Orders are not re-assigned.")
    dispatchSort: Annotated[list[Text], Field(max_length=50)] | None = Field(
        None, description="Sorting of assignment."
    )
    dispatchAcceptableTimeout: Natural | None = Field(
        None, description="An order that waited longer goes first, s."
    )
    chargingPaused: bool | None = Field(None, description="No charging orders.")
    chargingConfig: SceneChargingConfig | None = Field(None, description="Charging levels.")
    cpnEnabled: bool | None = Field(None, description="Optical communication is on.")
    cpnDispatchPeriod: Natural | None = Field(None, description="Its dispatch period.")
    trafficPlanPaused: bool | None = Field(None, description="No new moves are planned.")
    trafficPlanPausedOnFailedPlan: bool | None = Field(
        None, description="A failed plan pauses planning."
    )
    closePointDistance: Metres | None = Field(
        None, description="How far from a point a robot still counts as on it, m."
    )
    closePathDistance: Metres | None = Field(
        None, description="How far from a path a robot still counts as on it, m."
    )
    trafficPlanIntervalMs: Annotated[int, Field(ge=1, le=3_600_000)] | None = Field(
        None, description="Interval of re-planning of TP1, ms."
    )
    trafficDevConfigStr: Remark | None = Field(None, description="Advanced traffic settings.")
    cbsHighW: Weight | None = Field(None, description="TP2: weight of the high level search.")
    cbsLowW: Weight | None = Field(None, description="TP2: weight of the low level search.")
    linkMinDistance: Metres | None = Field(
        None, description="TP1: smallest distance of pushing a deadlock ring, m."
    )
    linkMaxDistance: Metres | None = Field(
        None, description="TP1: largest distance of pushing a deadlock ring, m."
    )
    reverseDeadlock: bool | None = Field(None, description="TP1: reverse out of deadlocks.")
    enablePrevent: bool | None = Field(None, description="TP1: deadlock prevention is on.")
    preRotate: bool | None = Field(None, description="TP1: ask for the turning circle ahead.")
    trafficMethod: TrafficMethod | None = Field(
        None, description="Planner: Distributed = TP1, Venus = TP2."
    )
    selectConfig: Remark | None = Field(None, description="Settings of selecting elements.")

    def config(self, before: SceneConfig) -> SceneConfig:
        """Translate; what is absent stays."""
        after = _patched(before, self, _SETTINGS)
        if self.dispatchSort is not None:
            after = msgspec.structs.replace(after, dispatch_sort=tuple(self.dispatchSort))
        if self.chargingConfig is not None:
            charging = self.chargingConfig.charging(before.charging)
            after = msgspec.structs.replace(after, charging=charging)
        return after


_LEVELS = {
    "chargeOnly": "charge_only",
    "chargeNeed": "charge_need",
    "chargeOk": "charge_ok",
    "chargeFull": "charge_full",
    "minChargingTime": "charging_min_s",
    "idleTime": "idle_s",
}
_SETTINGS = {
    "robotStateFetchDelay": "state_fetch_ms",
    "robotStateFailureNumToAutoConnect": "state_failures_to_reconnect",
    "robotStateErrorToAutoReconnectMax": "reconnects_max",
    "noOpLog": "operation_log_off",
    "opLogKeepDays": "operation_log_days",
    "noRbkMsgLog": "robot_message_log_off",
    "dispatchMethod": "dispatch_method",
    "withdrawnMinCost": "withdrawn_cost_min",
    "robotPlanPausedOnSelfReportErrorOrFatal": "pause_on_robot_error",
    "notCancelRobot": "keep_robot_on_cancel",
    "parkingCollisionCheckMode": "parking_collision_check",
    "parkingPaused": "parking_paused",
    "noReallocation": "reallocation_off",
    "dispatchAcceptableTimeout": "dispatch_wait_s_max",
    "chargingPaused": "charging_paused",
    "cpnEnabled": "optical_on",
    "cpnDispatchPeriod": "optical_dispatch_period",
    "trafficPlanPaused": "traffic_paused",
    "trafficPlanPausedOnFailedPlan": "traffic_pause_on_failed_plan",
    "closePointDistance": "point_distance_m",
    "closePathDistance": "path_distance_m",
    "trafficPlanIntervalMs": "traffic_plan_interval_ms",
    "trafficDevConfigStr": "traffic_settings",
    "cbsHighW": "cbs_high_w",
    "cbsLowW": "cbs_low_w",
    "linkMinDistance": "push_distance_m_min",
    "linkMaxDistance": "push_distance_m_max",
    "reverseDeadlock": "reverse_out_of_deadlock",
    "enablePrevent": "deadlock_prevention",
    "preRotate": "turn_ahead",
    "trafficMethod": "traffic_method",
    "selectConfig": "selection",
}


def wire(config: SceneConfig) -> dict[str, Any]:
    """Spell all settings as the specification does."""
    by_group = {str(g): _spelt(c, _LEVELS) for g, c in config.charging.by_group.items()}
    return {
        **_spelt(config, _SETTINGS),
        "dispatchSort": list(config.dispatch_sort),
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
