"""Doors and lifts as clients see them."""

from ledger.evolve_resources import device_key
from ledger.ids import PointName, RobotName, SceneId
from ledger.link import DoorReport, DoorState, DoorStatus, LiftReport
from ledger.proposals import DOES_NOT_ANSWER
from ledger.scene import Door, Lift, LiftFloor, Scene
from ledger.state import DeviceFault, DeviceKind, Fleet
from projections.devices import DevicesSeen, door_reports, lift_reports
from projections.live import Live

SCENE = SceneId("S")
HOUSE = Scene(
    id=SCENE,
    name="s",
    digest="",
    areas=(),
    groups=(),
    doors=(Door(id=7, name="gate", area=1, points=(PointName("A"),)),),
    lifts=(Lift(id=3, name="lift", floors=(LiftFloor(name="G", area=1),), disabled=True),),
)


def fault(reason: str) -> Fleet:
    key = device_key(SCENE, DeviceKind.DOOR, 7)
    found = DeviceFault(scene=SCENE, kind=DeviceKind.DOOR, device=7, reason=reason, at_ms=0)
    return Fleet(device_faults={key: found})


def test_a_device_that_nobody_has_heard_is_offline_and_unknown() -> None:
    live = Live(Fleet())
    for seen in (live, None):
        assert door_reports(seen, Fleet(), HOUSE) == {
            "7": {
                "id": 7,
                "name": "gate",
                "disabled": False,
                "online": False,
                "uTime": None,
                "status": "Unknown",
                "fault": False,
                "faultMsg": None,
                "openRobots": (),
            }
        }
        assert lift_reports(seen, Fleet(), HOUSE) == {
            "3": {
                "id": 3,
                "name": "lift",
                "disabled": True,
                "online": False,
                "uTime": None,
                "auto": None,
                "cf": None,
                "tf": None,
                "doors": ["Unknown"],
                "people": None,
                "fault": False,
                "faultMsg": None,
            }
        }


def test_what_a_device_says_is_shown_until_it_is_silent() -> None:
    live = Live(Fleet())
    live.devices.observe(DoorReport(scene=SCENE, door=7, at_ms=5, status=DoorStatus.OPENED))
    live.devices.intend(SCENE, [DoorState(door=7, robots=(RobotName("R1"),))])
    live.devices.observe(LiftReport(scene=SCENE, lift=3, at_ms=6, floor="G", fault="stuck"))
    row = door_reports(live, Fleet(), HOUSE)["7"]
    assert (row["online"], row["uTime"], row["status"]) == (True, 5, "Opened")
    assert row["openRobots"] == ("R1",)
    row = lift_reports(live, Fleet(), HOUSE)["3"]
    assert (row["online"], row["cf"], row["fault"], row["faultMsg"]) == (True, "G", True, "stuck")
    row = door_reports(live, fault(DOES_NOT_ANSWER), HOUSE)["7"]
    assert (row["online"], row["fault"], row["faultMsg"]) == (False, True, DOES_NOT_ANSWER)
    live.devices.intend(SCENE, [])
    assert door_reports(live, Fleet(), HOUSE)["7"]["openRobots"] == ()


def test_a_report_that_was_overtaken_is_dropped() -> None:
    seen = DevicesSeen()
    for at_ms in (5, 7, 6):
        seen.observe(DoorReport(scene=SCENE, door=7, at_ms=at_ms, status=DoorStatus.OPENED))
    report = seen.door(SCENE, 7)
    assert report is not None and report.at_ms == 7
