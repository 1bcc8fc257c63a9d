"""From what is asked to what happens: these two only route."""

from typing import TypeAlias, assert_never

from commands import assignment, execution, orders, robots, scenes, steps
from commands.command import Decision, Events
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
from commands.robots import (
    ClearRobotBins,
    CreateRobots,
    CreateRobotSeries,
    DisableRobots,
    RemoveRobots,
    SendRobotsOffDuty,
)
from commands.scenes import ConfigureScene, ImportScene
from commands.steps import AddSteps, ChangeSteps, DeleteSteps
from ledger.proposals import (
    AnyProposal,
    AssignOrder,
    ConnectRobot,
    CreateSystemOrder,
    DisconnectRobot,
    FaultOrder,
    FinishStep,
    RejectAssignment,
    RejectExecution,
    StartStep,
    WithdrawOrder,
)
from ledger.state import Fleet

AnyCommand: TypeAlias = (
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
    | CreateRobots
    | CreateRobotSeries
    | RemoveRobots
    | DisableRobots
    | SendRobotsOffDuty
    | ClearRobotBins
    | ImportScene
    | ConfigureScene
)


def decide(fleet: Fleet, command: AnyCommand) -> Decision:
    """Decide a client's command; raises Rejected where nothing of it can be done."""
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
        case CreateRobots():
            return robots.create(fleet, command)
        case CreateRobotSeries():
            return robots.create_series(fleet, command)
        case RemoveRobots():
            return robots.remove(fleet, command)
        case DisableRobots():
            return robots.disable(fleet, command)
        case SendRobotsOffDuty():
            return robots.send_off_duty(fleet, command)
        case ClearRobotBins():
            return robots.clear_bins(fleet, command)
        case ImportScene():
            return scenes.import_scene(fleet, command)
        case ConfigureScene():
            return scenes.configure(fleet, command)
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
        case _:
            assert_never(proposal)
