from collections.abc import Callable

import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from commands.command import Decision
from commands.decide import AnyCommand, decide
from commands.instructions import (
    NAVIGATION_CANCELLED,
    CancelNavigation,
    ClearRobotAlarms,
    ControlRobots,
    PauseRobots,
    ReconnectRobots,
    SoftStopRobots,
)
from commands.recovery import RecoverRobots
from commands.rejected import Reason
from ledger.events import (
    AnyEvent,
    OrderFaulted,
    OrderRetried,
    RobotAlarmsCleared,
    RobotControlReleased,
    RobotControlTaken,
    RobotDisabled,
    RobotDisconnected,
    RobotGivenUp,
    RobotPaused,
    RobotReconnectAsked,
    RobotResumed,
    RobotSoftStopLifted,
    RobotSoftStopped,
)
from ledger.ids import RobotName, robot_key
from ledger.link import InstructionKind
from ledger.state import Fleet
from tests.commands.site import (
    ORDER,
    R1,
    R2,
    SCENE,
    SECOND,
    assigned,
    created,
    finished,
    opened,
    started,
    task,
)
from tests.scenario import ask, given, happened

R9 = RobotName("R9")
Asks = Callable[..., AnyCommand]


def asks(kind: type, **fields: bool) -> Asks:
    return lambda *robots: ask(kind, scene=SCENE, robots=robots, **fields)


TOLD: list[tuple[Asks, type, InstructionKind, bool]] = [
    (asks(SoftStopRobots, stopped=True), RobotSoftStopped, InstructionKind.SOFT_STOP, True),
    (asks(SoftStopRobots, stopped=False), RobotSoftStopLifted, InstructionKind.SOFT_STOP, False),
    (asks(PauseRobots, paused=True), RobotPaused, InstructionKind.PAUSE, True),
    (asks(PauseRobots, paused=False), RobotResumed, InstructionKind.PAUSE, False),
    (asks(ControlRobots, taken=True), RobotControlTaken, InstructionKind.CONTROL, True),
    (asks(ControlRobots, taken=False), RobotControlReleased, InstructionKind.CONTROL, False),
    (asks(ClearRobotAlarms), RobotAlarmsCleared, InstructionKind.CLEAR_ALARMS, True),
]
told = pytest.mark.parametrize(
    ("asked", "event", "kind", "on"), TOLD, ids=[event.__name__ for _, event, _, _ in TOLD]
)


@told
def test_a_robot_that_answers_is_told(
    asked: Asks, event: type, kind: InstructionKind, on: bool
) -> None:
    fleet = given(*opened(R1)).when(asked(R1)).then(event(scene=SCENE, robot=R1))
    (instruction,) = fleet.robots[robot_key(SCENE, R1)].instructions
    assert (instruction.kind, instruction.on, instruction.number) == (kind, on, fleet.position)
    assert not instruction.gently


@told
def test_it_is_told_again_for_only_the_robot_knows_what_it_is(
    asked: Asks, event: type, kind: InstructionKind, on: bool
) -> None:
    again = event(scene=SCENE, robot=R1)
    fleet = given(*opened(R1), again).when(asked(R1)).then(again)
    (instruction,) = fleet.robots[robot_key(SCENE, R1)].instructions
    assert instruction.number == fleet.position


@told
def test_who_cannot_hear_it_is_refused_and_stops_no_other(
    asked: Asks, event: type, kind: InstructionKind, on: bool
) -> None:
    r3 = RobotName("R3")
    past = (
        *opened(R1, R2, r3),
        RobotDisconnected(scene=SCENE, robot=R2),
        RobotDisabled(scene=SCENE, robot=r3),
    )
    outcome = given(*past).when(asked(R9, R2, r3, R1, R1))
    away = Reason.ROBOT_NOT_AVAILABLE
    outcome.refused(R9=Reason.ROBOT_UNKNOWN, R2=away, R3=away)
    outcome.then(event(scene=SCENE, robot=R1))
    assert "does not answer" in outcome.decision.refused[R2].message
    assert "disabled" in outcome.decision.refused[r3].message


def test_the_newest_of_each_kind_counts() -> None:
    fleet = happened(opened(R1))
    for asked, *_ in TOLD:
        happened(decide(fleet, asked(R1)).events, fleet)
    instructions = fleet.robots[robot_key(SCENE, R1)].instructions
    numbers = [i.number for i in instructions]
    assert [(i.kind, i.on) for i in instructions] == [
        (InstructionKind.SOFT_STOP, False),
        (InstructionKind.PAUSE, False),
        (InstructionKind.CONTROL, False),
        (InstructionKind.CLEAR_ALARMS, True),
    ]
    assert numbers == sorted(numbers)


def test_only_robots_that_are_away_are_reached_for() -> None:
    reconnect = asks(ReconnectRobots)
    away = RobotDisconnected(scene=SCENE, robot=R2)
    asked = RobotReconnectAsked(scene=SCENE, robot=R2)
    past = (*opened(R1, R2), away, RobotGivenUp(scene=SCENE, robot=R2))
    outcome = given(*past).when(reconnect(R1, R2, R9)).refused(R9=Reason.ROBOT_UNKNOWN)
    fleet = outcome.then(asked)
    assert not fleet.robots[robot_key(SCENE, R2)].given_up
    given(*past).when(reconnect()).nothing()
    off = RobotDisabled(scene=SCENE, robot=R2)
    given(*past, off).when(reconnect(R2)).refused(R2=Reason.ROBOT_NOT_AVAILABLE).nothing()


def faulted(order: str = ORDER) -> OrderFaulted:
    return OrderFaulted(scene=SCENE, order=order, reason=NAVIGATION_CANCELLED)


def test_the_order_that_a_robot_is_at_stops_and_a_retry_goes_on() -> None:
    cancel = asks(CancelNavigation)
    past = (
        *opened(R1, R2, bins=2),
        created(ORDER, task()),
        created(SECOND, task()),
        assigned(),
        assigned(SECOND, bin=1),
    )
    given(*past).when(cancel(R1, R2)).then(faulted())  # R2 has no order
    story = (*past, started(order=SECOND))
    given(*story).when(cancel(R1)).then(faulted(SECOND))
    given(*story, faulted(SECOND)).when(cancel(R1)).nothing()
    away = RobotDisconnected(scene=SCENE, robot=R1)
    given(*story, away).when(cancel(R1, R9)).refused(R9=Reason.ROBOT_UNKNOWN).then(faulted(SECOND))
    off = RobotDisabled(scene=SCENE, robot=R1)
    given(*story, off).when(cancel(R1)).refused(R1=Reason.ROBOT_NOT_AVAILABLE).nothing()


def test_an_order_that_waits_for_more_steps_is_not_driven_for() -> None:
    past = (*opened(R1), created(ORDER, task(), sealed=False), assigned(), started(), finished())
    given(*past).when(asks(CancelNavigation)(R1)).nothing()


KINDS = [asked for asked, *_ in TOLD] + [
    asks(ReconnectRobots),
    asks(CancelNavigation),
    asks(RecoverRobots),
]
things: list[AnyEvent] = [
    RobotDisconnected(scene=SCENE, robot=R1),
    RobotDisabled(scene=SCENE, robot=R2),
    RobotGivenUp(scene=SCENE, robot=R1),
    created(ORDER, task()),
]


@settings(max_examples=120, deadline=None)
@drawn(
    st.sampled_from(KINDS),
    st.lists(st.sampled_from((R1, R2, R9)), max_size=5),
    st.sets(st.integers(0, len(things) - 1)),
    st.booleans(),
)
def test_a_batch_is_the_sum_of_its_robots(
    asked: Asks, robots: list[RobotName], past: set[int], carried: bool
) -> None:
    fleet = happened((*opened(R1, R2), *(things[n] for n in sorted(past))))
    if carried and ORDER in fleet.orders:
        happened((assigned(), started(), faulted()), fleet)
    decision = decide(fleet, asked(*robots))
    each = [decide(fleet, asked(robot)) for robot in dict.fromkeys(robots)]
    assert decision.events == sum((one.events for one in each), ())
    assert {k: no.code for k, no in decision.refused.items()} == {
        k: no.code for one in each for k, no in one.refused.items()
    }
    _check_nothing_else_changes(fleet, decision)


def _check_nothing_else_changes(fleet: Fleet, decision: Decision) -> None:
    """Bins, orders at hand, duty and set-up are not touched by any instruction."""
    before = _other_things(fleet)
    happened(decision.events, fleet)
    assert _other_things(fleet) == before
    for event in decision.events:
        assert not isinstance(event, OrderRetried) or fleet.orders[event.order].fault_reason is None


def _other_things(fleet: Fleet) -> dict[str, object]:
    return {
        key: (robot.bins, robot.orders, robot.config, robot.off_duty, robot.online)
        for key, robot in fleet.robots.items()
    }
