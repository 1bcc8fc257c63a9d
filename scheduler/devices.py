"""Doors and lifts of one scene at work: heard, told, and their faults made news.

What a device says decides what robots may do at once; the ledger only hears of faults.
"""

from collections.abc import Mapping

from ledger.evolve_resources import device_key
from ledger.ids import RobotName
from ledger.link import DoorReport, DoorState, LiftReport, TellDoor, TellLift, ToDevice
from ledger.proposals import DOES_NOT_ANSWER, AnyProposal, FaultDevice, RecoverDevice
from ledger.scene import Door, Lift, Scene
from ledger.state import DeviceKind, Fleet
from scheduler.doors import TELL_MS, DoorDesk
from scheduler.traffic.doors import DoorNow

SILENT_MS = 10_000  # a device that is not heard for so long does not answer
STATES_MS = 1_000  # so often all is told to those who look on, changes at once


class SiteDevices:
    """All devices of a scene. Reports of devices that the scene does not have change nothing."""

    def __init__(self, now_ms: int) -> None:
        self._since_ms = now_ms
        self._doors = DoorDesk()
        self._lifts: dict[int, tuple[LiftReport, int]] = {}  # and when it came
        self._lifts_told: dict[int, tuple[str, int]] = {}  # floor, and when
        self._shown: tuple[list[DoorState], int] = ([], 0)
        self._inbox: list[DoorReport | LiftReport] = []

    def hear(self, report: DoorReport | LiftReport) -> None:
        """Keep a report for the next pass."""
        self._inbox.append(report)

    def close(self, door: int) -> None:
        """Somebody wants a door closed."""
        self._doors.close(door)

    def take_in(self, scene: Scene, now_ms: int) -> None:
        """Take in what was heard since the last pass."""
        doors, lifts = {d.id for d in scene.doors}, {lift.id for lift in scene.lifts}
        for report in self._inbox:
            if isinstance(report, DoorReport) and report.door in doors:
                self._doors.hear(report, now_ms)
            elif isinstance(report, LiftReport) and report.lift in lifts:
                self._lifts[report.lift] = (report, now_ms)
        self._inbox.clear()

    def broken(self, scene: Scene, kind: DeviceKind, now_ms: int) -> dict[int, str]:
        """Give the devices in service that do not work, and why."""
        found: dict[int, str] = {}
        devices: tuple[Door | Lift, ...] = scene.doors
        if kind is DeviceKind.LIFT:
            devices = scene.lifts
        for device in devices if not scene.disabled else ():
            if device.disabled:
                continue
            heard_ms, fault = self._heard(kind, device.id)
            if now_ms - heard_ms > SILENT_MS:
                found[device.id] = DOES_NOT_ANSWER
            elif fault is not None:
                found[device.id] = fault
        return found

    def _heard(self, kind: DeviceKind, id_: int) -> tuple[int, str | None]:
        """When it was heard last, or we began to listen; and the fault it reports."""
        if kind is DeviceKind.DOOR:
            door = self._doors.heard(id_)
            return (self._since_ms, None) if door is None else (door.at_ms, door.report.fault)
        lift = self._lifts.get(id_)
        return (self._since_ms, None) if lift is None else (lift[1], lift[0].fault)

    def news(self, fleet: Fleet, scene: Scene, now_ms: int) -> list[AnyProposal]:
        """Propose the faults that have come and gone since the ledger last heard of them."""
        proposals: list[AnyProposal] = []
        known = {
            (kind, device.id)
            for kind, devices in ((DeviceKind.DOOR, scene.doors), (DeviceKind.LIFT, scene.lifts))
            for device in devices
        }
        broken = {
            (kind, id_): reason
            for kind in DeviceKind
            for id_, reason in self.broken(scene, kind, now_ms).items()
        }
        for (kind, id_), reason in broken.items():
            recorded = fleet.device_faults.get(device_key(scene.id, kind, id_))
            if recorded is None or recorded.reason != reason:
                fault = FaultDevice(scene=scene.id, kind=kind, device=id_, reason=reason)
                proposals.append(fault)
        for recorded in fleet.device_faults.values():
            device = (recorded.kind, recorded.device)
            if recorded.scene != scene.id or device in broken:
                continue
            if device not in known or self._is_well(*device):
                recovered = RecoverDevice(scene=scene.id, kind=device[0], device=device[1])
                proposals.append(recovered)
        return proposals

    def _is_well(self, kind: DeviceKind, id_: int) -> bool:
        """It has been heard since we began: what was recorded before is not taken back unheard."""
        heard_ms, fault = self._heard(kind, id_)
        return fault is None and heard_ms != self._since_ms

    def doors(self, scene: Scene, now_ms: int) -> dict[int, DoorNow]:
        """Say of each door what traffic may do."""
        return self._doors.now(scene, self.broken(scene, DeviceKind.DOOR, now_ms), now_ms)

    def tell(
        self,
        scene: Scene,
        robots: Mapping[int, tuple[RobotName, ...]],
        settled: frozenset[int],
        now_ms: int,
    ) -> list[ToDevice]:
        """Say what devices are to be told now; `robots` by the doors that they want open."""
        doors: list[TellDoor] = self._doors.want(scene, robots, settled, now_ms)
        return [*doors, *self._tell_lifts(scene, now_ms)]

    def _tell_lifts(self, scene: Scene, now_ms: int) -> list[TellLift]:
        told: list[TellLift] = []
        for lift in scene.lifts:
            area = scene.held_lifts.get(lift.id)
            floor = next((f.name for f in lift.floors if f.area == area), None)
            before = self._lifts_told.get(lift.id)
            if floor is None or lift.disabled:
                if before is not None:
                    del self._lifts_told[lift.id]
                    told.append(TellLift(lift=lift.id, floor=None))
            elif before is None or before[0] != floor or now_ms - before[1] >= TELL_MS:
                self._lifts_told[lift.id] = (floor, now_ms)
                told.append(TellLift(lift=lift.id, floor=floor))
        return told

    def to_show(self, now_ms: int) -> list[DoorState] | None:
        """Give for whom doors are open if that is news, or was last said a while ago."""
        states, (shown, shown_ms) = self._doors.states(), self._shown
        if states == shown and (not states or now_ms - shown_ms < STATES_MS):
            return None
        self._shown = (states, now_ms)
        return states
