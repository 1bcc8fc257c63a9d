"""What each field of an answered robot says: one change of what is known, one of the answer."""

from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from ledger.ids import OrderId, PathKey, PointName, RobotName
from ledger.link import ActionPhase, ActionReport, Alarm, AlarmLevel, Load, Space
from ledger.state import BinStatus, Order, OrderStatus, RobotBin
from projections.api.m4_robots import Seen, ui_report
from tests.conformance.full import CORNERS, full_robot

replace = msgspec.structs.replace
ABSENT = "absent"
SEEN = full_robot()
BUSINESS, PARKING = SEEN.orders.values()
TRIANGLE = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.23456))
SAYS_TRIANGLE = [{"x": 0.0, "y": 0.0}, {"x": 1.0, "y": 0.0}, {"x": 0.0, "y": 1.235}]

Change = Callable[[Seen], Seen]


def robot(**fields: Any) -> Change:
    return lambda seen: replace(seen, robot=replace(seen.robot, **fields))


def report(**fields: Any) -> Change:
    return lambda seen: replace(seen, report=replace(seen.report, **fields))


def plan(**fields: Any) -> Change:
    return lambda seen: replace(seen, plan=replace(seen.plan, **fields))


def orders(*known: Order) -> Change:
    return lambda seen: replace(
        seen,
        robot=replace(seen.robot, orders=tuple(order.id for order in known)),
        orders={order.id: order for order in known},
    )


def config(**fields: Any) -> Change:
    return lambda seen: replace(
        seen, robot=replace(seen.robot, config=replace(seen.robot.config, **fields))
    )


def outline(seen: Seen) -> Seen:
    return replace(seen, group=replace(seen.group, footprint=TRIANGLE))


SOUND = replace(BUSINESS, fault_reason=None)
ALARM = Alarm(level=AlarmLevel.FATAL, code="52200", message="lost", times=3, at_ms=17)
BINS = (RobotBin(), RobotBin(status=BinStatus.RESERVED, order=OrderId("TO7")))
ELSEWHERE = replace(
    BUSINESS,
    current_step=1,
    steps=(BUSINESS.steps[0], replace(BUSINESS.steps[1], task=BUSINESS.steps[0].task)),
)
NEAR = replace(
    BUSINESS.steps[0], task=replace(BUSINESS.steps[0].task, location="B9", arguments=None)
)
DIFFERENT = replace(
    BUSINESS.steps[0], task=replace(BUSINESS.steps[0].task, arguments='{"operation":"Lift"}')
)

# field -> what changes, what the field says then, and which others change with it
FIELDS: dict[str, tuple[Change, Any, set[str]]] = {
    "name": (config(name=RobotName("AMB-09")), "AMB-09", set()),
    "offDuty": (robot(off_duty=True), True, set()),
    "online": (robot(online=False), False, {"connectMsg", "cff"}),
    "connectMsg": (robot(online=False), "The robot does not answer.", {"online", "cff"}),
    "disabled": (config(disabled=True), True, set()),
    "mock": (config(simulated=False), False, set()),
    "noAc": (robot(given_up=True), True, {"connectMsg"}),
    "bins": (
        robot(bins=BINS),
        [{"index": 0, "status": "Empty"}, {"index": 1, "status": "Reserved", "orderId": "TO7"}],
        set(),
    ),
    "collision": (
        outline,
        {
            "points": SAYS_TRIANGLE,
            "type": "Other",
            "ignoreRobotSafeDist": None,
            "ignoreLoadSafeDist": None,
            "empty": False,
        },
        {"loads"},  # which lie within it
    ),
    "rTime": (report(at_ms=9), 9, set()),
    "x": (report(x_m=1.23456), 1.235, set()),
    "y": (report(y_m=-2.34567), -2.346, set()),
    "d": (report(heading_rad=1.57079), 1.5708, set()),
    "v": (report(speed_mps=-0.12345), -0.123, set()),
    "rv": (report(turn_radps=0.98765), 0.988, set()),
    "battery": (report(battery_ratio=0.45678), 0.457, set()),
    "c": (report(confidence=0.673959), 0.67396, set()),
    "to": (report(odometer_today_m=12.3456), 12.346, set()),
    "p": (report(point=PointName("AP9")), "AP9", {"bp"}),
    "bp": (report(point=None), "AP2", {"p"}),  # where the path that it drives ends
    "areaId": (report(area=2), 2, set()),
    "map": (report(map_name="yard"), "yard", set()),
    "mapMd5": (report(map_digest="1" * 32), "1" * 32, set()),
    "cff": (report(controller="somebody"), False, {"controller"}),
    "controller": (report(controller="somebody"), "somebody", {"cff"}),
    "emc": (report(emergency_stop=True), True, set()),
    "sEmc": (report(soft_stop=True), True, set()),
    "blocked": (report(blocked=False), False, set()),
    "blockedMsg": (report(blocked_reason=3), 3, set()),
    "alarms": (
        report(alarms=(ALARM,)),
        [{"level": "Fatal", "code": "52200", "message": "lost", "times": 3, "timestamp": 17}],
        set(),
    ),
    "loads": (report(loads=()), ABSENT, set()),
    "charging": (report(charging=True), True, set()),
    "ka": (report(action=ActionReport(id="a", phase=ActionPhase.DONE)), False, set()),
    "navId": (plan(commit=8), "8", {"ttId"}),
    "navStatus": (report(paused=True), 3, set()),  # 2 while it drives
    "ttId": (plan(commit=8), "8", {"navId"}),
    "ttStatus": (plan(moving=False), ABSENT, {"ttId", "navId", "navStatus"}),
    "targetPoint": (plan(target=PointName("AP9")), "AP9", set()),
    "unTravelled": (
        plan(untravelled=(PathKey("AP2->AP3"), PathKey("AP3->AP4"))),
        ["AP2->AP3", "AP3->AP4"],
        set(),
    ),
    "spaces": (
        plan(spaces=(Space(points=TRIANGLE),)),
        [{"type": "Polygon", "points": SAYS_TRIANGLE, "radius": None}],
        set(),
    ),
    "tReady": (plan(ready=False), False, set()),
    "bbr": (plan(blocked_by=(RobotName("R1"), RobotName("R2"))), ["R1", "R2"], set()),
    "cmdStatus": (orders(SOUND, replace(PARKING, fault_reason=None)), "Moving", {"oFaultMsg"}),
    "oFaultMsg": (orders(replace(BUSINESS, fault_reason="Lost"), PARKING), "Lost", set()),
    "withBzOrder": (
        orders(PARKING),
        False,
        {"orders", "cuOrderId"},
    ),
    "autoOrder": (orders(BUSINESS), ABSENT, {"orders"}),
    "orders": (orders(BUSINESS), [BUSINESS.id], {"autoOrder"}),
    "cuOrderId": (orders(PARKING, BUSINESS), PARKING.id, {"orders"}),
    "cuStepIndex": (orders(ELSEWHERE, PARKING), 1, set()),
    "cuStepLocation": (
        orders(replace(BUSINESS, steps=(NEAR,)), PARKING),
        "B9",
        {"op"},
    ),
    "op": (orders(replace(BUSINESS, steps=(DIFFERENT,)), PARKING), "Lift", set()),
}


def shown(seen: Seen) -> dict[str, Any]:
    found: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(ui_report(seen, raw=False)))
    return found


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_of_a_robot_says_its_own_part_of_what_is_known(field: str) -> None:
    change, says, beside = FIELDS[field]
    before, after = shown(SEEN), shown(change(SEEN))
    assert after.get(field, ABSENT) == says != before.get(field, ABSENT)
    names = before.keys() | after.keys()
    changed = {n for n in names if before.get(n, ABSENT) != after.get(n, ABSENT)}
    assert changed == {field} | beside


def test_every_field_of_a_robot_has_its_line_here() -> None:
    assert FIELDS.keys() | {"reloc"} == shown(SEEN).keys() | {"connectMsg"}


def test_a_robot_that_was_given_up_says_what_to_do() -> None:
    gone = shown(robot(online=False, given_up=True)(SEEN))
    assert (gone["noAc"], gone["cff"]) == (True, False)
    assert "until asked" in gone["connectMsg"]


def test_a_robot_knows_where_it_is_once_it_has_reported() -> None:
    assert shown(SEEN)["reloc"] == "Success"
    never = shown(replace(SEEN, report=None))
    assert never["reloc"] == "Init"
    assert not never.keys() & {"rTime", "x", "y", "d", "p", "map", "battery", "c", "controller"}


def test_control_that_nobody_holds_may_be_taken() -> None:
    free = shown(report(controller="")(SEEN))
    assert (free["cff"], "controller" in free) == (True, False)


@pytest.mark.parametrize(
    ("change", "status"),
    [
        (orders(), "Moving"),  # traffic moves it out of somebody's way
        (lambda seen: orders()(plan(moving=False)(seen)), "Idle"),
        (lambda seen: orders(SOUND)(plan(moving=False)(seen)), "Moving"),
        (orders(replace(SOUND, status=OrderStatus.ALLOCATED)), "Moving"),
        (orders(BUSINESS), "Failed"),
    ],
)
def test_a_robot_says_how_it_gets_on_with_its_orders(change: Change, status: str) -> None:
    assert shown(change(SEEN))["cmdStatus"] == status


def test_the_target_is_where_its_step_is_if_traffic_has_none() -> None:
    still = plan(target=None)(SEEN)
    assert shown(still)["targetPoint"] == "AP1"  # from which B1 is reached
    assert shown(replace(still, points={}))["targetPoint"] == "B1"
    assert "targetPoint" not in shown(orders()(still))


def test_a_load_lies_within_the_outline_of_its_robot() -> None:
    carrying = report(loads=(Load(bin=0, container="C-7"),))
    (load,) = shown(outline(carrying(SEEN)))["loads"]
    assert load == {"type": "container", "id": "C-7", "points": SAYS_TRIANGLE, "direction": 0.0}


def test_ground_has_its_kind_and_its_corners() -> None:
    square = Space(points=((1.0, 1.0), (3.0, 1.0), (3.0, 2.0), (1.0, 2.0)))
    crooked = Space(points=((1.0, 1.0), (3.0, 1.0), (3.0, 2.0), (1.5, 2.0)))
    rect, other = shown(plan(spaces=(square, crooked))(SEEN))["spaces"]
    assert (rect["type"], other["type"]) == ("Rect", "Polygon")
    assert rect["points"] == [{"x": x, "y": y} for x, y in square.points]
    assert rect["radius"] is other["radius"] is None  # no ground is a circle


def test_a_robot_without_an_outline_says_so() -> None:
    bare = replace(SEEN, group=replace(SEEN.group, footprint=()))
    assert shown(bare)["collision"]["empty"] is True
    assert shown(SEEN)["collision"]["points"] == [{"x": x, "y": y} for x, y in CORNERS]


def test_a_bin_says_what_is_in_it_and_whose_it_is() -> None:
    filled = RobotBin(status=BinStatus.FILLED, order=OrderId("TO7"), container="C-7")
    left = RobotBin(status=BinStatus.CANCELLED, container="C-8")
    assert shown(robot(bins=(filled, left))(SEEN))["bins"] == [
        {"index": 0, "status": "Filled", "orderId": "TO7", "containerId": "C-7"},
        {"index": 1, "status": "Cancelled", "containerId": "C-8"},
    ]


def test_what_the_robot_itself_said_comes_if_asked_for() -> None:
    own = replace(SEEN.own, x_m=7.654321, battery_ratio=0.123456)
    whole = ui_report(replace(SEEN, own=own), raw=True)
    assert (whole["raw"]["x"], whole["raw"]["battery_level"]) == (7.654321, 0.123456)  # as it was
    assert whole["x"] == 1.0  # brought to the common instant
    assert "raw" not in ui_report(SEEN, raw=False)
    assert ui_report(SEEN, raw=True, raw_fields=["y"])["raw"] == {"y": 2.0}
