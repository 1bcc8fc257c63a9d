"""Simulated doors and lifts, by themselves."""

import msgspec
import pytest

from ledger.ids import PointName, SceneId
from ledger.link import DoorReport, DoorStatus, LiftReport, TellDoor, TellLift
from ledger.scene import Area, Door, Group, Lift, LiftFloor, Scene
from ledger.state import DeviceKind
from sim.devices import QUIET_S, Devices

SCENE = SceneId("S")
HOUSE = Scene(
    id=SCENE,
    name="house",
    digest="d",
    areas=(
        Area(id=1, name="ground", map_name="g", map_digest="", points=(), paths=()),
        Area(id=2, name="first", map_name="f", map_digest="", points=(), paths=()),
    ),
    groups=(Group(id=0, name="g"),),
    doors=(
        Door(id=1, name="gate", area=1, points=(PointName("A"),), simulated=True),
        Door(id=2, name="real", area=1, points=(PointName("B"),)),
    ),
    lifts=(
        Lift(
            id=1,
            name="lift",
            floors=(LiftFloor(name="G", area=1), LiftFloor(name="1", area=2)),
            simulated=True,
        ),
    ),
)


def house() -> Devices:
    devices = Devices()
    devices.follow([HOUSE])
    return devices


def door(devices: Devices) -> DoorReport:
    return next(r for r in devices.reports(0) if isinstance(r, DoorReport))


def lift(devices: Devices) -> LiftReport:
    return next(r for r in devices.reports(0) if isinstance(r, LiftReport))


def pass_time(devices: Devices, seconds: float) -> None:
    for _ in range(round(seconds * 10)):
        devices.step(0.1)


def test_only_simulated_devices_are_there() -> None:
    assert len(house()) == 2


def test_a_door_opens_when_told_and_closes_by_itself() -> None:
    devices = house()
    assert door(devices).status is DoorStatus.CLOSED
    devices.tell(SCENE, TellDoor(door=1, open=True, number=7))
    pass_time(devices, 1)
    assert (door(devices).status, door(devices).obeyed) == (DoorStatus.OPENING, 7)
    pass_time(devices, 1)
    assert door(devices).status is DoorStatus.OPENED
    pass_time(devices, QUIET_S - 2.2)
    assert (door(devices).status, door(devices).obeyed) == (DoorStatus.OPENED, 7)
    pass_time(devices, 1)
    assert (door(devices).status, door(devices).obeyed) == (DoorStatus.CLOSING, 0)
    pass_time(devices, 2)
    assert door(devices).status is DoorStatus.CLOSED


def test_a_door_that_is_told_each_second_stays_open() -> None:
    devices = house()
    for _ in range(20):
        devices.tell(SCENE, TellDoor(door=1, open=True, number=7))
        pass_time(devices, 1)
    assert door(devices).status is DoorStatus.OPENED


def test_a_door_never_says_opened_under_a_number_while_it_closes() -> None:
    devices = house()
    devices.tell(SCENE, TellDoor(door=1, open=True, number=7))
    pass_time(devices, QUIET_S + 0.5)
    devices.tell(SCENE, TellDoor(door=1, open=True, number=8))
    assert door(devices).status is not DoorStatus.OPENED
    pass_time(devices, 1)
    assert (door(devices).status, door(devices).obeyed) == (DoorStatus.OPENED, 8)


def test_a_faulted_door_does_not_move_until_it_is_mended() -> None:
    devices = house()
    devices.tell(SCENE, TellDoor(door=1, open=True, number=7))
    pass_time(devices, 1)
    devices.fault(SCENE, DeviceKind.DOOR, 1, "jammed")
    pass_time(devices, 9)
    assert (door(devices).status, door(devices).fault) == (DoorStatus.UNKNOWN, "jammed")
    devices.mend(SCENE, DeviceKind.DOOR, 1)
    pass_time(devices, 2)
    assert (door(devices).status, door(devices).fault) == (DoorStatus.CLOSED, None)


def test_time_in_which_nobody_could_tell_it_anything_is_not_silence() -> None:
    devices = house()
    devices.tell(SCENE, TellDoor(door=1, open=True, number=7))
    devices.step(60.0)
    assert door(devices).status is DoorStatus.OPENED


def test_changes_are_reported_once() -> None:
    devices = house()
    assert len(devices.reports(0, changed_only=True)) == 2
    assert devices.reports(1, changed_only=True) == []
    devices.tell(SCENE, TellDoor(door=1, open=True, number=7))
    assert [r.at_ms for r in devices.reports(2, changed_only=True)] == [2]


def test_a_lift_shuts_its_doors_drives_and_opens_them() -> None:
    devices = house()
    devices.tell(SCENE, TellLift(lift=1, floor="G"))
    pass_time(devices, 4)
    assert lift(devices).doors == (DoorStatus.OPENED,)
    seen = []
    for _ in range(13):
        devices.tell(SCENE, TellLift(lift=1, floor="1"))
        pass_time(devices, 1)
        report = lift(devices)
        seen.append((report.floor, report.target, report.doors[0]))
    assert seen[0] == ("G", "1", DoorStatus.CLOSING)
    assert ("G", "1", DoorStatus.CLOSED) in seen
    assert seen[-1] == ("1", None, DoorStatus.OPENED)
    assert not any(target and status is DoorStatus.OPENED for _, target, status in seen)
    devices.tell(SCENE, TellLift(lift=1, floor=None))
    pass_time(devices, 4)
    assert lift(devices).doors == (DoorStatus.CLOSED,)


def test_a_lift_is_not_sent_to_a_floor_that_it_does_not_have() -> None:
    devices = house()
    devices.tell(SCENE, TellLift(lift=1, floor="9"))
    pass_time(devices, 5)
    assert (lift(devices).floor, lift(devices).doors) == ("G", (DoorStatus.CLOSED,))


def test_what_was_saved_goes_on_where_it_was() -> None:
    devices = house()
    devices.tell(SCENE, TellDoor(door=1, open=True, number=7))
    devices.tell(SCENE, TellLift(lift=1, floor="1"))
    pass_time(devices, 2.5)
    devices.fault(SCENE, DeviceKind.LIFT, 1, "no power")
    again = Devices()
    again.load(devices.save())
    again.follow([HOUSE])
    assert again.reports(5) == devices.reports(5)


@pytest.mark.parametrize("raw", [b"", b"nonsense", b"\x80"])
def test_nonsense_is_not_remembered(raw: bytes) -> None:
    with pytest.raises((ValueError, msgspec.DecodeError)):
        Devices().load(raw)


def test_a_scene_out_of_service_keeps_what_its_doors_were() -> None:
    devices = house()
    devices.tell(SCENE, TellDoor(door=1, open=True, number=7))
    pass_time(devices, 3)
    devices.follow([])
    assert len(devices) == 0
    devices.follow([HOUSE])
    assert door(devices).status is DoorStatus.OPENED
