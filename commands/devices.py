"""Doors and lifts: opened, kept open, let go; and what the scheduler hears of their faults."""

from collections.abc import Callable
from typing import TypeAlias

from commands.command import Command, Decision, Events, at_most, scene_of
from commands.rejected import Reason, Rejected
from ledger.events import (
    AnyEvent,
    DeviceFaulted,
    DeviceRecovered,
    DoorCloseAsked,
    DoorHeldOpen,
    DoorLetGo,
    DoorOpenAsked,
    LiftHeldOpen,
    LiftLetGo,
)
from ledger.evolve_resources import device_key
from ledger.ids import SceneId
from ledger.proposals import FaultDevice, RecoverDevice
from ledger.scene import Door, Lift, Scene
from ledger.state import DeviceKind, Fleet

DOORS_MAX = 1_000  # in one call
FAULT_CHARS_MAX = 500  # of what a device says of its fault

_Ask: TypeAlias = Callable[[Door], AnyEvent | None]  # None = nothing happens to it


class OpenDoors(Command, frozen=True, kw_only=True):
    """Have doors open once; each closes by itself."""

    scene: SceneId
    doors: tuple[int, ...]
    remark: str = ""


class CloseDoors(Command, frozen=True, kw_only=True):
    """Have doors close that were opened or kept open; robots that pass still keep them open."""

    scene: SceneId
    doors: tuple[int, ...]
    remark: str = ""


class KeepDoorsOpen(Command, frozen=True, kw_only=True):
    """Keep doors open from now on, or let them go."""

    scene: SceneId
    doors: tuple[int, ...]
    keep_open: bool = True
    remark: str = ""


class KeepLiftOpen(Command, frozen=True, kw_only=True):
    """Send a lift to an area and keep it open there."""

    scene: SceneId
    lift: int
    area: int
    remark: str = ""


class LetLiftGo(Command, frozen=True, kw_only=True):
    """Let a lift go its own ways again."""

    scene: SceneId
    lift: int
    remark: str = ""


def open_doors(fleet: Fleet, command: OpenDoors) -> Decision:
    """Each door on its own; one that cannot open now is refused rather than remembered."""
    scene = scene_of(fleet, command.scene)

    def ask(door: Door) -> AnyEvent | None:
        _check_works(fleet, scene, DeviceKind.DOOR, door)
        return DoorOpenAsked(scene=scene.id, door=door.id, remark=command.remark)

    return _each(scene, command.doors, ask)


def close_doors(fleet: Fleet, command: CloseDoors) -> Decision:
    """Each door on its own; asking is news even where nobody has had the door open."""
    scene = scene_of(fleet, command.scene)

    def ask(door: Door) -> AnyEvent | None:
        return DoorCloseAsked(scene=scene.id, door=door.id, remark=command.remark)

    return _each(scene, command.doors, ask)


def keep_doors_open(fleet: Fleet, command: KeepDoorsOpen) -> Decision:
    """Each door on its own; nothing happens to one that is kept open, or let go, already."""
    scene = scene_of(fleet, command.scene)

    def ask(door: Door) -> AnyEvent | None:
        held = door.id in scene.held_doors
        if not command.keep_open:
            let_go = DoorLetGo(scene=scene.id, door=door.id, remark=command.remark)
            return let_go if held else None
        _check_works(fleet, scene, DeviceKind.DOOR, door)
        if held:
            return None
        return DoorHeldOpen(scene=scene.id, door=door.id, remark=command.remark)

    return _each(scene, command.doors, ask)


def keep_lift_open(fleet: Fleet, command: KeepLiftOpen) -> Decision:
    """Refuse areas at which the lift does not stop."""
    scene = scene_of(fleet, command.scene)
    lift = _lift(scene, command.lift)
    if all(floor.area != command.area for floor in lift.floors):
        served = ", ".join(str(floor.area) for floor in lift.floors)
        message = (
            f"Field 'toAreaId': lift '{lift.name}' does not stop at area {command.area}; "
            f"it stops at {served}."
        )
        raise Rejected(Reason.LIFT_AREA_UNKNOWN, message, command.area)
    _check_works(fleet, scene, DeviceKind.LIFT, lift)
    if scene.held_lifts.get(lift.id) == command.area:
        return Decision()
    held = LiftHeldOpen(scene=scene.id, lift=lift.id, area=command.area, remark=command.remark)
    return Decision(events=(held,))


def let_lift_go(fleet: Fleet, command: LetLiftGo) -> Decision:
    """Nothing happens to a lift that nobody keeps open."""
    scene = scene_of(fleet, command.scene)
    lift = _lift(scene, command.lift)
    if lift.id not in scene.held_lifts:
        return Decision()
    return Decision(events=(LiftLetGo(scene=scene.id, lift=lift.id, remark=command.remark),))


def fault(fleet: Fleet, proposal: FaultDevice) -> Events:
    """Take the news, unless it is known, or the device is gone."""
    scene = fleet.scenes.get(proposal.scene)
    known = () if scene is None else _known(scene, proposal.kind)
    if proposal.device not in {device.id for device in known}:
        raise _unknown(proposal.kind, proposal.device)
    reason = proposal.reason[:FAULT_CHARS_MAX]
    before = fleet.device_faults.get(device_key(proposal.scene, proposal.kind, proposal.device))
    if before is not None and before.reason == reason:
        return ()
    return (
        DeviceFaulted(
            scene=proposal.scene, kind=proposal.kind, device=proposal.device, reason=reason
        ),
    )


def recover(fleet: Fleet, proposal: RecoverDevice) -> Events:
    """Take the news, unless it is known; a device that is gone has no fault either."""
    key = device_key(proposal.scene, proposal.kind, proposal.device)
    if key not in fleet.device_faults:
        return ()
    return (DeviceRecovered(scene=proposal.scene, kind=proposal.kind, device=proposal.device),)


def _each(scene: Scene, ids: tuple[int, ...], ask: _Ask) -> Decision:
    at_most(len(ids), DOORS_MAX, "ids")
    doors = {door.id: door for door in scene.doors}
    events: list[AnyEvent] = []
    refused: dict[str, Rejected] = {}
    for id_ in dict.fromkeys(ids):
        door = doors.get(id_)
        try:
            if door is None:
                raise _unknown(DeviceKind.DOOR, id_)
            event = ask(door)
        except Rejected as no:
            refused[str(id_)] = no
        else:
            events += [] if event is None else [event]
    return Decision(events=tuple(events), refused=refused)


def _lift(scene: Scene, id_: int) -> Lift:
    for lift in scene.lifts:
        if lift.id == id_:
            return lift
    raise _unknown(DeviceKind.LIFT, id_)


def _known(scene: Scene, kind: DeviceKind) -> tuple[Door | Lift, ...]:
    return scene.doors if kind is DeviceKind.DOOR else scene.lifts


def _unknown(kind: DeviceKind, id_: int) -> Rejected:
    reason = Reason.DOOR_UNKNOWN if kind is DeviceKind.DOOR else Reason.LIFT_UNKNOWN
    return Rejected(reason, f"There is no {kind.lower()} with id {id_} in the scene.", id_)


def _check_works(fleet: Fleet, scene: Scene, kind: DeviceKind, device: Door | Lift) -> None:
    """Refuse what the device could not do: the caller learns it now, not by watching."""
    what = f"The {kind.lower()} '{device.name}' (id {device.id})"
    if device.disabled:
        raise Rejected(Reason.DEVICE_DISABLED, f"{what} is disabled.", device.id)
    broken = fleet.device_faults.get(device_key(scene.id, kind, device.id))
    if broken is not None:
        message = f"{what} does not work: {broken.reason}."
        raise Rejected(Reason.DEVICE_FAULTED, message, device.id, broken.reason)
