"""What the scheduler proposes to the core, which decides each one on the newest state.

Shared vocabulary: `scheduler` makes proposals, `commands` decides them, and neither imports the
other. A proposal that no longer fits (the order was cancelled meanwhile) is refused, never forced.
"""

from typing import TypeAlias

from ledger.ids import OrderId, RobotName, SceneId, UnitId
from ledger.scene import Value
from ledger.state import Candidate, DeviceKind, OrderKind
from ledger.waits import CycleSeen, WaitSum


class Proposal(Value, frozen=True, kw_only=True, tag=True):
    """Base of all proposals."""

    scene: SceneId


class AssignOrder(Proposal, frozen=True, kw_only=True):
    """Give an order to a robot and reserve one of its bins."""

    order: OrderId
    robot: RobotName
    bin: int
    cost_s: float
    candidates: tuple[Candidate, ...] = ()  # who else was considered, and why not


class WithdrawOrder(Proposal, frozen=True, kw_only=True):
    """Take an order back from its robot, to be assigned anew."""

    order: OrderId
    reason: str


class RejectAssignment(Proposal, frozen=True, kw_only=True):
    """Say why an order cannot be assigned now; only sent when the answer has changed."""

    order: OrderId
    code: str
    robots: dict[RobotName, str]  # robot -> its own reason


class RejectExecution(Proposal, frozen=True, kw_only=True):
    """Say why an assigned order does not get on; an empty code takes the last one back."""

    order: OrderId
    code: str
    robots: dict[RobotName, str] = {}


class StartStep(Proposal, frozen=True, kw_only=True):
    """The robot sets out for this step."""

    order: OrderId
    step: int
    robot: RobotName


class FinishStep(Proposal, frozen=True, kw_only=True):
    """The robot has been there and has done the step's action."""

    order: OrderId
    step: int
    robot: RobotName


class FaultOrder(Proposal, frozen=True, kw_only=True):
    """The order cannot go on without a retry by a person or a program."""

    order: OrderId
    reason: str


class CreateSystemOrder(Proposal, frozen=True, kw_only=True):
    """An order of the system's own: parking, charging or making way."""

    kind: OrderKind
    robot: RobotName
    location: str
    cost_s: float
    arguments: str | None = None  # JSON object text of its one step


class ConnectRobot(Proposal, frozen=True, kw_only=True):
    """The robot answers."""

    robot: RobotName


class DisconnectRobot(Proposal, frozen=True, kw_only=True):
    """The robot does not answer any more."""

    robot: RobotName


class GiveUpRobot(Proposal, frozen=True, kw_only=True):
    """The robot did not come back however often it was asked to: a person must ask (M4 noAc)."""

    robot: RobotName


class StopRobot(Proposal, frozen=True, kw_only=True):
    """What the guard of traffic sees must not be: the robot is to stop where it is."""

    robot: RobotName
    reason: str


class LiftStop(Proposal, frozen=True, kw_only=True):
    """What the guard stopped the robot for is over."""

    robot: RobotName


class GrantMapResources(Proposal, frozen=True, kw_only=True):
    """Traffic holds the ground of these external reservations for their owners now."""

    units: tuple[UnitId, ...]


DOES_NOT_ANSWER = "does not answer"  # reason of a FaultDevice for a device that is not heard


class FaultDevice(Proposal, frozen=True, kw_only=True):
    """A door or a lift reports a fault, or is not heard any more."""

    kind: DeviceKind
    device: int
    reason: str


class RecoverDevice(Proposal, frozen=True, kw_only=True):
    """It works again."""

    kind: DeviceKind
    device: int


class NoteWaits(Proposal, frozen=True, kw_only=True):
    """What robots have waited for since a moment, summed up."""

    from_ms: int
    waits: tuple[WaitSum, ...]
    left_out_ms: int = 0
    cycles: tuple[CycleSeen, ...] = ()
    pushes: int = 0
    plannings: dict[str, int] = {}


AnyProposal: TypeAlias = (
    AssignOrder
    | WithdrawOrder
    | RejectAssignment
    | RejectExecution
    | StartStep
    | FinishStep
    | FaultOrder
    | CreateSystemOrder
    | ConnectRobot
    | DisconnectRobot
    | GiveUpRobot
    | StopRobot
    | LiftStop
    | GrantMapResources
    | FaultDevice
    | RecoverDevice
    | NoteWaits
)
