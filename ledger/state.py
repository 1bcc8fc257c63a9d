"""The live state of everything: what a fold over the ledger gives. Finished orders leave it."""

from enum import StrEnum

import msgspec

from ledger.canonical import canonical_json
from ledger.ids import CommandId, OrderId, RobotKey, RobotName, SceneId, StepId, UnitId
from ledger.link import Instruction, InstructionKind
from ledger.scene import XY, RobotConfig, Scene, Value

STATE_VERSION = 3  # of the shapes below; a snapshot of another version is not used


class OrderKind(StrEnum):
    """Who wants an order (spec/m4.md, OrderKind)."""

    BUSINESS = "Business"
    PARKING = "Parking"
    CHARGING = "Charging"
    IDLE_AVOID = "IdleAvoid"


class OrderStatus(StrEnum):
    """The life of an order (spec/m4.md, OrderStatus)."""

    TO_BE_ALLOCATED = "ToBeAllocated"
    ALLOCATED = "Allocated"  # has a robot, which has not set out for it yet
    PENDING = "Pending"  # all known steps done, but not sealed: waits for more
    EXECUTING = "Executing"
    DONE = "Done"
    CANCELLED = "Cancelled"


TERMINAL = frozenset({OrderStatus.DONE, OrderStatus.CANCELLED})
_DONE, _CANCELLED = OrderStatus.DONE, OrderStatus.CANCELLED  # through the class: 0.4 µs a look


class StepStatus(StrEnum):
    """The life of a step (spec/m4.md, StepStatus)."""

    EXECUTABLE = "Executable"
    EXECUTING = "Executing"
    DONE = "Done"
    SKIPPED = "Skipped"  # in the specification, not used


class StepTask(Value, frozen=True, kw_only=True):
    """What a step asks for: where to go and what to do there."""

    location: str  # a point or a bin
    arguments: str | None = None  # JSON object text: {"binTask": …}, {"operation": …}, or none
    loads: bool = False  # after it the robot carries the container
    unloads: bool = False
    withdrawable: bool = False  # the order may still go to another robot while this step is next
    keeps_robot: bool = False  # the robot's next step must be of this order too


class Step(Value, frozen=True, kw_only=True):
    """One step of an order."""

    id: StepId
    task: StepTask
    status: StepStatus = StepStatus.EXECUTABLE
    version: int = 0
    created_ms: int
    modified_ms: int
    started_ms: int | None = None
    ended_ms: int | None = None


class Reject(Value, frozen=True, kw_only=True):
    """Why something cannot be done now."""

    code: str
    robots: dict[RobotName, str] = {}  # robot -> its own reason
    at_ms: int = 0


class Candidate(Value, frozen=True, kw_only=True):
    """A robot that was considered for an order: what it would cost, or why it was left out."""

    robot: RobotName
    cost_s: float | None = None
    reason: str | None = None


class Order(Value, frozen=True, kw_only=True):
    """A transport order."""

    id: OrderId
    scene: SceneId
    kind: OrderKind = OrderKind.BUSINESS
    status: OrderStatus = OrderStatus.TO_BE_ALLOCATED
    version: int = 0  # counts its changes
    created_ms: int
    created_by: str
    modified_ms: int
    modified_by: str
    external_id: str | None = None
    priority: int = 0
    wanted_robots: tuple[RobotName, ...] = ()
    wanted_groups: tuple[str, ...] = ()
    container: str | None = None
    container_type: str | None = None
    container_heading_rad: float | None = None
    key_locations: tuple[str, ...] = ()
    sealed: bool = False
    suspended: bool = False  # gets no robot, and its robot does not go on with it
    steps: tuple[Step, ...] = ()
    steps_made: int = 0  # ever; numbers the next step's id
    current_step: int = -1
    done_step: int = -1
    robot: RobotName | None = None
    bin: int | None = None  # of the robot
    former_robots: tuple[RobotName, ...] = ()
    assigned_ms: int | None = None
    cost_s: float | None = None
    waited_ms: int | None = None  # from assignment to the first step's start
    loaded: bool = False
    unloaded: bool = False
    load_ms: int | None = None  # time of all loading steps together
    unload_ms: int | None = None
    fault_reason: str | None = None  # not None = faulted
    fault_count: int = 0
    faulted_ms: int | None = None  # since when
    fault_ms: int | None = None  # time in fault, ended faults only
    allocation_reject: Reject | None = None
    execution_reject: Reject | None = None
    done_ms: int | None = None

    @property
    def terminal(self) -> bool:
        """Done or cancelled: it changes no more."""
        return self.status is _DONE or self.status is _CANCELLED


class BinStatus(StrEnum):
    """What is in a robot's storage place (spec/m4.md, RobotBinStatus)."""

    EMPTY = "Empty"
    RESERVED = "Reserved"  # an order has it, the load is not on board yet
    FILLED = "Filled"
    CANCELLED = "Cancelled"  # its order was cancelled with the load on board


class RobotBin(Value, frozen=True, kw_only=True):
    """One storage place of a robot."""

    status: BinStatus = BinStatus.EMPTY
    order: OrderId | None = None
    container: str | None = None


class Robot(Value, frozen=True, kw_only=True):
    """A robot of a scene, without what it reports: that is not in the ledger."""

    scene: SceneId
    config: RobotConfig
    off_duty: bool = False
    online: bool = False
    bins: tuple[RobotBin, ...]
    orders: tuple[OrderId, ...] = ()  # assigned and not finished, first assigned first
    idle_since_ms: int  # since when it has had no order
    instructions: tuple[Instruction, ...] = ()  # the newest of each kind, ascending numbers
    given_up: bool = False  # nobody tries to reach it any more until asked to (M4 noAc)

    @property
    def name(self) -> RobotName:
        """Its name, unique in its scene."""
        return self.config.name

    def told(self, kind: InstructionKind) -> Instruction | None:
        """The newest instruction of a kind."""
        return next((i for i in self.instructions if i.kind is kind), None)


class MapUnit(Value, frozen=True, kw_only=True):
    """Ground that somebody outside asks for (spec/m4.md, MapResourceUnit)."""

    id: UnitId
    owner: str  # a robot of the scene, or the name of an external system
    reason: str = " "
    area: int
    points: tuple[str, ...] = ()  # names
    paths: tuple[str, ...] = ()  # keys
    zones: tuple[tuple[XY, ...], ...] = ()  # polygons, metres


class MapClaim(Value, frozen=True, kw_only=True):
    """An external reservation: asked for, and held once traffic has cleared the ground."""

    scene: SceneId
    unit: MapUnit
    granted: bool = False
    at_ms: int  # asked for, or granted


class DeviceKind(StrEnum):
    """What a device is."""

    DOOR = "Door"
    LIFT = "Lift"


class DeviceFault(Value, frozen=True, kw_only=True):
    """A door or a lift that does not work."""

    scene: SceneId
    kind: DeviceKind
    device: int
    reason: str
    at_ms: int


class Answer(Value, frozen=True, kw_only=True):
    """The first answer to a command that came with an Idempotency-Key."""

    digest: str  # SHA-256 of the request, so that a key is not used for two different requests
    status: int  # HTTP status
    body: str
    at_ms: int


class AnswersWindow(Value, frozen=True, kw_only=True):
    """Which answers are kept for repeated keys: at most so many, and none that is older."""

    count_max: int = 10_000
    age_ms_max: int = 24 * 3_600_000


class Fleet(msgspec.Struct, kw_only=True):
    """All that is live. The only mutable type: a holder of dictionaries with frozen values."""

    position: int = 0  # of the newest event folded in
    at_ms: int = 0
    scenes: dict[SceneId, Scene] = {}
    robots: dict[RobotKey, Robot] = {}
    orders: dict[OrderId, Order] = {}
    order_counts: dict[str, int] = {}  # yyyymmdd -> orders made that day
    claims: dict[UnitId, MapClaim] = {}  # unit ids are unique over all scenes
    device_faults: dict[str, DeviceFault] = {}  # by <scene>/<kind>/<id>
    answers: dict[CommandId, Answer] = {}  # in order of time
    answers_window: AnswersWindow = AnswersWindow()
    answers_chars: int = 0  # of all bodies in `answers`

    def copy(self) -> "Fleet":
        """Fork: new dictionaries, the same values."""
        return Fleet(
            position=self.position,
            at_ms=self.at_ms,
            scenes=dict(self.scenes),
            robots=dict(self.robots),
            orders=dict(self.orders),
            order_counts=dict(self.order_counts),
            claims=dict(self.claims),
            device_faults=dict(self.device_faults),
            answers=dict(self.answers),
            answers_window=self.answers_window,
            answers_chars=self.answers_chars,
        )

    def canonical(self) -> bytes:
        """Canonical JSON: equal states give equal bytes."""
        return canonical_json(self)
