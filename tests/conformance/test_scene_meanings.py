"""What each field of an answered scene says: its status, its counts, its settings, its devices."""

from typing import Any

import msgspec
import pytest

from commands.api.m4_scene_config import wire
from ledger.evolve_resources import device_key
from ledger.ids import OrderId, PathKey, PointName, RobotName, SceneId
from ledger.link import DoorReport, DoorState, DoorStatus, LiftReport, Plan
from ledger.scene import Door, Lift, LiftFloor, RobotConfig, Scene
from ledger.scene_config import (
    ChargingConfig,
    ChargingLevels,
    DispatchMethod,
    SceneConfig,
    TrafficMethod,
)
from ledger.state import DeviceFault, DeviceKind, Fleet, OrderStatus, Robot, RobotBin
from ledger.waits import Wait, WaitReason
from projections.api.m4_scene_query import Beside, Look, field_value
from projections.devices import door_reports, lift_reports
from projections.live import Live
from tests.conformance.full import full_order

replace = msgspec.structs.replace
SCENE = SceneId("S")
HOUSE = Scene(
    id=SCENE,
    name="house",
    digest="",
    areas=(),
    groups=(),
    doors=(Door(id=7, name="gate", area=1, points=(PointName("A"),)),),
    lifts=(Lift(id=3, name="lift", floors=(LiftFloor(name="G", area=1),)),),
)
BESIDE = Beside(
    config=wire, doors=door_reports, lifts=lift_reports, map_resources=lambda fleet, scene: []
)
DOOR = DoorReport(scene=SCENE, door=7, at_ms=5, status=DoorStatus.CLOSED)
LIFT = LiftReport(scene=SCENE, lift=3, at_ms=6, floor="G", doors=(DoorStatus.CLOSED,))


def robot(name: str, *, online: bool = True) -> Robot:
    config = RobotConfig(name=RobotName(name))
    return Robot(scene=SCENE, config=config, online=online, bins=(RobotBin(),), idle_since_ms=0)


def plan(name: str, **fields: Any) -> Plan:
    whole: dict[str, Any] = {"ready": True} | fields
    return Plan(scene=SCENE, robot=RobotName(name), at_ms=0, **whole)


def look(**fields: Any) -> Look:
    whole: dict[str, Any] = {
        "fleet": Fleet(), "scene": HOUSE, "live": None, "plans": (), "orders": (), "at_ms": 9,
    }  # fmt: skip
    return Look(**whole | fields)


def says(field: str, **fields: Any) -> Any:
    return field_value(field, look(**fields), BESIDE)


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        ({}, "Initialized"),  # nobody is waited for
        ({"plans": ((robot("R1"), None),)}, "Initializing"),
        ({"plans": ((robot("R1", online=False), None),)}, "Initialized"),
        ({"plans": ((robot("R1"), plan("R1")), (robot("R2"), None))}, "Initialized"),
        ({"scene": replace(HOUSE, disabled=True)}, "Disabled"),
        ({"scene": replace(HOUSE, disabled=True, removed=True)}, "Disposed"),
    ],
)
def test_a_scene_has_a_status(fields: dict[str, Any], status: str) -> None:
    assert says("status", **fields) == status


def test_orders_are_counted_by_what_they_do() -> None:
    order = full_order()
    sound = {"fault_reason": None}
    orders = tuple(
        replace(order, id=OrderId(f"TO{n}"), status=status, **more)
        for n, (status, more) in enumerate(
            [
                (OrderStatus.EXECUTING, {}),
                (OrderStatus.EXECUTING, sound),
                (OrderStatus.EXECUTING, sound),
                (OrderStatus.PENDING, {}),
                (OrderStatus.TO_BE_ALLOCATED, sound),
            ]
        )
    )
    assert says("goingCount", orders=orders) == 3
    assert says("faultCount", orders=orders) == 2
    assert says("dispatchProfile", orders=orders) == {
        "ToBeAllocated": 1,
        "Allocated": 0,
        "Pending": 1,
        "Executing": 3,
    }
    records = says("ordersRecords", orders=orders)
    assert {id_: row["status"] for id_, row in records.items()} == {o.id: o.status for o in orders}


def test_traffic_tells_whom_it_moves_and_what_paths_are_used() -> None:
    here, next_ = PathKey("A->B"), PathKey("B->C")
    plans = (
        (robot("R1"), plan("R1", moving=True, untravelled=(here, next_))),
        (robot("R2"), plan("R2", untravelled=(here,), blocked_by=(RobotName("R1"),))),
        (robot("R3"), plan("R3", ready=False, untravelled=(next_,))),
        (robot("R4"), None),
        (robot("R5"), plan("R5")),
    )
    assert says("trafficConditions", plans=plans) == {here: 2, next_: 1}
    said = {"ready": 3, "moving": 1, "blocked": 1, "waits": []}
    assert says("trafficDebug", plans=plans) == said
    waiting = {"since_ms": 7, "blockers": (RobotName("R1"),), "place": PointName("B")}
    wait = Wait(robot=RobotName("R2"), reason=WaitReason.GOAL_BUSY, **waiting)
    [row] = says("trafficDebug", plans=((robot("R2"), plan("R2", wait=wait)),))["waits"]
    assert row == {
        "robot": "R2",
        "reason": "GoalBusy",
        "since": 7,
        "blockers": ["R1"],
        "place": "B",
    }


def test_orders_are_neither_made_at_random_nor_replayed() -> None:
    fields = ("keepOrderNum", "randomOrdersOn", "replayOrdersStop")
    assert [says(field) for field in fields] == [0, False, True]


def test_a_scene_tells_its_settings() -> None:
    config = SceneConfig(parking_paused=True)
    assert says("sceneConfig", scene=replace(HOUSE, config=config)) == wire(config)


# name on the wire -> field, and another value than the default
SETTINGS: dict[str, tuple[str, Any]] = {
    "robotStateFetchDelay": ("state_fetch_ms", 2_000),
    "robotStateFailureNumToAutoConnect": ("state_failures_to_reconnect", 4),
    "robotStateErrorToAutoReconnectMax": ("reconnects_max", 2),
    "noRbkMsgLog": ("robot_message_log_off", True),
    "dispatchMethod": ("dispatch_method", DispatchMethod.GREEDY),
    "withdrawnMinCost": ("withdrawn_cost_min", 7.5),
    "robotPlanPausedOnSelfReportErrorOrFatal": ("pause_on_robot_error", False),
    "notCancelRobot": ("keep_robot_on_cancel", True),
    "parkingPaused": ("parking_paused", True),
    "noReallocation": ("reallocation_off", True),
    "dispatchSort": ("dispatch_sort", ("-priority",)),
    "dispatchAcceptableTimeout": ("dispatch_wait_s_max", 30),
    "chargingPaused": ("charging_paused", True),
    "trafficPlanPaused": ("traffic_paused", True),
    "closePointDistance": ("point_distance_m", 0.5),
    "closePathDistance": ("path_distance_m", 0.6),
    "trafficPlanIntervalMs": ("traffic_plan_interval_ms", 700),
    "cbsHighW": ("cbs_high_w", 2.0),
    "cbsLowW": ("cbs_low_w", 1.1),
    "trafficMethod": ("traffic_method", TrafficMethod.VENUS),
    "linkMinDistance": ("push_distance_m_min", 0.5),
    "linkMaxDistance": ("push_distance_m_max", 20.0),
    "reverseDeadlock": ("reverse_out_of_deadlock", True),
    "enablePrevent": ("deadlock_prevention", False),
    "preRotate": ("turn_ahead", not SceneConfig().turn_ahead),
    "selectConfig": ("selection", "mine"),
}
LEVELS: dict[str, tuple[str, Any]] = {
    "chargeOnly": ("charge_only", 0.1),
    "chargeNeed": ("charge_need", 0.4),
    "chargeOk": ("charge_ok", 0.7),
    "chargeFull": ("charge_full", 0.9),
    "minChargingTime": ("charging_min_s", 90),
    "idleTime": ("idle_s", 5),
}
# of which there is one value only: an old ledger may hold another, and nobody obeys it
FIXED: dict[str, tuple[str, Any]] = {
    "noOpLog": ("operation_log_off", False),
    "opLogKeepDays": ("operation_log_days", 30),
    "parkingCollisionCheckMode": ("parking_collision_check", "None"),
    "cpnEnabled": ("optical_on", False),
    "cpnDispatchPeriod": ("optical_dispatch_period", 0),
    "trafficPlanPausedOnFailedPlan": ("traffic_pause_on_failed_plan", False),
    "trafficDevConfigStr": ("traffic_settings", ""),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_a_setting_is_told_by_its_name(name: str) -> None:
    field, value = SETTINGS[name]
    before, after = wire(SceneConfig()), wire(replace(SceneConfig(), **{field: value}))
    assert after[name] == value != before[name]
    assert {other for other in after if after[other] != before[other]} == {name}


@pytest.mark.parametrize("name", FIXED)
def test_a_setting_that_has_one_value_is_told_with_it(name: str) -> None:
    field, value = FIXED[name]
    assert wire(SceneConfig())[name] == value
    assert wire(replace(SceneConfig(), **{field: "anything else"})) == wire(SceneConfig())


def test_every_setting_has_its_line_here() -> None:
    told = wire(SceneConfig())
    assert SETTINGS.keys() | FIXED.keys() | {"chargingConfig"} == told.keys()
    assert LEVELS.keys() == told["chargingConfig"]["defaultConfig"].keys()


@pytest.mark.parametrize("name", LEVELS)
def test_a_charging_level_is_told_by_its_name_for_all_and_for_one_group(name: str) -> None:
    field, value = LEVELS[name]
    levels = replace(ChargingLevels(), **{field: value})
    normal = wire(SceneConfig())["chargingConfig"]["defaultConfig"]
    for charging, one, other in (
        (ChargingConfig(default=levels, by_group={4: ChargingLevels()}), "default", "4"),
        (ChargingConfig(by_group={4: levels}), "4", "default"),
    ):
        told = wire(SceneConfig(charging=charging))["chargingConfig"]
        by_group = told["groupedConfigs"] | {"default": told["defaultConfig"]}
        assert by_group[one] == normal | {name: value}
        assert by_group[other] == normal


def devices(*reports: DoorReport | LiftReport, doors: tuple[DoorState, ...] = ()) -> Live:
    live = Live(Fleet())
    for report in reports:
        live.devices.observe(report)
    live.devices.intend(SCENE, doors)
    return live


def door(live: Live | None = None, fleet: Fleet | None = None, **scene: Any) -> dict[str, Any]:
    live = live or devices(DOOR)
    house = replace(HOUSE, doors=(replace(HOUSE.doors[0], **scene),))
    (found,) = says("doors", live=live, fleet=fleet or Fleet(), scene=house).items()
    assert found[0] == str(found[1]["id"])
    row: dict[str, Any] = found[1]
    return row


def lift(live: Live | None = None, fleet: Fleet | None = None, **scene: Any) -> dict[str, Any]:
    live = live or devices(LIFT)
    house = replace(HOUSE, lifts=(replace(HOUSE.lifts[0], **scene),))
    (found,) = says("lifts", live=live, fleet=fleet or Fleet(), scene=house).items()
    assert found[0] == str(found[1]["id"])
    row: dict[str, Any] = found[1]
    return row


def faulted(kind: DeviceKind, id_: int, reason: str) -> Fleet:
    fault = DeviceFault(scene=SCENE, kind=kind, device=id_, reason=reason, at_ms=0)
    return Fleet(device_faults={device_key(SCENE, kind, id_): fault})


DOORS: dict[str, tuple[dict[str, Any], Any, set[str]]] = {
    "id": (door(devices(replace(DOOR, door=8)), id=8), 8, set()),
    "name": (door(name="port"), "port", set()),
    "disabled": (door(disabled=True), True, set()),
    "online": (door(devices()), False, {"uTime", "status"}),
    "uTime": (door(devices(replace(DOOR, at_ms=77))), 77, set()),
    "status": (door(devices(replace(DOOR, status=DoorStatus.OPENING))), "Opening", set()),
    "fault": (door(devices(replace(DOOR, fault="jammed"))), True, {"faultMsg"}),
    "faultMsg": (door(fleet=faulted(DeviceKind.DOOR, 7, "jammed")), "jammed", {"fault"}),
    "openRobots": (
        door(devices(DOOR, doors=(DoorState(door=7, robots=(RobotName("R1"),)),))),
        ("R1",),
        set(),
    ),
}
LIFTS: dict[str, tuple[dict[str, Any], Any, set[str]]] = {
    "id": (lift(devices(replace(LIFT, lift=8)), id=8), 8, set()),
    "name": (lift(name="hoist"), "hoist", set()),
    "disabled": (lift(disabled=True), True, set()),
    "online": (
        lift(devices()),
        False,
        {"uTime", "auto", "cf", "doors", "people"},
    ),
    "uTime": (lift(devices(replace(LIFT, at_ms=77))), 77, set()),
    "auto": (lift(devices(replace(LIFT, automatic=False))), False, set()),
    "cf": (lift(devices(replace(LIFT, floor="2F"))), "2F", set()),
    "tf": (lift(devices(replace(LIFT, target="3F"))), "3F", set()),
    "doors": (
        lift(devices(replace(LIFT, doors=(DoorStatus.OPENED, DoorStatus.CLOSED)))),
        (DoorStatus.OPENED, DoorStatus.CLOSED),
        set(),
    ),
    "people": (lift(devices(replace(LIFT, people=True))), True, set()),
    "fault": (lift(devices(replace(LIFT, fault="stuck"))), True, {"faultMsg"}),
    "faultMsg": (lift(fleet=faulted(DeviceKind.LIFT, 3, "stuck")), "stuck", {"fault"}),
}


@pytest.mark.parametrize("field", DOORS)
def test_a_field_of_a_door_says_its_own_part_of_it(field: str) -> None:
    after, value, beside = DOORS[field]
    changed_alone(door(), after, field, value, beside)


@pytest.mark.parametrize("field", LIFTS)
def test_a_field_of_a_lift_says_its_own_part_of_it(field: str) -> None:
    after, value, beside = LIFTS[field]
    changed_alone(lift(), after, field, value, beside)


def changed_alone(
    before: dict[str, Any], after: dict[str, Any], field: str, value: Any, beside: set[str]
) -> None:
    assert after.keys() == before.keys()
    assert after[field] == value != before[field]
    assert {name for name in after if after[name] != before[name]} == {field} | beside


def test_every_field_of_a_device_has_its_line_here() -> None:
    assert (DOORS.keys(), LIFTS.keys()) == (door().keys(), lift().keys())
