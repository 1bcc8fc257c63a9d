"""Where work can be done: the points and bins of a scene, found by name."""

from typing import TypeAlias

import msgspec

from commands.rejected import Reason, Rejected
from ledger.scene import Area, Scene, Value
from ledger.state import StepTask

SCENES_REMEMBERED_MAX = 64  # enough for any site; a map that is pushed out is indexed again

Areas: TypeAlias = tuple[Area, ...]


class Places(Value, frozen=True, kw_only=True):
    """Names of an enabled area's points, and of its bins with what can be done there.

    A bin that has the name of a point goes first: only a bin can be asked for a bin task.
    """

    points: frozenset[str]
    bins: dict[str, frozenset[str]]  # bin -> names of its bin tasks

    def __contains__(self, location: str) -> bool:
        return location in self.bins or location in self.points


class _Arguments(msgspec.Struct, frozen=True, gc=False):
    bin_task: str | msgspec.UnsetType = msgspec.field(default=msgspec.UNSET, name="binTask")


_arguments = msgspec.json.Decoder(_Arguments)
# a map is a constant that takes milliseconds to index: remembered by identity, so never stale
_remembered: dict[int, tuple[Areas, Places]] = {}


def places_of(scene: Scene) -> Places:
    """Index the scene's map, once for as long as it stays the same."""
    entry = _remembered.get(id(scene.areas))
    if entry is not None and entry[0] is scene.areas:
        return entry[1]
    places = places_in(scene.areas)
    while len(_remembered) >= SCENES_REMEMBERED_MAX:
        _remembered.pop(next(iter(_remembered)), None)
    _remembered[id(scene.areas)] = (scene.areas, places)
    return places


def places_in(areas: Areas) -> Places:
    """Index a map that is no scene's yet."""
    enabled = [area for area in areas if not area.disabled]
    return Places(
        points=frozenset(point.name for area in enabled for point in area.points),
        bins={b.name: frozenset(t.name for t in b.tasks) for area in enabled for b in area.bins},
    )


def check_location(places: Places, location: str, field: str) -> None:
    """Refuse a location that is neither a point nor a bin of the scene."""
    if location not in places:
        message = f"Field '{field}': the scene has no point or bin '{location}'."
        raise Rejected(Reason.LOCATION_UNKNOWN, message, field, location)


def check_task(places: Places, task: StepTask, field: str) -> None:
    """Hold a step to its rules (spec/m4.md, CreateStepReq); `field` says where it stood."""
    if task.loads and task.unloads:
        message = f"Field '{field}': forLoad and forUnload must not both be true."
        raise Rejected(Reason.STEP_LOADS_AND_UNLOADS, message, field)
    check_location(places, task.location, f"{field}.location")
    if task.arguments is None:
        return
    try:
        bin_task = _arguments.decode(task.arguments).bin_task
    except msgspec.DecodeError as error:
        message = f"Field '{field}.rbkArgs': binTask must be a text ({error})."
        raise Rejected(Reason.ARGUMENTS_INVALID, message, field) from None
    if bin_task is msgspec.UNSET:
        return
    tasks = places.bins.get(task.location)
    if tasks is None:
        message = (
            f"Field '{field}.location': '{task.location}' is a point, and "
            f"the bin task '{bin_task}' needs a bin."
        )
        raise Rejected(Reason.BIN_TASK_NEEDS_BIN, message, field, task.location)
    if bin_task not in tasks:
        message = f"Field '{field}.rbkArgs': bin '{task.location}' has no bin task '{bin_task}'."
        raise Rejected(Reason.BIN_TASK_UNKNOWN, message, field, task.location, bin_task)
