"""Simulated doors and lifts: they move when told, and stop when nobody tells them any more.

A door that is told to be open opens, and closes by itself when it has not been told for a while;
a lift goes where it is told and then its own ways. With a fault neither moves. Pure and stepped,
like the robots; what is saved lets them go on after a crash where they were.
"""

from collections.abc import Iterable
from typing import TypeAlias

import msgspec

from ledger.ids import SceneId
from ledger.link import DoorReport, DoorStatus, LiftReport, TellDoor, TellLift, ToDevice
from ledger.scene import Door, Lift, Scene, Value
from ledger.state import DeviceKind

DOOR_S = 2.0  # from closed to open, and back
QUIET_S = 5.0  # a device that has not been told for so long is let go
QUIET_STEP_S_MAX = 1.0  # of one step: while we stood still nobody could tell it anything
SAVED_VERSION = 1
REMEMBERED_MAX = 10_000

Key: TypeAlias = tuple[SceneId, DeviceKind, int]


class SavedDevice(Value, frozen=True, kw_only=True):
    """What a device remembers: fields as in SimDoor and SimLift."""

    scene: SceneId
    kind: DeviceKind
    id: int
    open: float
    told: str | None
    number: int
    floor: int
    moved_s: float
    fault: str | None


class SavedDevices(Value, frozen=True, kw_only=True):
    """All devices at one moment."""

    version: int = SAVED_VERSION
    devices: tuple[SavedDevice, ...]


class Leaf:
    """A door's leaf, alone or in a lift: how far it is open, and what it shows of that."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds  # from closed to open
        self.open = 0.0  # share, 0-1
        self.way = 0  # 1 opening, -1 closing, 0 neither

    def step(self, dt_s: float, *, opens: bool) -> float:
        """Move for a while; gives the time that is left over once it has arrived."""
        aim = 1.0 if opens else 0.0
        needed_s = abs(aim - self.open) * self.seconds
        if needed_s <= dt_s + 1e-9:
            self.open, self.way = aim, 0
            return max(dt_s - needed_s, 0.0)
        self.way = 1 if opens else -1
        self.open += self.way * dt_s / self.seconds
        return 0.0

    @property
    def status(self) -> DoorStatus:
        """Opening and Closing only while it moves: one that a fault has stopped is Unknown."""
        if self.open in (0.0, 1.0):
            return DoorStatus.OPENED if self.open else DoorStatus.CLOSED
        moving = {1: DoorStatus.OPENING, -1: DoorStatus.CLOSING}
        return moving.get(self.way, DoorStatus.UNKNOWN)


class SimDoor:
    """One door."""

    def __init__(self, scene: SceneId, door: Door) -> None:
        self.scene = scene
        self.door = door
        self.leaf = Leaf(DOOR_S)
        self.number = 0  # of the TellDoor that has it open; 0 = none
        self.quiet_s = 0.0  # since it was last told
        self.fault: str | None = None

    def tell(self, message: TellDoor) -> None:
        """Obey from now on."""
        self.number = max(message.number, 1) if message.open else 0
        self.quiet_s = 0.0

    def step(self, dt_s: float) -> None:
        """Let time pass."""
        self.quiet_s += min(dt_s, QUIET_STEP_S_MAX)
        if self.quiet_s >= QUIET_S:
            self.number = 0
        if self.fault is None:
            self.leaf.step(dt_s, opens=self.number != 0)
        else:
            self.leaf.way = 0

    def report(self, at_ms: int) -> DoorReport:
        """Say how it is."""
        return DoorReport(
            scene=self.scene,
            door=self.door.id,
            at_ms=at_ms,
            status=self.leaf.status,
            fault=self.fault,
            obeyed=self.number,
        )

    def saved(self) -> SavedDevice:
        """Take down what it remembers; how long it has heard nothing begins anew."""
        return SavedDevice(
            scene=self.scene,
            kind=DeviceKind.DOOR,
            id=self.door.id,
            open=self.leaf.open,
            told=None,
            number=self.number,
            floor=0,
            moved_s=0.0,
            fault=self.fault,
        )

    def restore(self, memory: SavedDevice) -> None:
        """Go on as the saved one would have."""
        self.leaf.open, self.number, self.fault = memory.open, memory.number, memory.fault


class SimLift:
    """One lift. It drives with closed doors only; a person may get in wherever it stands open."""

    def __init__(self, scene: SceneId, lift: Lift) -> None:
        self.scene = scene
        self.lift = lift
        self.leaf = Leaf(lift.door_s)
        self.floor = 0  # that it is at, or was last
        self.moved_s = 0.0  # on the way to the next floor, either direction
        self.told: str | None = None  # floor at which it is to be open
        self.quiet_s = 0.0
        self.fault: str | None = None

    @property
    def target(self) -> int | None:
        """Floor that it goes to; None = it is there, or goes nowhere."""
        names = [floor.name for floor in self.lift.floors]
        wanted = names.index(self.told) if self.told in names else self.floor
        return wanted if wanted != self.floor else None

    def tell(self, message: TellLift) -> None:
        """Obey from now on. Between two floors it goes on to the next one first."""
        known = any(floor.name == message.floor for floor in self.lift.floors)
        self.told, self.quiet_s = message.floor if known else None, 0.0

    def step(self, dt_s: float) -> None:
        """Let time pass: doors shut, floors passed, doors open."""
        self.quiet_s += min(dt_s, QUIET_STEP_S_MAX)
        if self.quiet_s >= QUIET_S:
            self.told = None
        if self.fault is not None:
            self.leaf.way = 0
            return
        target = self.target
        if target is None:
            self.moved_s = 0.0
            self.leaf.step(dt_s, opens=self.told is not None)
            return
        self.moved_s += self.leaf.step(dt_s, opens=False)
        while self.moved_s >= self.lift.floor_s and self.floor != target:
            self.moved_s -= self.lift.floor_s
            self.floor += 1 if target > self.floor else -1

    def report(self, at_ms: int) -> LiftReport:
        """Say how it is."""
        target = self.target
        return LiftReport(
            scene=self.scene,
            lift=self.lift.id,
            at_ms=at_ms,
            floor=self.lift.floors[self.floor].name,
            target=None if target is None else self.lift.floors[target].name,
            doors=(self.leaf.status,),
            fault=self.fault,
        )

    def saved(self) -> SavedDevice:
        """Take down what it remembers."""
        return SavedDevice(
            scene=self.scene,
            kind=DeviceKind.LIFT,
            id=self.lift.id,
            open=self.leaf.open,
            told=self.told,
            number=0,
            floor=self.floor,
            moved_s=self.moved_s,
            fault=self.fault,
        )

    def restore(self, memory: SavedDevice) -> None:
        """Go on as the saved one would have; a floor that is no more is the lowest."""
        self.leaf.open, self.told, self.fault = memory.open, memory.told, memory.fault
        if memory.floor < len(self.lift.floors):
            self.floor, self.moved_s = memory.floor, memory.moved_s


class Devices:
    """All simulated doors and lifts. Deterministic: nothing here is left to chance."""

    def __init__(self) -> None:
        self._devices: dict[Key, SimDoor | SimLift] = {}
        self._remembered: dict[Key, SavedDevice] = {}
        self._said: dict[Key, tuple[object, ...]] = {}  # what mattered in the last report

    def __len__(self) -> int:
        return len(self._devices)

    def follow(self, scenes: Iterable[Scene]) -> None:
        """Have exactly the simulated devices of these scenes that are in service."""
        wanted: dict[Key, tuple[Scene, Door | Lift]] = {}
        for scene in scenes:
            if not scene.disabled:
                for kind, devices in (
                    (DeviceKind.DOOR, scene.doors),
                    (DeviceKind.LIFT, scene.lifts),
                ):
                    for device in devices:
                        if device.simulated:
                            wanted[scene.id, kind, device.id] = (scene, device)
        for key in sorted(self._devices.keys() - wanted.keys()):  # they may come back
            self._remembered[key] = self._devices.pop(key).saved()
            self._said.pop(key, None)
        while len(self._remembered) > REMEMBERED_MAX:
            del self._remembered[next(iter(self._remembered))]
        for key, (scene, device) in wanted.items():
            self._have(key, scene.id, device)

    def _have(self, key: Key, scene: SceneId, device: Door | Lift) -> None:
        present = self._devices.get(key)
        if isinstance(present, SimDoor) and isinstance(device, Door):
            present.door = device
            return
        if isinstance(present, SimLift) and present.lift == device:
            return
        made = SimDoor(scene, device) if isinstance(device, Door) else SimLift(scene, device)
        memory = self._remembered.pop(key, None)
        if memory is not None:
            made.restore(memory)
        self._devices[key] = made

    def tell(self, scene: SceneId, message: ToDevice) -> None:
        """Hand a message to its device; one that is not there hears nothing."""
        if isinstance(message, TellDoor):
            door = self._devices.get((scene, DeviceKind.DOOR, message.door))
            if isinstance(door, SimDoor):
                door.tell(message)
        else:
            lift = self._devices.get((scene, DeviceKind.LIFT, message.lift))
            if isinstance(lift, SimLift):
                lift.tell(message)

    def fault(self, scene: SceneId, kind: DeviceKind, id_: int, words: str) -> None:
        """Give a device a fault: it stays as it is."""
        self._devices[scene, kind, id_].fault = words

    def mend(self, scene: SceneId, kind: DeviceKind, id_: int) -> None:
        """Take the fault away: it goes on."""
        self._devices[scene, kind, id_].fault = None

    def step(self, dt_s: float) -> None:
        """Let time pass for all."""
        for device in self._devices.values():
            device.step(dt_s)

    def reports(self, at_ms: int, *, changed_only: bool = False) -> list[DoorReport | LiftReport]:
        """Give the reports of all, or of those that have something new to say."""
        found: list[DoorReport | LiftReport] = []
        for key, device in self._devices.items():
            report = device.report(at_ms)
            news = msgspec.structs.astuple(msgspec.structs.replace(report, at_ms=0))
            if not changed_only or self._said.get(key) != news:
                self._said[key] = news
                found.append(report)
        return found

    def save(self) -> bytes:
        """Take all down, also those remembered that are not back yet."""
        present = [device.saved() for device in self._devices.values()]
        return msgspec.msgpack.encode(SavedDevices(devices=(*present, *self._remembered.values())))

    def load(self, raw: bytes) -> None:
        """Remember; each goes on where it was as soon as its scene is followed.

        Raises msgspec.DecodeError or ValueError on bytes that are not from `save`.
        """
        known = msgspec.msgpack.decode(raw, type=SavedDevices)
        if known.version != SAVED_VERSION:
            raise ValueError(f"devices of version {known.version}, not {SAVED_VERSION}")
        self._remembered = {(d.scene, d.kind, d.id): d for d in known.devices}
