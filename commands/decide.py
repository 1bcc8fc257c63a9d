"""From what is asked to what happens: these two only route."""

from typing import TypeAlias, assert_never

from commands import (
    access,
    answers,
    assignment,
    callbacks,
    devices,
    execution,
    instructions,
    order_suspension,
    orders,
    recovery,
    resources,
    robot_config,
    robot_duty,
    robots,
    scene_config,
    scene_life,
    scenes,
    steps,
    waits,
)
from commands.access import RecordAccess
from commands.answers import SetAnswersWindow
from commands.callbacks import ConfigureCallbacks, GiveUpCallback
from commands.command import Decision, Events
from commands.devices import CloseDoors, KeepDoorsOpen, KeepLiftOpen, LetLiftGo, OpenDoors
from commands.instructions import (
    CancelNavigation,
    ClearRobotAlarms,
    ControlRobots,
    PauseRobots,
    ReconnectRobots,
    SoftStopRobots,
)
from commands.order_suspension import SuspendOrders
from commands.orders import (
    CancelAllOrders,
    CancelOrder,
    CancelOrders,
    CreateOrder,
    PrioritiseOrders,
    RetryOrders,
    SealOrder,
    SealOrders,
)
from commands.recovery import RecoverRobots
from commands.resources import (
    LapseMapResources,
    ReleaseAllMapResources,
    ReleaseMapResources,
    ReleaseOwnedMapResources,
    RequestMapResources,
)
from commands.robot_config import ReconfigureRobot, ReconfigureRobots
from commands.robot_duty import ClearRobotBins, DisableRobots, SendRobotsOffDuty
from commands.robots import CreateRobots, CreateRobotSeries, RemoveRobots
from commands.scene_config import ConfigureScene
from commands.scene_life import (
    CreateScene,
    DisableScene,
    PauseDispatch,
    RemoveScenes,
    RenameScene,
)
from commands.scenes import ImportScene
from commands.steps import AddSteps, ChangeSteps, DeleteSteps
from ledger.proposals import (
    AnyProposal,
    AssignOrder,
    ConnectRobot,
    CreateSystemOrder,
    DisconnectRobot,
    FaultDevice,
    FaultOrder,
    FinishStep,
    GiveUpRobot,
    GrantMapResources,
    LiftStop,
    NoteWaits,
    RecoverDevice,
    RejectAssignment,
    RejectExecution,
    StartStep,
    StopRobot,
    WithdrawOrder,
)
from ledger.state import Fleet

OrderCommand: TypeAlias = (
    CreateOrder
    | AddSteps
    | ChangeSteps
    | DeleteSteps
    | SealOrder
    | SealOrders
    | CancelOrder
    | CancelOrders
    | CancelAllOrders
    | PrioritiseOrders
    | RetryOrders
    | SuspendOrders
)
RobotCommand: TypeAlias = (
    CreateRobots
    | CreateRobotSeries
    | RemoveRobots
    | ReconfigureRobot
    | ReconfigureRobots
    | DisableRobots
    | SendRobotsOffDuty
    | ClearRobotBins
    | SoftStopRobots
    | PauseRobots
    | ControlRobots
    | ClearRobotAlarms
    | ReconnectRobots
    | CancelNavigation
    | RecoverRobots
)
DeviceCommand: TypeAlias = OpenDoors | CloseDoors | KeepDoorsOpen | KeepLiftOpen | LetLiftGo
ResourceCommand: TypeAlias = (
    RequestMapResources
    | LapseMapResources
    | ReleaseMapResources
    | ReleaseOwnedMapResources
    | ReleaseAllMapResources
)
SceneCommand: TypeAlias = (
    ImportScene
    | CreateScene
    | RenameScene
    | DisableScene
    | PauseDispatch
    | RemoveScenes
    | ConfigureScene
    | ConfigureCallbacks
    | GiveUpCallback
)
AnyCommand: TypeAlias = (
    OrderCommand
    | RobotCommand
    | DeviceCommand
    | ResourceCommand
    | SceneCommand
    | RecordAccess
    | SetAnswersWindow
)


def decide(fleet: Fleet, command: AnyCommand) -> Decision:
    """Decide a client's command; raises Rejected where nothing of it can be done."""
    if isinstance(command, OrderCommand):
        return _of_order(fleet, command)
    if isinstance(command, RobotCommand):
        return _of_robot(fleet, command)
    if isinstance(command, DeviceCommand):
        return _of_device(fleet, command)
    if isinstance(command, ResourceCommand):
        return _of_resource(fleet, command)
    if isinstance(command, RecordAccess):
        return access.record(fleet, command)
    if isinstance(command, SetAnswersWindow):
        return answers.set_window(fleet, command)
    return _of_scene(fleet, command)


def _of_order(fleet: Fleet, command: OrderCommand) -> Decision:
    match command:
        case CreateOrder():
            return orders.create(fleet, command)
        case AddSteps():
            return steps.add(fleet, command)
        case ChangeSteps():
            return steps.change(fleet, command)
        case DeleteSteps():
            return steps.delete(fleet, command)
        case SealOrder():
            return orders.seal(fleet, command)
        case SealOrders():
            return orders.seal_each(fleet, command)
        case CancelOrder():
            return orders.cancel(fleet, command)
        case CancelOrders():
            return orders.cancel_each(fleet, command)
        case CancelAllOrders():
            return orders.cancel_all(fleet, command)
        case PrioritiseOrders():
            return orders.prioritise(fleet, command)
        case RetryOrders():
            return orders.retry(fleet, command)
        case SuspendOrders():
            return order_suspension.suspend(fleet, command)
        case _:
            assert_never(command)


def _of_robot(fleet: Fleet, command: RobotCommand) -> Decision:
    match command:
        case CreateRobots():
            return robots.create(fleet, command)
        case CreateRobotSeries():
            return robots.create_series(fleet, command)
        case RemoveRobots():
            return robots.remove(fleet, command)
        case ReconfigureRobot():
            return robot_config.reconfigure(fleet, command)
        case ReconfigureRobots():
            return robot_config.reconfigure_each(fleet, command)
        case DisableRobots():
            return robot_duty.disable(fleet, command)
        case SendRobotsOffDuty():
            return robot_duty.send_off_duty(fleet, command)
        case ClearRobotBins():
            return robot_duty.clear_bins(fleet, command)
        case SoftStopRobots():
            return instructions.soft_stop(fleet, command)
        case PauseRobots():
            return instructions.pause(fleet, command)
        case ControlRobots():
            return instructions.control(fleet, command)
        case ClearRobotAlarms():
            return instructions.clear_alarms(fleet, command)
        case ReconnectRobots():
            return instructions.reconnect(fleet, command)
        case CancelNavigation():
            return instructions.cancel_navigation(fleet, command)
        case RecoverRobots():
            return recovery.recover(fleet, command)
        case _:
            assert_never(command)


def _of_device(fleet: Fleet, command: DeviceCommand) -> Decision:
    match command:
        case OpenDoors():
            return devices.open_doors(fleet, command)
        case CloseDoors():
            return devices.close_doors(fleet, command)
        case KeepDoorsOpen():
            return devices.keep_doors_open(fleet, command)
        case KeepLiftOpen():
            return devices.keep_lift_open(fleet, command)
        case LetLiftGo():
            return devices.let_lift_go(fleet, command)
        case _:
            assert_never(command)


def _of_resource(fleet: Fleet, command: ResourceCommand) -> Decision:
    match command:
        case RequestMapResources():
            return resources.request(fleet, command)
        case LapseMapResources():
            return resources.lapse(fleet, command)
        case ReleaseMapResources():
            return resources.release(fleet, command)
        case ReleaseOwnedMapResources():
            return resources.release_owned(fleet, command)
        case ReleaseAllMapResources():
            return resources.release_all(fleet, command)
        case _:
            assert_never(command)


def _of_scene(fleet: Fleet, command: SceneCommand) -> Decision:
    match command:
        case ImportScene():
            return scenes.import_scene(fleet, command)
        case CreateScene():
            return scene_life.create(fleet, command)
        case RenameScene():
            return scene_life.rename(fleet, command)
        case DisableScene():
            return scene_life.disable(fleet, command)
        case PauseDispatch():
            return scene_life.pause_dispatch(fleet, command)
        case RemoveScenes():
            return scene_life.remove(fleet, command)
        case ConfigureScene():
            return scene_config.configure(fleet, command)
        case ConfigureCallbacks():
            return callbacks.configure(fleet, command)
        case GiveUpCallback():
            return callbacks.give_up(fleet, command)
        case _:
            assert_never(command)


def decide_proposal(fleet: Fleet, proposal: AnyProposal, at_ms: int) -> Events:
    """Decide a proposal of the scheduler; raises Rejected where the state has moved on."""
    match proposal:
        case AssignOrder():
            return assignment.assign(fleet, proposal)
        case WithdrawOrder():
            return assignment.withdraw(fleet, proposal)
        case RejectAssignment():
            return assignment.reject_assignment(fleet, proposal)
        case RejectExecution():
            return assignment.reject_execution(fleet, proposal)
        case StartStep():
            return execution.start_step(fleet, proposal)
        case FinishStep():
            return execution.finish_step(fleet, proposal)
        case FaultOrder():
            return execution.fault(fleet, proposal)
        case CreateSystemOrder():
            return assignment.create_system_order(fleet, proposal, at_ms)
        case ConnectRobot():
            return execution.connect(fleet, proposal)
        case DisconnectRobot():
            return execution.disconnect(fleet, proposal)
        case GiveUpRobot():
            return execution.give_up(fleet, proposal)
        case StopRobot():
            return execution.stop(fleet, proposal)
        case LiftStop():
            return execution.lift(fleet, proposal)
        case GrantMapResources():
            return resources.grant(fleet, proposal, at_ms)
        case FaultDevice():
            return devices.fault(fleet, proposal)
        case RecoverDevice():
            return devices.recover(fleet, proposal)
        case NoteWaits():
            return waits.note(fleet, proposal)
        case _:
            assert_never(proposal)
