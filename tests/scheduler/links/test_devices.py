"""Devices over the bus: each under its own key."""

import msgspec

from ledger.bus import (
    MemoryBus,
    door_report_key,
    door_tell_key,
    doors_key,
    lift_report_key,
    lift_tell_key,
)
from ledger.ids import SceneId
from ledger.link import DoorReport, DoorState, DoorStatus, LiftReport, TellDoor, TellLift
from scheduler.links.devices import BusDevices

SCENE = SceneId("S")
DOOR = DoorReport(scene=SCENE, door=1, at_ms=1, status=DoorStatus.OPENED)
LIFT = LiftReport(scene=SCENE, lift=1, at_ms=1, floor="G")


def test_reports_are_heard_and_nonsense_is_not() -> None:
    bus, heard, wrong = MemoryBus(), [], []
    BusDevices(bus).hear(heard.append, lambda key, reason: wrong.append(key))
    bus.publish(door_report_key(SCENE, 1), msgspec.json.encode(DOOR))
    bus.publish(lift_report_key(SCENE, 1), msgspec.json.encode(LIFT))
    bus.publish(door_report_key(SCENE, 2), msgspec.json.encode(DOOR))
    bus.publish(lift_report_key(SceneId("T"), 1), msgspec.json.encode(LIFT))
    bus.publish(door_report_key(SCENE, 1), b"{")
    assert heard == [DOOR, LIFT]
    assert len(wrong) == 3


def test_everybody_is_told_under_its_own_key() -> None:
    bus, got = MemoryBus(), []
    for key in (door_tell_key(SCENE, 1), lift_tell_key(SCENE, 1), doors_key(SCENE)):
        bus.subscribe(key, lambda key, payload: got.append((key, msgspec.json.decode(payload))))
    devices = BusDevices(bus)
    devices.tell(SCENE, TellDoor(door=1, open=True, number=3))
    devices.tell(SCENE, TellLift(lift=1, floor="G"))
    devices.show(SCENE, [DoorState(door=1)])
    assert [key for key, _ in got] == [
        "scenes/S/doors/1/tell",
        "scenes/S/lifts/1/tell",
        "scenes/S/doors",
    ]
