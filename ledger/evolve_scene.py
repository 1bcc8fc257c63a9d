"""What each event of a scene means."""

from typing import Any, assert_never

import msgspec

from ledger.events.scenes import (
    CallbackGivenUp,
    CallbacksConfigured,
    SceneConfigured,
    SceneDisabled,
    SceneDispatchPaused,
    SceneDispatchResumed,
    SceneEnabled,
    SceneEvent,
    SceneImported,
    SceneMapReplaced,
    SceneRemoved,
    SceneRenamed,
)
from ledger.scene import Scene
from ledger.state import Fleet


def evolve_scene(fleet: Fleet, event: SceneEvent) -> None:
    """Take an event of a scene into the state."""
    match event:
        case SceneImported():
            fleet.scenes[event.scene] = Scene(
                id=event.scene,
                name=event.name,
                digest=event.digest,
                areas=event.areas,
                groups=event.groups,
                container_types=event.container_types,
                config=event.config,
                doors=event.doors,
                lifts=event.lifts,
                modified_ms=event.at_ms,
            )
        case SceneMapReplaced():
            doors, lifts = {d.id for d in event.doors}, {lift.id for lift in event.lifts}
            scene = fleet.scenes[event.scene]
            _change(
                fleet,
                event,
                digest=event.digest,
                areas=event.areas,
                groups=event.groups,
                container_types=event.container_types,
                doors=event.doors,
                lifts=event.lifts,
                opened_doors={d: at for d, at in scene.opened_doors.items() if d in doors},
                held_doors=tuple(d for d in scene.held_doors if d in doors),
                held_lifts={n: area for n, area in scene.held_lifts.items() if n in lifts},
            )
        case SceneConfigured():
            _change(fleet, event, config=event.config)
        case SceneRenamed():
            _change(fleet, event, name=event.name, display_order=event.display_order)
        case SceneDisabled():
            _change(fleet, event, disabled=True)
        case SceneEnabled():
            _change(fleet, event, disabled=False)
        case SceneDispatchPaused():
            _change(fleet, event, dispatch_paused=True)
        case SceneDispatchResumed():
            _change(fleet, event, dispatch_paused=False)
        case SceneRemoved():
            _remove(fleet, event)
        case CallbacksConfigured():
            _change(fleet, event, callbacks=event.callbacks)
        case CallbackGivenUp():
            pass  # for the record, and for queries over the ledger
        case _:
            assert_never(event)


def _change(fleet: Fleet, event: SceneEvent, **fields: Any) -> None:
    scene = fleet.scenes[event.scene]
    fleet.scenes[event.scene] = msgspec.structs.replace(
        scene, version=scene.version + 1, modified_ms=event.at_ms, **fields
    )


def _remove(fleet: Fleet, event: SceneRemoved) -> None:
    """Keep the name, for finished orders have it; robots, reservations and faults go."""
    _change(fleet, event, removed=True, disabled=True, areas=(), doors=(), lifts=())
    for key in [k for k, robot in fleet.robots.items() if robot.scene == event.scene]:
        del fleet.robots[key]
    for unit in [u for u, claim in fleet.claims.items() if claim.scene == event.scene]:
        del fleet.claims[unit]
    for broken in [k for k, fault in fleet.device_faults.items() if fault.scene == event.scene]:
        del fleet.device_faults[broken]
