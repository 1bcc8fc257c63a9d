"""How an order gets on: what the scheduler observed of its steps, decided on the newest state."""

from commands.assignment import check_unfaulted, order_in, robot_in
from commands.command import Events, scene_of
from commands.order_suspension import check_not_suspended
from commands.rejected import Reason, Rejected
from ledger.events import (
    OrderFaulted,
    OrderFinished,
    RobotConnected,
    RobotDisconnected,
    RobotGivenUp,
    RobotSoftStopLifted,
    RobotSoftStopped,
    StepFinished,
    StepStarted,
)
from ledger.ids import RobotName
from ledger.link import InstructionKind
from ledger.proposals import (
    ConnectRobot,
    DisconnectRobot,
    FaultOrder,
    FinishStep,
    GiveUpRobot,
    LiftStop,
    StartStep,
    StopRobot,
)
from ledger.state import Fleet, Order, StepStatus


def start_step(fleet: Fleet, proposal: StartStep) -> Events:
    """Steps are done one after another, in order, by the order's own robot."""
    order = order_in(fleet, proposal.scene, proposal.order)
    check_not_suspended(order)
    scene_of(fleet, order.scene)  # no robot sets out in a scene that is out of service
    _check_ready(order, proposal.robot, proposal.step)
    status = order.steps[proposal.step].status
    before = order.steps[: proposal.step]
    if status is not StepStatus.EXECUTABLE or any(s.status is not StepStatus.DONE for s in before):
        message = f"Step {proposal.step} of order '{order.id}' is {status}, or not next."
        raise Rejected(Reason.STEP_NOT_EXECUTABLE, message, order.id, proposal.step)
    return (
        StepStarted(scene=order.scene, order=order.id, step=proposal.step, robot=proposal.robot),
    )


def finish_step(fleet: Fleet, proposal: FinishStep) -> Events:
    """The last step of a sealed order finishes it."""
    order = order_in(fleet, proposal.scene, proposal.order)
    _check_ready(order, proposal.robot, proposal.step)
    status = order.steps[proposal.step].status
    if status is not StepStatus.EXECUTING:
        message = f"Step {proposal.step} of order '{order.id}' is {status}."
        raise Rejected(Reason.STEP_NOT_EXECUTING, message, order.id, proposal.step)
    finished = StepFinished(
        scene=order.scene, order=order.id, step=proposal.step, robot=proposal.robot
    )
    left = (s for n, s in enumerate(order.steps) if n != proposal.step)
    if order.sealed and all(step.status is StepStatus.DONE for step in left):
        return finished, OrderFinished(scene=order.scene, order=order.id)
    return (finished,)


def fault(fleet: Fleet, proposal: FaultOrder) -> Events:
    """A fault on top of a fault is no news: the first one is what a person looks into."""
    order = order_in(fleet, proposal.scene, proposal.order)
    if order.fault_reason is not None:
        return ()
    return (OrderFaulted(scene=order.scene, order=order.id, reason=proposal.reason),)


def connect(fleet: Fleet, proposal: ConnectRobot) -> Events:
    """Only news is an event."""
    robot = robot_in(fleet, proposal.scene, proposal.robot)
    return () if robot.online else (RobotConnected(scene=robot.scene, robot=robot.name),)


def disconnect(fleet: Fleet, proposal: DisconnectRobot) -> Events:
    """Only news is an event."""
    robot = robot_in(fleet, proposal.scene, proposal.robot)
    return (RobotDisconnected(scene=robot.scene, robot=robot.name),) if robot.online else ()


def give_up(fleet: Fleet, proposal: GiveUpRobot) -> Events:
    """Only news is an event; a robot that answers meanwhile is not given up."""
    robot = robot_in(fleet, proposal.scene, proposal.robot)
    if robot.online or robot.given_up:
        return ()
    return (RobotGivenUp(scene=robot.scene, robot=robot.name),)


def stop(fleet: Fleet, proposal: StopRobot) -> Events:
    """Who is stopped already stays so, for whatever reason."""
    robot = robot_in(fleet, proposal.scene, proposal.robot)
    told = robot.told(InstructionKind.SOFT_STOP)
    if told is not None and told.on:
        return ()
    return (RobotSoftStopped(scene=robot.scene, robot=robot.name, reason=proposal.reason),)


def lift(fleet: Fleet, proposal: LiftStop) -> Events:
    """The guard lifts what the guard has stopped; a person's stop is that person's."""
    robot = robot_in(fleet, proposal.scene, proposal.robot)
    told = robot.told(InstructionKind.SOFT_STOP)
    if told is None or not told.on or not told.reason:
        return ()
    return (RobotSoftStopLifted(scene=robot.scene, robot=robot.name),)


def _check_ready(order: Order, robot: RobotName, step: int) -> None:
    if order.robot != robot:
        message = f"Order '{order.id}' is not carried by robot '{robot}'."
        raise Rejected(Reason.ORDER_NOT_ASSIGNED, message, order.id, robot)
    check_unfaulted(order)
    if not 0 <= step < len(order.steps):
        message = f"Order '{order.id}' has no step {step}."
        raise Rejected(Reason.STEP_UNKNOWN, message, order.id, step)
