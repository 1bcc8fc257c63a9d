"""What events of external reservations and of devices mean."""

from typing import assert_never

import msgspec

from ledger.events.devices import (
    DeviceEvent,
    DeviceFaulted,
    DeviceRecovered,
    DoorCloseAsked,
    DoorHeldOpen,
    DoorLetGo,
    DoorOpenAsked,
    LiftHeldOpen,
    LiftLetGo,
)
from ledger.events.resources import (
    MapResourcesAsked,
    MapResourcesGranted,
    MapResourcesReleased,
    ResourceEvent,
)
from ledger.ids import SceneId
from ledger.scene import Scene
from ledger.state import DeviceFault, DeviceKind, Fleet, MapClaim

replace = msgspec.structs.replace


def evolve_resource(fleet: Fleet, event: ResourceEvent) -> None:
    """Take an event of an external reservation into the state."""
    match event:
        case MapResourcesAsked():
            for unit in event.units:
                claim = MapClaim(scene=event.scene, unit=unit, at_ms=event.at_ms)
                fleet.claims[unit.id] = claim
        case MapResourcesGranted():
            for id_ in event.units:
                fleet.claims[id_] = replace(fleet.claims[id_], granted=True, at_ms=event.at_ms)
        case MapResourcesReleased():
            for id_ in event.units:
                del fleet.claims[id_]
        case _:
            assert_never(event)


def device_key(scene: SceneId, kind: DeviceKind, device: int) -> str:
    """Key of a device's fault in the fleet."""
    return f"{scene}/{kind}/{device}"


def evolve_device(fleet: Fleet, event: DeviceEvent) -> None:
    """Take an event of a door or a lift into the state."""
    match event:
        case DeviceFaulted():
            fleet.device_faults[device_key(event.scene, event.kind, event.device)] = DeviceFault(
                scene=event.scene,
                kind=event.kind,
                device=event.device,
                reason=event.reason,
                at_ms=event.at_ms,
            )
        case DeviceRecovered():
            fleet.device_faults.pop(device_key(event.scene, event.kind, event.device), None)
        case (
            DoorOpenAsked()
            | DoorCloseAsked()
            | DoorHeldOpen()
            | DoorLetGo()
            | LiftHeldOpen()
            | LiftLetGo()
        ):
            fleet.scenes[event.scene] = _told(fleet.scenes[event.scene], event)
        case _:
            assert_never(event)


def _told(
    scene: Scene,
    event: DoorOpenAsked | DoorCloseAsked | DoorHeldOpen | DoorLetGo | LiftHeldOpen | LiftLetGo,
) -> Scene:
    match event:
        case DoorOpenAsked():
            return replace(scene, opened_doors=scene.opened_doors | {event.door: event.at_ms})
        case DoorCloseAsked():
            opened = {d: at for d, at in scene.opened_doors.items() if d != event.door}
            held = tuple(d for d in scene.held_doors if d != event.door)
            return replace(scene, opened_doors=opened, held_doors=held)
        case DoorHeldOpen():
            held_doors = tuple(sorted({*scene.held_doors, event.door}))
            return replace(scene, held_doors=held_doors)
        case DoorLetGo():
            return replace(scene, held_doors=tuple(d for d in scene.held_doors if d != event.door))
        case LiftHeldOpen():
            return replace(scene, held_lifts=scene.held_lifts | {event.lift: event.area})
        case LiftLetGo():
            held_lifts = {n: area for n, area in scene.held_lifts.items() if n != event.lift}
            return replace(scene, held_lifts=held_lifts)
        case _:
            assert_never(event)
