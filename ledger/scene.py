"""Value types of a scene: what the map and the robots on it are, in metres and radians."""

from enum import StrEnum
from typing import TypeAlias

import msgspec

from ledger.callbacks import CallbackConfig
from ledger.ids import BinName, PathKey, PointName, RobotName, SceneId, path_key
from ledger.scene_config import SceneConfig

XY: TypeAlias = tuple[float, float]  # metres, in the scene's frame


class Value(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Base of every value that state and events hold: immutable, and free of reference cycles."""


class PointKind(StrEnum):
    """What a point is for; importers translate the vendors' classes."""

    WAYPOINT = "Waypoint"  # only driven over
    ACTION = "Action"  # work is done here
    PARKING = "Parking"
    CHARGING = "Charging"


class Point(Value, frozen=True, kw_only=True):
    """A named place that a robot's reference point can be on."""

    name: PointName
    x_m: float
    y_m: float
    kind: PointKind = PointKind.WAYPOINT
    heading_rad: float | None = None  # heading demanded on arrival; None = any
    turning: bool = True  # may a robot turn in place here


class Path(Value, frozen=True, kw_only=True):
    """A directed way between two points; a two-way lane is two paths."""

    start: PointName
    end: PointName
    # Bezier control points in between, none for a straight path; with both ends they fix the degree
    controls: tuple[XY, ...] = ()
    backward: bool = False  # the robot drives it in reverse
    speed_mps_max: float | None = None  # None = the group's own limit
    acceleration_mps2_max: float | None = None

    @property
    def key(self) -> PathKey:
        """Key of this path, unique in its area."""
        return path_key(self.start, self.end)


class BinTask(Value, frozen=True, kw_only=True):
    """What a robot can be told to do at a bin, by the name that clients use."""

    name: str
    operation: str  # the robot's word, for example JackLoad
    arguments: str = "{}"  # JSON object text, handed to the robot as it is


class Bin(Value, frozen=True, kw_only=True):
    """A storage place for one container, reached from one point."""

    name: BinName
    point: PointName
    tasks: tuple[BinTask, ...] = ()


class Area(Value, frozen=True, kw_only=True):
    """One connected map of a scene, for instance a floor."""

    id: int
    name: str
    map_name: str
    map_digest: str  # MD5 of the map file as imported, by which robots compare maps
    points: tuple[Point, ...]
    paths: tuple[Path, ...]
    bins: tuple[Bin, ...] = ()
    walls: tuple[tuple[XY, XY], ...] = ()  # line segments, for drawing only
    disabled: bool = False


class Kinematics(Value, frozen=True, kw_only=True):
    """Limits of a robot's motion."""

    speed_mps_max: float = 1.2
    acceleration_mps2_max: float = 0.6
    turn_radps_max: float = 1.0
    turn_radps2_max: float = 2.0


class Group(Value, frozen=True, kw_only=True):
    """Robots of one build: one footprint empty, one loaded, one set of limits."""

    id: int
    name: str
    # corners counter-clockwise, metres, in the robot's frame: x forwards, origin = reference point
    footprint: tuple[XY, ...] = ((0.5, 0.35), (-0.5, 0.35), (-0.5, -0.35), (0.5, -0.35))
    kinematics: Kinematics = Kinematics()
    # likewise, of robot and load together while it carries one; None = as without
    footprint_loaded: tuple[XY, ...] | None = None


class RobotVendor(StrEnum):
    """Brands of robots (spec/m4.md, RobotVendor)."""

    SEER = "Seer"
    HAI = "Hai"
    HIK = "Hik"


class ConnectionType(StrEnum):
    """Who calls whom (spec/m4.md, RobotConnectionType)."""

    FLEET_TO_ROBOT = "FleetToRobot"
    ROBOT_TO_FLEET = "RobotToFleet"
    GATEWAY = "GwWs"


class RobotConfig(Value, frozen=True, kw_only=True):
    """How a robot is set up (spec/m4.md, SceneRobot)."""

    name: RobotName
    group: int = 0  # id of its Group
    disabled: bool = False
    simulated: bool = False
    remark: str | None = None
    tags: tuple[str, ...] = ()
    vendor: RobotVendor = RobotVendor.SEER
    bin_count: int = 1  # storage places, without the fork of `plus_one`
    image: str | None = None  # JSON text, the client's own
    connection: ConnectionType | None = None
    host: str | None = None
    port_first: int | None = None
    tls: bool | None = None
    gateway_user: str | None = None
    gateway_secret_kept: bool = False  # there is one; itself it is never in the ledger
    plus_one: bool | None = None  # one load more, on the fork (spec/m4.md, plusOne)

    @property
    def storage_places(self) -> int:
        """Loads it carries at once; the fork is one more only beside several (N + 1)."""
        return self.bin_count + (self.plus_one is True and self.bin_count > 1)


class ContainerType(Value, frozen=True, kw_only=True):
    """A kind of container that orders may name."""

    name: str
    footprint: tuple[XY, ...] = ()  # metres; empty = within the robot's own footprint


class Door(Value, frozen=True, kw_only=True):
    """A door across a lane: robots pass only while it reports that it is open."""

    id: int  # unique in its scene
    name: str
    area: int
    paths: tuple[PathKey, ...] = ()  # what leads through it …
    points: tuple[PointName, ...] = ()  # … or lies in it; one of both is given
    open_ahead_m: float = 2.0  # it is asked to open when a robot is so near (M4 openPreDist)
    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    width_m: float = 1.0
    simulated: bool = False
    disabled: bool = False  # out of service: nobody passes


class LiftFloor(Value, frozen=True, kw_only=True):
    """Where a lift stops."""

    name: str  # as the lift's own control names it
    area: int
    point: PointName | None = None  # inside the cabin


class Lift(Value, frozen=True, kw_only=True):
    """A lift between areas."""

    id: int  # unique in its scene
    name: str
    floors: tuple[LiftFloor, ...]
    door_s: float = 3.0  # to open, and to close
    floor_s: float = 5.0  # from one floor to the next
    simulated: bool = False
    disabled: bool = False


class Scene(Value, frozen=True, kw_only=True):
    """One site under one dispatch: maps, robot groups and settings (robots are kept beside it)."""

    id: SceneId
    name: str
    digest: str  # SHA-256 of the scene file: the same content is the same scene
    areas: tuple[Area, ...]
    groups: tuple[Group, ...]
    container_types: tuple[ContainerType, ...] = ()
    config: SceneConfig = SceneConfig()
    doors: tuple[Door, ...] = ()
    lifts: tuple[Lift, ...] = ()
    callbacks: CallbackConfig = CallbackConfig()
    disabled: bool = False
    dispatch_paused: bool = False  # no order gets a robot; what is assigned goes on
    removed: bool = False  # gone for clients; kept because finished orders name it
    display_order: int = 0
    version: int = 0  # counts its changes
    modified_ms: int = 0
    opened_doors: dict[int, int] = {}  # door -> when somebody asked for it to open once
    held_doors: tuple[int, ...] = ()  # kept open until let go, ascending
    held_lifts: dict[int, int] = {}  # lift -> area at which it is kept open


class SceneFile(Value, frozen=True, kw_only=True):
    """What `fleetledger scene import` writes and `serve --scene` reads."""

    name: str
    areas: tuple[Area, ...]
    groups: tuple[Group, ...] = (Group(id=0, name="default"),)
    container_types: tuple[ContainerType, ...] = ()
    doors: tuple[Door, ...] = ()
    lifts: tuple[Lift, ...] = ()
    robots: tuple[RobotConfig, ...] = ()
    config: SceneConfig = SceneConfig()
