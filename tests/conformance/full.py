"""Values with every field set, as the read side words them."""

from collections.abc import Iterator
from typing import Any

import msgspec

from commands.api.m4_models import parallel_results
from commands.api.m4_scene_config import wire
from commands.command import Decision
from commands.rejected import Reason, Rejected
from ledger.ids import OrderId, PathKey, PointName, RobotName, SceneId
from ledger.link import (
    ActionPhase,
    ActionReport,
    Alarm,
    AlarmLevel,
    DoorReport,
    DoorState,
    DoorStatus,
    LiftReport,
    Load,
    Plan,
    Report,
    Space,
)
from ledger.scene import Area, Door, Group, Lift, LiftFloor, RobotConfig, Scene
from ledger.scene_config import ChargingConfig, ChargingLevels, SceneConfig
from ledger.state import (
    BinStatus,
    Fleet,
    Order,
    OrderKind,
    OrderStatus,
    Reject,
    Robot,
    RobotBin,
    Step,
    StepId,
    StepStatus,
    StepTask,
)
from projections.api.m4_order_rows import record
from projections.api.m4_orders import detail
from projections.api.m4_robot_questions import robot_maps, robot_point
from projections.api.m4_robots import Seen, ui_report
from projections.devices import door_reports, lift_reports
from projections.fields import Row, row
from projections.live import Live

SCENE, ROBOT = SceneId("6870D00B569153590E058D3F"), RobotName("AMB-01")
CORNERS = ((0.5, 0.4), (-0.5, 0.4), (-0.5, -0.4), (0.5, -0.4))


def full_order(kind: OrderKind = OrderKind.BUSINESS) -> Order:
    """An order with a value in every field; it could hardly be so in life."""
    step = Step(
        id=StepId("TO20250806-000001-Step0"),
        task=StepTask(location="B1", arguments='{"binTask":"Load"}', loads=True),
        status=StepStatus.EXECUTING,
        created_ms=1,
        modified_ms=3,
        started_ms=2,
        ended_ms=4,
    )
    return Order(
        id=OrderId(f"TO20250806-00000{list(OrderKind).index(kind)}"),
        scene=SCENE,
        kind=kind,
        status=OrderStatus.EXECUTING,
        created_ms=1,
        created_by="alice",
        modified_ms=2,
        modified_by="bob",
        external_id="wms-1",
        wanted_robots=(ROBOT,),
        wanted_groups=("AMR",),
        container="C-1",
        container_type="pallet",
        container_heading_rad=1.5,
        key_locations=("B1",),
        steps=(step, msgspec.structs.replace(step, task=StepTask(location="B2", unloads=True))),
        current_step=0,
        robot=ROBOT,
        bin=0,
        former_robots=(RobotName("AMB-02"),),
        assigned_ms=2,
        cost_s=3.5,
        waited_ms=10,
        load_ms=11,
        unload_ms=12,
        fault_reason="ActionFailed",
        fault_count=1,
        fault_ms=13,
        allocation_reject=Reject(code="AllRobotUnDispatchable", robots={ROBOT: "RobotOffline"}),
        execution_reject=Reject(code="RobotBlocked", robots={ROBOT: "RobotBlocked"}),
        done_ms=99,
    )


def full_robot() -> Seen:
    """A robot of which everything can be said, standing and driving at once."""
    orders = [full_order(), full_order(OrderKind.PARKING)]
    alarm = Alarm(level=AlarmLevel.ERROR, code="E1", message="bumper", times=2, at_ms=5)
    report = Report(
        scene=SCENE,
        robot=ROBOT,
        number=1,
        at_ms=5,
        area=1,
        x_m=1.0,
        y_m=2.0,
        heading_rad=0.5,
        point=PointName("AP1"),
        blocked=True,
        blocked_reason=6,
        map_name="hall",
        map_digest="0" * 32,
        alarms=(alarm,),
        loads=(Load(bin=0, container="C-1"),),
        action=ActionReport(id="a", phase=ActionPhase.RUNNING),
    )
    plan = Plan(
        scene=SCENE,
        robot=ROBOT,
        at_ms=5,
        ready=True,
        target=PointName("AP2"),
        untravelled=(PathKey("AP1->AP2"),),
        spaces=(Space(points=CORNERS),),
        blocked_by=(RobotName("AMB-02"),),
        commit=7,
        moving=True,
    )
    full_bin = RobotBin(status=BinStatus.FILLED, order=orders[0].id, container="C-1")
    robot = Robot(
        scene=SCENE,
        config=RobotConfig(name=ROBOT, simulated=True),
        online=True,
        bins=(full_bin,),
        orders=tuple(order.id for order in orders),
        idle_since_ms=0,
    )
    return Seen(
        robot=robot,
        group=Group(id=0, name="AMR", footprint=CORNERS),
        report=report,
        own=report,
        plan=plan,
        orders={order.id: order for order in orders},
        points={"B1": "AP1", "B2": "AP2"},
    )


def _decoded(row: Row) -> Row:
    """As it is on the wire: parts of a row are kept as JSON."""
    decoded: Row = msgspec.json.decode(msgspec.json.encode(row))
    return decoded


def full_config() -> SceneConfig:
    """Settings with charging levels of a group of its own."""
    return SceneConfig(charging=ChargingConfig(by_group={1: ChargingLevels()}))


def full_scene() -> Scene:
    """A scene with an area, a door and a lift."""
    area = Area(
        id=1, name="hall", map_name="hall", map_digest="0" * 32, points=(), paths=(), bins=()
    )
    floor = LiftFloor(name="1F", area=area.id)
    return Scene(
        id=SCENE,
        name="site",
        digest="",
        areas=(area,),
        groups=(),
        doors=(Door(id=1, name="gate", area=area.id),),
        lifts=(Lift(id=1, name="lift", floors=(floor,)),),
    )


def full_devices() -> Live:
    """What its door and its lift say, both of them faulted."""
    live = Live(Fleet())
    opened = DoorStatus.OPENED
    live.devices.observe(DoorReport(scene=SCENE, door=1, at_ms=5, status=opened, fault="jammed"))
    live.devices.intend(SCENE, [DoorState(door=1, robots=(ROBOT,))])
    live.devices.observe(
        LiftReport(
            scene=SCENE, lift=1, at_ms=5, floor="1F", target="2F", doors=(opened,), fault="stuck"
        )
    )
    return live


def full_answers() -> Iterator[tuple[str, Any]]:
    """Give values by the types of the catalogue."""
    order, seen = full_order(), full_robot()
    yield "TransportOrder", row(order, "site")
    yield "OrderDetail", detail(order, "site")
    yield "UiRobotReport", _decoded(ui_report(seen, raw=True))
    offline = msgspec.structs.replace(seen.robot, online=False)
    unheard = msgspec.structs.replace(seen, robot=offline)
    yield "UiRobotReport", _decoded(ui_report(unheard, raw=False))
    yield "FindPageResult", {"pageNo": 1, "pageSize": 1, "total": 1, "page": [row(order, "site")]}
    yield "SceneConfig", msgspec.json.decode(msgspec.json.encode(wire(full_config())))
    no = Rejected(Reason.ORDER_UNKNOWN, "There is none.", "x")
    results = msgspec.json.decode(parallel_results(["a", "x"], Decision(refused={"x": no})))
    yield "Map<String, ParallelResult<Object>>", results
    yield "Map<String, OrderRuntimeRecord>", {order.id: record(order)}
    yield "RobotPoint", robot_point(seen.report)
    yield "List<RobotMapNameMd5>", robot_maps(full_scene(), seen.report)
    yield "Map<String, UiDoorReport>", _decoded(door_reports(full_devices(), Fleet(), full_scene()))
    yield "Map<String, UiLiftReport>", _decoded(lift_reports(full_devices(), Fleet(), full_scene()))
    yield "ErrorBody", {"code": no.code, "message": no.message, "args": list(no.arguments)}
