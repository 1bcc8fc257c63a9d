"""Settings of a scene: which take effect and how, and which have one value only, and why.

The one list of them: wire models, refusals and `docs/settings.md` speak from it.
"""

import msgspec

from ledger.scene import Value
from ledger.scene_config import DISPATCH_SORT_FIELDS, SceneConfig

LONG_MAX = 10**12  # of waits: more than thirty years of milliseconds
INT_MAX = 2**31 - 1
COST_S_MAX = 1e9
WEIGHT_MAX = 100.0  # beyond it no plan is too dear
DISTANCE_M_MAX = 2.0  # beyond it a robot would count as on points that are not its own
PUSH_M_MAX = 10_000.0  # larger than any building
SORT_FIELDS_MAX = 50
SELECTION_CHARS_MAX = 2_000


class Setting(Value, frozen=True, kw_only=True):
    """One setting: its names, and what it does or why it does not."""

    name: str  # clients' word (spec/m4.md, SceneConfig)
    field: str  # ours, as in scene files
    effect: str = ""
    fixed: str = ""  # why the default is the only value; empty = it takes effect
    unit: str = ""
    bounds: tuple[float, float] | None = None  # both allowed


_NO_OPTICS = "there is no optical communication"

SETTINGS = (
    Setting(
        name="robotStateFetchDelay",
        field="state_fetch_ms",
        unit="ms",
        bounds=(10, 60_000),
        effect="A robot says how it is at least so often, and oftener while it moves.",
    ),
    Setting(
        name="robotStateFailureNumToAutoConnect",
        field="state_failures_to_reconnect",
        bounds=(1, INT_MAX),
        effect="After so many reports missed in a row, and 2 s at the least, a robot counts as "
        "offline and is reached for again.",
    ),
    Setting(
        name="robotStateErrorToAutoReconnectMax",
        field="reconnects_max",
        bounds=(0, INT_MAX),
        effect="After so many vain attempts in a row to reach it a robot is given up (`noAc`) "
        "until `robots/reconnect`.",
    ),
    Setting(
        name="noOpLog",
        field="operation_log_off",
        fixed="every operation is an event of the ledger, which is never off",
    ),
    Setting(
        name="opLogKeepDays",
        field="operation_log_days",
        unit="days",
        fixed="the ledger is kept for ever",
    ),
    Setting(
        name="noRbkMsgLog",
        field="robot_message_log_off",
        effect="True: what the scene's robots report is not kept in the telemetry log, so replays "
        "of that time show no robots.",
    ),
    Setting(
        name="dispatchMethod",
        field="dispatch_method",
        effect="`KM` matches waiting orders and free robots at once, at the least cost; `Greedy` "
        "gives each order in turn its best robot.",
    ),
    Setting(
        name="withdrawnMinCost",
        field="withdrawn_cost_min",
        unit="s",
        bounds=(0, COST_S_MAX),
        effect="An order goes over to another robot only if that saves so much.",
    ),
    Setting(
        name="robotPlanPausedOnSelfReportErrorOrFatal",
        field="pause_on_robot_error",
        effect="True: a robot that reports an Error or Fatal gets no orders.",
    ),
    Setting(
        name="notCancelRobot",
        field="keep_robot_on_cancel",
        effect="True: what a robot does for an order that is cancelled is not called off; it "
        "finishes that first.",
    ),
    Setting(
        name="parkingCollisionCheckMode",
        field="parking_collision_check",
        fixed="the specification has no other value, and traffic keeps robots apart everywhere",
    ),
    Setting(
        name="parkingPaused",
        field="parking_paused",
        effect="True: no parking orders are made.",
    ),
    Setting(
        name="noReallocation",
        field="reallocation_off",
        effect="True: an order stays with its robot, unless that is disabled.",
    ),
    Setting(
        name="dispatchSort",
        field="dispatch_sort",
        effect="In what order waiting orders are taken: fields of "
        f"{', '.join(f'`{f}`' for f in DISPATCH_SORT_FIELDS)}, `-` in front = descending; empty = "
        "higher priority first. Among equals the cheapest way wins.",
    ),
    Setting(
        name="dispatchAcceptableTimeout",
        field="dispatch_wait_s_max",
        unit="s",
        bounds=(0, LONG_MAX),
        effect="Orders that have waited longer go before all others, or where dispatchSort is "
        "empty before the others of their priority.",
    ),
    Setting(
        name="chargingPaused",
        field="charging_paused",
        effect="True: no charging orders are made.",
    ),
    Setting(
        name="cpnEnabled",
        field="optical_on",
        fixed=_NO_OPTICS,
    ),
    Setting(
        name="cpnDispatchPeriod",
        field="optical_dispatch_period",
        fixed=_NO_OPTICS,
    ),
    Setting(
        name="trafficPlanPaused",
        field="traffic_paused",
        effect="True: no robot gets a new move; each drives to the end of what it was granted.",
    ),
    Setting(
        name="trafficPlanPausedOnFailedPlan",
        field="traffic_pause_on_failed_plan",
        fixed="a robot without a plan waits by itself, and the others need not wait for it",
    ),
    Setting(
        name="closePointDistance",
        field="point_distance_m",
        unit="m",
        bounds=(0, DISTANCE_M_MAX),
        effect="A robot within it of a point counts as standing on the point.",
    ),
    Setting(
        name="closePathDistance",
        field="path_distance_m",
        unit="m",
        bounds=(0, DISTANCE_M_MAX),
        effect="A robot within it of a path counts as being on the path.",
    ),
    Setting(
        name="trafficPlanIntervalMs",
        field="traffic_plan_interval_ms",
        unit="ms",
        bounds=(1, 3_600_000),
        effect="Plans are made anew at the latest after it, and at once whenever something has "
        "changed.",
    ),
    Setting(
        name="trafficDevConfigStr",
        field="traffic_settings",
        fixed="traffic has no settings beyond those of this table",
    ),
    Setting(
        name="cbsHighW",
        field="cbs_high_w",
        bounds=(1, WEIGHT_MAX),
        effect="Venus is content with a plan that costs all robots together so many times what "
        "each would take alone, and else looks for a cheaper one.",
    ),
    Setting(
        name="cbsLowW",
        field="cbs_low_w",
        bounds=(1, WEIGHT_MAX),
        effect="Under Venus a robot that cannot but meet others may take so many times its "
        "shortest time to meet fewer of them.",
    ),
    Setting(
        name="linkMinDistance",
        field="push_distance_m_min",
        unit="m",
        bounds=(0, PUSH_M_MAX),
        effect="A robot that is pushed out of another's way drives no less than this at one time.",
    ),
    Setting(
        name="linkMaxDistance",
        field="push_distance_m_max",
        unit="m",
        bounds=(0, PUSH_M_MAX),
        effect="And no more than this; 0: nobody is pushed.",
    ),
    Setting(
        name="reverseDeadlock",
        field="reverse_out_of_deadlock",
        effect="True: robots may also drive out of dead ends in reverse, over paths that the map "
        "has both ways.",
    ),
    Setting(
        name="enablePrevent",
        field="deadlock_prevention",
        effect="True: no robot takes the last free stop of a ring in which all wait for each "
        "other and nobody could move any more.",
    ),
    Setting(
        name="preRotate",
        field="turn_ahead",
        effect="True: where it will have to wait, a robot is granted the circle at the end of a "
        "move together with the move, and turns there for the way on; False: it asks for the "
        "circle when it drives on.",
    ),
    Setting(
        name="trafficMethod",
        field="traffic_method",
        effect="`Distributed`: who moves where next is decided at every event, by PIBT. `Venus`: "
        "routes are planned in time for half a minute ahead. A switch takes effect at once, and "
        "what is granted stands.",
    ),
    Setting(
        name="selectConfig",
        field="selection",
        effect="The client's own text: kept and given back; up to "
        f"{SELECTION_CHARS_MAX} characters.",
    ),
    Setting(
        name="parkIdleTime",
        field="parking_idle_s",
        unit="s",
        bounds=(0, INT_MAX),
        effect="A robot that has been idle for so long is sent to park. Answered in the "
        "schema's `newConfig` only.",
    ),
)

CHARGING = (
    Setting(
        name="chargeOnly",
        field="charge_only",
        unit="0-1",
        effect="Below it the robot takes no order and charges at once, at least to chargeOk.",
    ),
    Setting(
        name="chargeNeed",
        field="charge_need",
        unit="0-1",
        effect="Below it an idle robot charges; any order calls it away.",
    ),
    Setting(
        name="chargeOk",
        field="charge_ok",
        unit="0-1",
        effect="A charge that began below chargeOnly is not broken off for an order before it.",
    ),
    Setting(
        name="chargeFull",
        field="charge_full",
        unit="0-1",
        effect="Charging ends here, and the robot leaves the charger to park.",
    ),
    Setting(
        name="minChargingTime",
        field="charging_min_s",
        unit="s",
        bounds=(0, INT_MAX),
        effect="A charge is not broken off for an order before it has lasted so long.",
    ),
    Setting(
        name="idleTime",
        field="idle_s",
        unit="s",
        bounds=(0, INT_MAX),
        effect="Below chargeNeed a robot charges when it has been idle for so long.",
    ),
)

_DEFAULT = SceneConfig()
FIXED = {s.field: getattr(_DEFAULT, s.field) for s in SETTINGS if s.fixed}


def in_force(config: SceneConfig) -> SceneConfig:
    """Give the settings as they are obeyed, which is how they are told.

    Ledgers of earlier releases hold values that were taken and never obeyed.
    """
    return msgspec.structs.replace(config, **FIXED)


def only_value(setting: Setting) -> str:
    """Spell the one value of a setting that has no other, as JSON."""
    return msgspec.json.encode(FIXED[setting.field]).decode()
