"""Laws of deciding: random commands and proposals, one after another, on whatever came before."""

from random import Random

import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from commands.decide import decide, decide_proposal
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
from commands.rejected import Rejected
from commands.robot_config import ReconfigureRobot, ReconfigureRobots, RobotConfigPatch
from commands.robot_duty import ClearRobotBins, DisableRobots, SendRobotsOffDuty
from commands.robots import CreateRobots, CreateRobotSeries, RemoveRobots
from commands.scene_config import ConfigureScene
from commands.scenes import ImportScene, scene_digest
from commands.steps import AddSteps, ChangeSteps, DeleteSteps, StepPatch
from ledger.events import AnyEvent, OrderCreated
from ledger.ids import OrderId, RobotName, SceneId, StepId
from ledger.proposals import (
    AssignOrder,
    ConnectRobot,
    CreateSystemOrder,
    DisconnectRobot,
    FaultOrder,
    FinishStep,
    GiveUpRobot,
    RejectAssignment,
    RejectExecution,
    StartStep,
    WithdrawOrder,
)
from ledger.scene import RobotConfig
from ledger.scene_config import SceneConfig
from ledger.state import BinStatus, Fleet, OrderKind, StepStatus, StepTask
from tests.commands.site import BINS, POINTS, R1, R2, SCENE, opened
from tests.scenario import STORY_MS, ask, happened
from tests.strategies import grid

ROBOTS = (R1, R2, RobotName("R3"), RobotName("R9"))
PLACES = (*POINTS, *BINS, "nowhere")
ARGUMENTS = (None, None, '{"binTask":"Load"}', '{"operation":"x"}', "[]")


def _order(random: Random, fleet: Fleet) -> OrderId:
    if fleet.orders and random.random() < 0.95:
        return random.choice(list(fleet.orders))
    return OrderId(f"TO20250806-{random.randint(0, 30):06}")


def _robot(random: Random, fleet: Fleet, order: OrderId) -> RobotName:
    """Mostly the order's own robot, so that stories get on."""
    known = fleet.orders.get(order)
    if known is not None and known.robot is not None and random.random() < 0.9:
        return known.robot
    return random.choice(ROBOTS)


def _task(random: Random) -> StepTask:
    return StepTask(
        location=random.choice(PLACES[:-1] if random.random() < 0.95 else PLACES),
        arguments=random.choice(ARGUMENTS) if random.random() < 0.2 else None,
        loads=random.random() < 0.5,
        unloads=random.random() < 0.2,
    )


def _tasks(random: Random) -> tuple[StepTask, ...]:
    return tuple(_task(random) for _ in range(random.randint(0, 3)))


def _command(random: Random, fleet: Fleet) -> object:
    order = _order(random, fleet)
    some = tuple(_order(random, fleet) for _ in range(random.randint(0, 4)))
    robots = tuple(random.choices(ROBOTS, k=random.randint(0, 3)))
    on = random.random() < 0.5
    step = random.randint(-1, 4)
    known = fleet.orders.get(order)
    ids = [s.id for s in known.steps] if known else []
    kind = random.choices(list(_MAKERS), [_LIKELY.get(kind, 1.0) for kind in _MAKERS])[0]
    fields: dict[str, object] = {
        "scene": SCENE if random.random() < 0.98 else SceneId(random.choice(("", "S"))),
        "order": order,
        "orders": some,
        "robots": robots,
        "steps": tuple(random.sample(ids, min(len(ids), 2))) or (StepId("x"),),
        "tasks": _tasks(random),
        "patches": (StepPatch(step=step, location=random.choice(PLACES), loads=on),),
        "priority": random.randint(0, 3),
        "sealed": random.random() < 0.6,
        "key_locations": (random.choice(PLACES),) if random.random() < 0.3 else (),
        "wanted_robots": (random.choice(ROBOTS),) if random.random() < 0.1 else (),
        "disabled": random.random() < 0.2,
        "patch": RobotConfigPatch(
            bin_count=random.choice((None, 1, 2, 3)), disabled=random.choice((None, False, False))
        ),
        "suspended": random.random() < 0.3,
        "stopped": on,
        "paused": on,
        "taken": on,
        "off_duty": random.random() < 0.2,
        "prefix": "AMB",
        "count": random.randint(0, 3),
        "pattern": RobotConfig(name=RobotName("")),
        "config": SceneConfig(parking_paused=on),
    }
    if kind is CreateRobots:
        fields["robots"] = tuple(RobotConfig(name=name, bin_count=2) for name in robots)
    if kind is ReconfigureRobot:
        fields["config"] = RobotConfig(
            name=random.choice(ROBOTS), group=1, bin_count=random.randint(1, 3), simulated=on
        )
    if kind is ClearRobotBins:
        fields["robots"] = ROBOTS
    if kind is ImportScene:
        file = grid(columns=random.randint(2, 4))
        fields |= {"scene": SceneId("A" * 24), "file": file, "digest": scene_digest(file)}
    return ask(kind, **{name: fields[name] for name in _MAKERS[kind]})


_MAKERS: dict[type, tuple[str, ...]] = {
    CreateOrder: ("scene", "tasks", "sealed", "key_locations", "wanted_robots", "priority"),
    AddSteps: ("order", "tasks"),
    ChangeSteps: ("order", "patches"),
    DeleteSteps: ("order", "steps"),
    SealOrder: ("order",),
    SealOrders: ("orders",),
    CancelOrder: ("scene", "order"),
    CancelOrders: ("orders",),
    CancelAllOrders: ("scene",),
    PrioritiseOrders: ("orders", "priority"),
    RetryOrders: ("orders",),
    CreateRobots: ("scene", "robots"),
    CreateRobotSeries: ("scene", "prefix", "count", "pattern"),
    RemoveRobots: ("scene", "robots"),
    DisableRobots: ("scene", "robots", "disabled"),
    SendRobotsOffDuty: ("scene", "robots", "off_duty"),
    ClearRobotBins: ("scene", "robots"),
    ReconfigureRobot: ("scene", "config"),
    ReconfigureRobots: ("scene", "robots", "patch"),
    SoftStopRobots: ("scene", "robots", "stopped"),
    PauseRobots: ("scene", "robots", "paused"),
    ControlRobots: ("scene", "robots", "taken"),
    ClearRobotAlarms: ("scene", "robots"),
    ReconnectRobots: ("scene", "robots"),
    CancelNavigation: ("scene", "robots"),
    RecoverRobots: ("scene", "robots"),
    SuspendOrders: ("orders", "suspended"),
    ImportScene: ("scene", "file", "digest"),
    ConfigureScene: ("scene", "config"),
}


# so that orders live long enough to get somewhere
_LIKELY = {
    CreateOrder: 8.0,
    AddSteps: 3.0,
    RetryOrders: 3.0,
    ClearRobotBins: 3.0,
    CancelAllOrders: 0.1,
    CreateRobots: 0.2,
    CreateRobotSeries: 0.2,
    RemoveRobots: 0.3,
    ReconfigureRobot: 0.3,
    ReconfigureRobots: 0.3,
    CancelNavigation: 0.3,
    SuspendOrders: 0.5,
    ImportScene: 0.2,
    ConfigureScene: 0.2,
}


def _proposal(random: Random, fleet: Fleet) -> object:
    order = _order(random, fleet)
    robot = _robot(random, fleet, order)
    known = fleet.orders.get(order)
    step = 0 if known is None else known.done_step + 1
    if random.random() < 0.1:
        step = random.randint(-1, 3)
    bin_ = random.choice((0, 0, 0, 1, 5, -1))
    kind = random.choice(list(OrderKind))
    place = random.choice(PLACES)
    code = random.choice(("", "Blocked"))
    makers = [
        lambda: AssignOrder(scene=SCENE, order=order, robot=robot, bin=bin_, cost_s=1.0),
        lambda: StartStep(scene=SCENE, order=order, step=step, robot=robot),
        lambda: FinishStep(scene=SCENE, order=order, step=step, robot=robot),
        lambda: WithdrawOrder(scene=SCENE, order=order, reason="r"),
        lambda: FaultOrder(scene=SCENE, order=order, reason="r"),
        lambda: RejectAssignment(scene=SCENE, order=order, code=code, robots={}),
        lambda: RejectExecution(scene=SCENE, order=order, code=code),
        lambda: CreateSystemOrder(scene=SCENE, kind=kind, robot=robot, location=place, cost_s=1.0),
        lambda: ConnectRobot(scene=SCENE, robot=robot),
        lambda: DisconnectRobot(scene=SCENE, robot=robot),
        lambda: GiveUpRobot(scene=SCENE, robot=robot),
    ]
    weights = (8, 10, 10, 1, 0.5, 1, 1, 2, 4, 0.5, 0.5)
    return random.choices(makers, weights)[0]()


def _decided(random: Random, fleet: Fleet) -> tuple[AnyEvent, ...]:
    try:
        if random.random() < 0.3:
            return decide(fleet, _command(random, fleet)).events
        return decide_proposal(fleet, _proposal(random, fleet), STORY_MS)
    except Rejected:
        return ()


def _check_invariants(fleet: Fleet) -> None:
    carried: dict[OrderId, list[tuple[str, int]]] = {}
    for key, robot in fleet.robots.items():
        for number, content in enumerate(robot.bins):
            if content.status in (BinStatus.RESERVED, BinStatus.FILLED):
                carried.setdefault(content.order, []).append((key, number))
        assert len(set(robot.orders)) == len(robot.orders)
        for order in robot.orders:
            assert fleet.orders[order].robot == robot.name
    for order in fleet.orders.values():
        assert not order.terminal
        assert not (order.sealed and not order.steps)
        if order.sealed and order.fault_reason is None:
            assert any(step.status is not StepStatus.DONE for step in order.steps)
        where = [(f"{order.scene}/{order.robot}", order.bin)] if order.robot else []
        assert carried.pop(order.id, []) == where
        executing = [step.status for step in order.steps].count(StepStatus.EXECUTING)
        assert executing <= 1
    assert not carried  # no bin is kept for an order that is gone


@settings(max_examples=60, deadline=None)
@drawn(st.integers(0, 2**32))
def test_what_is_decided_is_evolved_and_leaves_a_sound_state(seed: int) -> None:
    random = Random(seed)
    fleet = happened(opened(*ROBOTS[:3], bins=2))
    made: list[OrderId] = []
    for _ in range(80):
        before = fleet.canonical()
        events = _decided(random, fleet)
        assert fleet.canonical() == before
        happened(events, fleet)
        made += [event.order for event in events if isinstance(event, OrderCreated)]
        _check_invariants(fleet)
    assert [int(order[11:17]) for order in made] == list(range(1, len(made) + 1))


def test_random_stories_do_come_to_their_end() -> None:
    """Guard of the law above: it would hold for a decider that refuses everything."""
    names: set[str] = set()
    for seed in range(60):
        random, fleet = Random(seed), happened(opened(*ROBOTS[:3], bins=2))
        for _ in range(150):
            events = _decided(random, fleet)
            names |= {type(event).__name__ for event in events}
            happened(events, fleet)
    wanted = {"OrderFinished", "OrderWithdrawn", "RobotBinsCleared", "StepsDeleted", "OrderRetried"}
    assert wanted <= names


@pytest.mark.parametrize("kind", _MAKERS, ids=lambda kind: kind.__name__)
def test_every_command_is_routed(kind: type) -> None:
    random, fleet = Random(0), happened(opened(*ROBOTS[:3], bins=2))
    while not isinstance(command := _command(random, fleet), kind):
        pass
    try:
        decide(fleet, command)
    except Rejected as no:
        assert no.message
