"""Ground that somebody outside reserves: asked for, granted, given back (spec/m4.md §7)."""

import numpy as np

from commands.command import Command, Decision, Events, at_most
from commands.rejected import Reason, Rejected
from commands.resource_ground import fault_of, ground_of, names_of, overlap
from commands.resource_target import Target, areas_named, scene_named, target_of
from ledger.events import (
    AnyEvent,
    MapResourcesAsked,
    MapResourcesGranted,
    MapResourcesReleased,
)
from ledger.ids import SceneId, UnitId
from ledger.proposals import GrantMapResources
from ledger.scene import XY, Area, Scene, Value
from ledger.state import Fleet, MapUnit

UNITS_MAX = 1_000  # in one request
PLACES_MAX = 1_000  # points, and paths, in one unit
ZONES_MAX = 100  # in one unit
CORNERS_MIN, CORNERS_MAX = 3, 200  # of one zone
SHAPES_MAX = 5_000  # points, paths and zones in one request
CLAIMS_MAX = 10_000  # held or asked for at the same time
GRANT_MS_MAX = 15_000  # who asked longer ago has been told that it could not be had


class UnitAsked(Value, frozen=True, kw_only=True):
    """One unit of a request, as its owner names things."""

    id: str
    owner: str
    reason: str = " "
    target: Target = Target()
    points: tuple[str, ...] = ()
    paths: tuple[str, ...] = ()
    zones: tuple[tuple[XY, ...], ...] = ()


class RequestMapResources(Command, frozen=True, kw_only=True):
    """Reserve ground; all of it, or none."""

    units: tuple[UnitAsked, ...]


class LapseMapResources(Command, frozen=True, kw_only=True):
    """Take back what has not been granted yet; nobody waits for it any more."""

    owner: str | None = None  # None = everybody's, as after a restart
    units: tuple[UnitId, ...] = ()


class ReleaseMapResources(Command, frozen=True, kw_only=True):
    """Give ground back; ids that are not known are as good as given back."""

    units: tuple[UnitId, ...]


class ReleaseOwnedMapResources(Command, frozen=True, kw_only=True):
    """Give all ground of an owner back, or what of it lies in one scene or area."""

    owner: str
    target: Target = Target()


class ReleaseAllMapResources(Command, frozen=True, kw_only=True):
    """Give all ground back, whosever it is."""


def request(fleet: Fleet, command: RequestMapResources) -> Decision:
    """Refuse the whole for any of the reasons of the specification; what the owner has already,
    or has asked for already, is no news.
    """
    units = command.units
    _check_whole(units)
    scene, area = _one_target(fleet, units)
    new: dict[UnitId, MapUnit] = {}
    for number, asked in enumerate(units):
        unit = _unit(scene, area, asked, f"units.{number}")
        if _is_new(fleet, scene, new, unit):
            new[unit.id] = unit
    if not new:
        return Decision()
    if len(fleet.claims) + len(new) > CLAIMS_MAX:
        message = f"At most {CLAIMS_MAX} units may be held at the same time; release some first."
        raise Rejected(Reason.TOO_MANY, message, CLAIMS_MAX)
    _check_free(fleet, scene, area, new)
    return Decision(events=(MapResourcesAsked(scene=scene.id, units=tuple(new.values())),))


def _check_whole(units: tuple[UnitAsked, ...]) -> None:
    if not units:
        raise Rejected(Reason.RESOURCE_UNITS_EMPTY, "units must not be empty")
    at_most(len(units), UNITS_MAX, "units")
    if not all(unit.owner.strip() for unit in units):
        raise Rejected(Reason.RESOURCE_OWNER_BLANK, "owner must not be empty")
    if len({unit.owner for unit in units}) > 1:
        raise _mixed()
    shapes = sum(len(unit.points) + len(unit.paths) + len(unit.zones) for unit in units)
    at_most(shapes, SHAPES_MAX, "pointNames, pathKeys and spatialZones of all units")


def _mixed() -> Rejected:
    return Rejected(
        Reason.RESOURCE_UNITS_MIXED,
        "the resources of one application must belong to the same area of the same scene, "
        "and have the same owner",
    )


def _one_target(fleet: Fleet, units: tuple[UnitAsked, ...]) -> tuple[Scene, Area]:
    """Units may name the same area differently; what each of them names must be there."""
    named = dict.fromkeys(unit.target for unit in units)
    found = {(t[0].id, t[1].id): t for t in (target_of(fleet, target) for target in named)}
    if len(found) > 1:
        raise _mixed()
    return next(iter(found.values()))


def _unit(scene: Scene, area: Area, asked: UnitAsked, field: str) -> MapUnit:
    """Hold one unit to its rules."""
    if not asked.id.strip():
        raise Rejected(Reason.FIELD_INVALID, f"Field '{field}.unitId' must not be blank.", field)
    if not (asked.points or asked.paths or asked.zones):
        message = f"Unit '{asked.id}' names no point, no path and no zone."
        raise Rejected(Reason.RESOURCE_UNIT_EMPTY, message, asked.id)
    names = names_of(area)
    strange = [point for point in asked.points if point not in names.points]
    strange += [path for path in asked.paths if path not in names.paths]
    if strange:
        raise Rejected(
            Reason.RESOURCE_PLACE_UNKNOWN,
            "some of the points or paths applied for do not exist in the target area; "
            f"scene id={scene.id}, scene name={scene.name}, area id={area.id}, "
            f"area name={area.name}: {strange[0]}",
            scene.id,
            scene.name,
            area.id,
            area.name,
            strange[0],
        )
    for number, zone in enumerate(asked.zones):
        fault = fault_of(zone)
        if fault is not None:
            message = f"Field '{field}.spatialZones.{number}' is no polygon: {fault}."
            raise Rejected(Reason.RESOURCE_ZONE_INVALID, message, asked.id, number)
    return MapUnit(
        id=UnitId(asked.id),
        owner=asked.owner,
        reason=asked.reason,
        area=area.id,
        points=asked.points,
        paths=asked.paths,
        zones=asked.zones,
    )


def _is_new(fleet: Fleet, scene: Scene, new: dict[UnitId, MapUnit], unit: MapUnit) -> bool:
    """Asking again for the same is fine; an id stands for one content until it is released."""
    claim = fleet.claims.get(unit.id)
    known = new.get(unit.id) if claim is None else claim.unit
    if known is None:
        return True
    if known.owner != unit.owner:
        raise _held(unit.id, known.owner)
    if (claim is not None and claim.scene != scene.id) or _content(known) != _content(unit):
        message = (
            f"Unit '{unit.id}' of owner '{unit.owner}' stands for other resources already; "
            "release it first, or use another unitId."
        )
        raise Rejected(Reason.RESOURCE_UNIT_CHANGED, message, unit.id, unit.owner)
    return False


def _content(unit: MapUnit) -> tuple[object, ...]:
    return unit.area, unit.points, unit.paths, unit.zones


def _held(unit: UnitId, owner: str) -> Rejected:
    return Rejected(
        Reason.RESOURCE_HELD,
        f"the resource applied for (unitId={unit}) is already held by owner={owner}",
        unit,
        owner,
    )


def _check_free(fleet: Fleet, scene: Scene, area: Area, new: dict[UnitId, MapUnit]) -> None:
    """Ground of different owners never overlaps, granted or asked for."""
    owner = next(iter(new.values())).owner
    others = [
        claim.unit
        for claim in fleet.claims.values()
        if claim.scene == scene.id and claim.unit.area == area.id and claim.unit.owner != owner
    ]
    if not others:
        return
    grounds = [ground_of(area, unit) for unit in others]
    held = np.concatenate(grounds)
    whose = np.repeat(np.arange(len(others)), [len(ground) for ground in grounds])
    for unit in new.values():
        first = overlap(ground_of(area, unit), held)
        if first is not None:
            raise _held(unit.id, others[whose[first]].owner)


def has_all(fleet: Fleet, owner: str, units: tuple[UnitId, ...]) -> bool:
    """Tell whether the owner has been granted all of these."""
    claims = (fleet.claims.get(unit) for unit in units)
    return all(c is not None and c.granted and c.unit.owner == owner for c in claims)


def lapse(fleet: Fleet, command: LapseMapResources) -> Decision:
    """What was granted in the meantime stays."""
    ids = fleet.claims if command.owner is None else dict.fromkeys(command.units)
    gone = [
        id_
        for id_ in ids
        if (claim := fleet.claims.get(id_)) is not None
        and not claim.granted
        and command.owner in (None, claim.unit.owner)
    ]
    return Decision(events=_released(fleet, gone, lapsed=True))


def release(fleet: Fleet, command: ReleaseMapResources) -> Decision:
    """Give back what is held or asked for."""
    return Decision(events=_released(fleet, list(dict.fromkeys(command.units))))


def release_owned(fleet: Fleet, command: ReleaseOwnedMapResources) -> Decision:
    """Also in scenes and areas that are disabled: whoever applies must release."""
    if not command.owner.strip():
        raise Rejected(Reason.RESOURCE_OWNER_BLANK, "owner must not be empty")
    target = command.target
    scene = scene_named(fleet, target)
    if scene is not None:
        areas_named(scene, target)  # refuses an area that is not there
    gone = [
        id_
        for id_, claim in fleet.claims.items()
        if claim.unit.owner == command.owner
        and (scene is None or claim.scene == scene.id)
        and (
            not target.names_area
            or claim.unit.area in areas_named(fleet.scenes[claim.scene], target, strict=False)
        )
    ]
    return Decision(events=_released(fleet, gone))


def release_all(fleet: Fleet, command: ReleaseAllMapResources) -> Decision:
    """Give back everybody's."""
    return Decision(events=_released(fleet, list(fleet.claims)))


def grant(fleet: Fleet, proposal: GrantMapResources, at_ms: int) -> Events:
    """State that the ground is free of robots; too late, it is given back: nobody waits for it."""
    pending = [
        id_
        for id_ in dict.fromkeys(proposal.units)
        if (claim := fleet.claims.get(id_)) is not None
        and claim.scene == proposal.scene
        and not claim.granted
    ]
    if not pending:
        message = "None of these units is waited for any more."
        raise Rejected(Reason.RESOURCE_NOT_PENDING, message, *proposal.units)
    late = [i for i in pending if at_ms - fleet.claims[i].at_ms > GRANT_MS_MAX]
    timely = tuple(i for i in pending if i not in set(late))
    granted = (MapResourcesGranted(scene=proposal.scene, units=timely),) if timely else ()
    return (*granted, *_released(fleet, late, lapsed=True))


def _released(fleet: Fleet, ids: list[UnitId], *, lapsed: bool = False) -> Events:
    """State it scene by scene."""
    by_scene: dict[SceneId, list[UnitId]] = {}
    for id_ in ids:
        claim = fleet.claims.get(id_)
        if claim is not None:
            by_scene.setdefault(claim.scene, []).append(id_)
    events: list[AnyEvent] = [
        MapResourcesReleased(scene=scene, units=tuple(units), lapsed=lapsed)
        for scene, units in by_scene.items()
    ]
    return tuple(events)
