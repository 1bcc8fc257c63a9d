"""Doors and lifts as clients see them: set up by the scene, reported by the device itself.

`online` follows the ledger: a device answers once it has been heard, until its silence is recorded.
Fields that only the device could tell are null, Unknown or empty while nobody has heard it.
"""

from collections.abc import Sequence
from typing import Protocol

from ledger.evolve_resources import device_key
from ledger.ids import RobotName, SceneId
from ledger.link import DoorReport, DoorState, DoorStatus, LiftReport
from ledger.proposals import DOES_NOT_ANSWER
from ledger.scene import Door, Lift, Scene
from ledger.state import DeviceKind, Fleet
from projections.fields import Row

DEVICES_MAX = 20_000  # whose newest report is kept


class DevicesSeen:
    """The newest report of each device, and for whom doors are open."""

    def __init__(self) -> None:
        self._reports: dict[str, DoorReport | LiftReport] = {}
        self._open_for: dict[SceneId, dict[int, tuple[RobotName, ...]]] = {}

    def observe(self, report: DoorReport | LiftReport) -> None:
        """Take in what a device reports; one that was overtaken on its way is dropped."""
        if isinstance(report, DoorReport):
            key = device_key(report.scene, DeviceKind.DOOR, report.door)
        else:
            key = device_key(report.scene, DeviceKind.LIFT, report.lift)
        known = self._reports.get(key)
        if known is not None and report.at_ms < known.at_ms:
            return
        if known is None and len(self._reports) >= DEVICES_MAX:
            return
        self._reports[key] = report

    def intend(self, scene: SceneId, states: Sequence[DoorState]) -> None:
        """Take in for whom the doors of a scene are open; the others are so for nobody."""
        if scene in self._open_for or len(self._open_for) < DEVICES_MAX:
            self._open_for[scene] = {state.door: state.robots for state in states}

    def door(self, scene: SceneId, id_: int) -> DoorReport | None:
        """Give the newest report of a door."""
        report = self._reports.get(device_key(scene, DeviceKind.DOOR, id_))
        return report if isinstance(report, DoorReport) else None

    def lift(self, scene: SceneId, id_: int) -> LiftReport | None:
        """Give the newest report of a lift."""
        report = self._reports.get(device_key(scene, DeviceKind.LIFT, id_))
        return report if isinstance(report, LiftReport) else None

    def open_for(self, scene: SceneId, id_: int) -> tuple[RobotName, ...]:
        """Name the robots for which a door is open or opening."""
        return self._open_for.get(scene, {}).get(id_, ())


class SeesDevices(Protocol):
    """What is needed of the live view."""

    @property
    def devices(self) -> DevicesSeen:
        """What devices report."""


def door_reports(live: SeesDevices | None, fleet: Fleet, scene: Scene) -> Row:
    """Give the UiDoorReport of every door by its id (spec/m4.md §8); without a live view, of a past
    state, that is what the ledger knows.
    """
    seen = DevicesSeen() if live is None else live.devices
    return {str(door.id): _door(seen, fleet, scene, door) for door in scene.doors}


def lift_reports(live: SeesDevices | None, fleet: Fleet, scene: Scene) -> Row:
    """Give the UiLiftReport of every lift by its id (spec/m4.md §8)."""
    seen = DevicesSeen() if live is None else live.devices
    return {str(lift.id): _lift(seen, fleet, scene, lift) for lift in scene.lifts}


def _door(seen: DevicesSeen, fleet: Fleet, scene: Scene, door: Door) -> Row:
    report = seen.door(scene.id, door.id)
    row = _device(fleet, scene, DeviceKind.DOOR, door, report)
    row["status"] = DoorStatus.UNKNOWN if report is None else report.status
    row |= _fault(fleet, scene, DeviceKind.DOOR, door, report)
    row["openRobots"] = seen.open_for(scene.id, door.id)
    return row


def _lift(seen: DevicesSeen, fleet: Fleet, scene: Scene, lift: Lift) -> Row:
    report = seen.lift(scene.id, lift.id)
    row = _device(fleet, scene, DeviceKind.LIFT, lift, report)
    row["auto"] = None if report is None else report.automatic
    row["cf"] = None if report is None else report.floor
    row["tf"] = None if report is None else report.target
    row["doors"] = [DoorStatus.UNKNOWN] if report is None else report.doors
    row["people"] = None if report is None else report.people
    return row | _fault(fleet, scene, DeviceKind.LIFT, lift, report)


def _device(
    fleet: Fleet,
    scene: Scene,
    kind: DeviceKind,
    device: Door | Lift,
    report: DoorReport | LiftReport | None,
) -> Row:
    recorded = fleet.device_faults.get(device_key(scene.id, kind, device.id))
    silent = recorded is not None and recorded.reason == DOES_NOT_ANSWER
    return {
        "id": device.id,
        "name": device.name,
        "disabled": device.disabled,
        "online": report is not None and not silent,
        "uTime": None if report is None else report.at_ms,
    }


def _fault(
    fleet: Fleet,
    scene: Scene,
    kind: DeviceKind,
    device: Door | Lift,
    report: DoorReport | LiftReport | None,
) -> Row:
    """What the device says now goes before what the ledger heard of it."""
    words = report.fault if report is not None else None
    recorded = fleet.device_faults.get(device_key(scene.id, kind, device.id))
    if words is None and recorded is not None:
        words = recorded.reason
    return {"fault": words is not None, "faultMsg": words}
