"""A small model of the core: it decides proposals by the status rules alone."""

from collections.abc import Sequence

from ledger.events import (
    AnyEvent,
    AssignmentRejected,
    ExecutionRejected,
    MapResourcesGranted,
    OrderAssigned,
    OrderCancelled,
    OrderCreated,
    OrderFaulted,
    OrderFinished,
    OrderWithdrawn,
    RobotConnected,
    RobotDisconnected,
    RobotGivenUp,
    StepFinished,
    StepStarted,
    stamped,
)
from ledger.evolve import evolve
from ledger.ids import CommandId, OrderId, robot_key
from ledger.proposals import (
    AnyProposal,
    AssignOrder,
    ConnectRobot,
    CreateSystemOrder,
    DisconnectRobot,
    FaultOrder,
    FinishStep,
    GiveUpRobot,
    GrantMapResources,
    RejectAssignment,
    RejectExecution,
    StartStep,
    WithdrawOrder,
)
from ledger.state import BinStatus, Fleet, OrderKind, OrderStatus, StepStatus, StepTask


class Refused(AssertionError):
    """The proposal breaks a rule."""


def check(holds: bool, what: object) -> None:
    if not holds:
        raise Refused(what)


class SmallCore:
    """Holds the decided fleet; `lenient` counts what it refuses, else a refusal fails the test."""

    def __init__(self, *, lenient: bool = False) -> None:
        self.fleet = Fleet()
        self.now_ms = 0
        self.lenient = lenient
        self.refused: list[AnyProposal] = []
        self.proposed: list[AnyProposal] = []
        self.events: list[AnyEvent] = []
        self._unseen: list[AnyEvent] = []

    def happen(self, *events: AnyEvent) -> None:
        """State events that somebody else caused; the scheduler gets them with its next answer."""
        for event in events:
            event = stamped(event, self.fleet.position + 1, self.now_ms, "test", CommandId("c"))
            evolve(self.fleet, event)
            self.events.append(event)
            self._unseen.append(event)

    def unseen(self) -> list[AnyEvent]:
        found, self._unseen = self._unseen, []
        return found

    def propose(self, proposals: Sequence[AnyProposal]) -> list[AnyEvent]:
        for proposal in proposals:
            self.proposed.append(proposal)
            try:
                self.happen(*self.decide(proposal))
            except Refused:
                if not self.lenient:
                    raise
                self.refused.append(proposal)
        return self.unseen()

    def decide(self, p: AnyProposal) -> tuple[AnyEvent, ...]:
        if isinstance(p, ConnectRobot | DisconnectRobot):
            return self._connection(p)
        if isinstance(p, CreateSystemOrder):
            return self._system_order(p)
        if isinstance(p, GrantMapResources):
            for unit in p.units:
                check(unit in self.fleet.claims and not self.fleet.claims[unit].granted, p)
            return (MapResourcesGranted(scene=p.scene, units=p.units),)
        if isinstance(p, GiveUpRobot):
            robot = self.fleet.robots[robot_key(p.scene, p.robot)]
            check(not robot.online and not robot.given_up, p)
            return (RobotGivenUp(scene=p.scene, robot=p.robot),)
        check(p.order in self.fleet.orders, p)
        order = self.fleet.orders[p.order]
        header = {"scene": p.scene, "order": p.order}
        if isinstance(p, AssignOrder):
            return self._assigned(p)
        if isinstance(p, WithdrawOrder):
            check(order.robot is not None and order.bin is not None, p)
            robot = self.fleet.robots[robot_key(p.scene, order.robot)]
            check(robot.bins[order.bin].status is not BinStatus.FILLED, p)
            if order.kind is not OrderKind.BUSINESS:
                return (OrderCancelled(**header),)
            return (OrderWithdrawn(**header, robot=order.robot, reason=p.reason),)
        if isinstance(p, RejectAssignment):
            check(order.status is OrderStatus.TO_BE_ALLOCATED, p)
            return (AssignmentRejected(**header, code=p.code, robots=p.robots),)
        if isinstance(p, RejectExecution):
            check(order.robot is not None, p)
            check(bool(p.code) or order.execution_reject is not None, p)
            return (ExecutionRejected(**header, code=p.code, robots=p.robots),)
        check(order.fault_reason is None, p)
        if isinstance(p, FaultOrder):
            return (OrderFaulted(**header, reason=p.reason),)
        check(order.robot == p.robot, p)
        if isinstance(p, StartStep):
            check(order.steps[p.step].status is StepStatus.EXECUTABLE, p)
            done = (s.status is StepStatus.DONE for s in order.steps[: p.step])
            check(all(done), p)
            self._one_step_at_a_time(p)
            return (StepStarted(**header, step=p.step, robot=p.robot),)
        assert isinstance(p, FinishStep)
        check(order.steps[p.step].status is StepStatus.EXECUTING, p)
        finished = StepFinished(**header, step=p.step, robot=p.robot)
        left = [s for n, s in enumerate(order.steps) if n != p.step]
        if order.sealed and all(s.status is StepStatus.DONE for s in left):
            return finished, OrderFinished(**header)
        return (finished,)

    def _connection(self, p: ConnectRobot | DisconnectRobot) -> tuple[AnyEvent, ...]:
        robot = self.fleet.robots[robot_key(p.scene, p.robot)]
        check(robot.online is isinstance(p, DisconnectRobot), p)
        event = RobotConnected if isinstance(p, ConnectRobot) else RobotDisconnected
        return (event(scene=p.scene, robot=p.robot),)

    def _assigned(self, p: AssignOrder) -> tuple[AnyEvent, ...]:
        order = self.fleet.orders[p.order]
        robot = self.fleet.robots[robot_key(p.scene, p.robot)]
        check(order.status is OrderStatus.TO_BE_ALLOCATED and order.fault_reason is None, p)
        check(not order.suspended and not self.fleet.scenes[p.scene].dispatch_paused, p)
        check(robot.online and not robot.config.disabled and not robot.off_duty, p)
        system = [o for o in robot.orders if self.fleet.orders[o].kind is not OrderKind.BUSINESS]
        content = robot.bins[p.bin]
        check(content.status is BinStatus.EMPTY or content.order in system, p)
        if order.wanted_robots or order.wanted_groups:
            check(robot.name in order.wanted_robots or bool(order.wanted_groups), p)
        assigned = OrderAssigned(
            scene=p.scene,
            order=p.order,
            robot=p.robot,
            bin=p.bin,
            cost_s=p.cost_s,
            candidates=p.candidates,
        )
        return (*(OrderCancelled(scene=p.scene, order=o) for o in system), assigned)

    def _system_order(self, p: CreateSystemOrder) -> tuple[AnyEvent, ...]:
        robot = self.fleet.robots[robot_key(p.scene, p.robot)]
        check(robot.online and not robot.config.disabled and not robot.orders, p)
        bins = [n for n, b in enumerate(robot.bins) if b.status is BinStatus.EMPTY]
        check(bool(bins), p)
        id_ = OrderId(f"TO20260101-{sum(self.fleet.order_counts.values()):06}{p.kind[0]}")
        task = StepTask(location=p.location, arguments=p.arguments)
        return (
            OrderCreated(scene=p.scene, order=id_, kind=p.kind, sealed=True, tasks=(task,)),
            OrderAssigned(scene=p.scene, order=id_, robot=p.robot, bin=bins[0], cost_s=p.cost_s),
        )

    def _one_step_at_a_time(self, p: StartStep) -> None:
        robot = self.fleet.robots[robot_key(p.scene, p.robot)]
        for id_ in robot.orders:
            running = [s for s in self.fleet.orders[id_].steps if s.status is StepStatus.EXECUTING]
            check(not running, p)
