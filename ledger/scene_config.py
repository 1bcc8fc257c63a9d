"""Settings of a scene (spec/m4.md, SceneConfig and its charging part); durations in their names."""

from enum import StrEnum

import msgspec


class DispatchMethod(StrEnum):
    """How robots are matched to orders."""

    KM = "KM"  # one optimal matching (Kuhn-Munkres)
    GREEDY = "Greedy"  # the best robot for each order in turn


class TrafficMethod(StrEnum):
    """Which planner proposes the order of moves."""

    DISTRIBUTED = "Distributed"
    VENUS = "Venus"


# fields of an order that `dispatch_sort` may name, each with - before it for descending order
DISPATCH_SORT_FIELDS = ("priority", "createdOn", "externalId", "id")


class CollisionCheckMode(StrEnum):
    """Collision check for parking and charging; the specification has one value."""

    NONE = "None"


class ChargingLevels(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """When a robot charges; levels are ratios 0-1, only <= need <= ok <= full."""

    charge_only: float = 0.15  # below: takes no order, charges at least to charge_ok
    charge_need: float = 0.3  # below: charges when idle, may still take orders
    charge_ok: float = 0.8  # a forced charge ends here at the earliest
    charge_full: float = 0.98  # above: leaves the charger
    charging_min_s: int = 60
    idle_s: int = 10  # idle time before a charging order is made


class ChargingConfig(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Charging levels, by robot group where they differ."""

    default: ChargingLevels = ChargingLevels()
    by_group: dict[int, ChargingLevels] = {}  # msgspec copies the default for each instance


class SceneConfig(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Settings of one scene. Defaults where the source states none are ours."""

    state_fetch_ms: int = 1_000  # robotStateFetchDelay: a robot reports at least so often
    state_failures_to_reconnect: int = 10  # reports missed in a row: it counts as lost
    reconnects_max: int = 5  # in a row; then a person must ask
    operation_log_off: bool = False
    operation_log_days: int = 30
    robot_message_log_off: bool = False
    dispatch_method: DispatchMethod = DispatchMethod.KM
    withdrawn_cost_min: float = 5.0  # withdrawnMinCost, in the unit of costs: seconds
    pause_on_robot_error: bool = True
    keep_robot_on_cancel: bool = False  # notCancelRobot
    parking_collision_check: CollisionCheckMode = CollisionCheckMode.NONE
    parking_paused: bool = False
    reallocation_off: bool = False
    dispatch_sort: tuple[str, ...] = ()  # DISPATCH_SORT_FIELDS; none = by priority, then oldest
    dispatch_wait_s_max: int = 600  # dispatchAcceptableTimeout: who waited longer comes first
    charging_paused: bool = False
    charging: ChargingConfig = ChargingConfig()
    optical_on: bool = False  # cpnEnabled
    optical_dispatch_period: int = 0  # cpnDispatchPeriod, unit not stated in the source
    traffic_paused: bool = False
    traffic_pause_on_failed_plan: bool = False
    point_distance_m: float = 0.3  # closePointDistance
    path_distance_m: float = 0.3  # closePathDistance
    traffic_plan_interval_ms: int = 5000
    traffic_settings: str = ""  # trafficDevConfigStr
    cbs_high_w: float = 1.5
    cbs_low_w: float = 1.2
    push_distance_m_min: float = 0.0  # linkMinDistance
    push_distance_m_max: float = 50.0  # linkMaxDistance
    reverse_out_of_deadlock: bool = False
    deadlock_prevention: bool = True
    turn_ahead: bool = True  # preRotate
    traffic_method: TrafficMethod = TrafficMethod.DISTRIBUTED
    selection: str = ""  # selectConfig
    parking_idle_s: int = 10  # idle time before a parking order is made (M4 parkIdleTime)
