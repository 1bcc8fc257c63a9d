"""What simulated robots do with instructions, and at the end of a cut link."""

import random

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import robot_key
from ledger.link import (
    DISPATCHER,
    Act,
    ActionPhase,
    Instruct,
    Instruction,
    InstructionKind,
    Reconnect,
    Report,
    TellRoute,
)
from sim.warehouses import generate
from sim.world import World
from tests.sim.fleets import SCENE, configs, drive_on, leaving, scene_of

SMALL = scene_of(generate(aisles=3, bays=3, robots=4, seed=1))
AREA = SMALL.areas[0]
NAME = configs(1)[0].name
STOP, PAUSE = InstructionKind.SOFT_STOP, InstructionKind.PAUSE
CONTROL, CLEAR = InstructionKind.CONTROL, InstructionKind.CLEAR_ALARMS


class Robot:
    """One robot in a world of its own, and what it is told."""

    def __init__(self) -> None:
        self.world = World(random.Random(1))
        assert self.world.add(SMALL, configs(1)[0], at_ms=1_000)
        self.at_ms = 2_000
        self.number = 0

    def report(self) -> Report:
        self.at_ms += 100
        return self.world.reports(self.at_ms)[0]

    def run(self, seconds: float) -> Report:
        self.world.step(seconds)
        return self.report()

    def told(self, kind: InstructionKind, number: int | None = None, **fields: bool) -> Report:
        self.number = number if number is not None else self.number + 1
        instruction = Instruction(kind=kind, number=self.number, at_ms=0, **fields)
        self.world.tell(SCENE, Instruct(robot=NAME, instructions=(instruction,)))
        return self.report()

    def drive(self) -> None:
        report = self.report()
        way = max(leaving(AREA, report), key=lambda path: path.key)
        self.world.tell(SCENE, drive_on(AREA, report, way, report.progress.piece + 1))

    def drives(self) -> Report:
        self.drive()
        for _ in range(100):
            report = self.run(0.1)
            if report.speed_mps > 0.5:
                return report
        raise AssertionError("it does not drive")


def test_a_soft_stop_brakes_harder_than_a_pause_and_both_go_on_by_themselves() -> None:
    ways_m = {}
    for kind in (STOP, PAUSE):
        robot = Robot()
        before = robot.drives()
        robot.told(kind)
        report = robot.run(5.0)
        assert (report.soft_stop, report.paused) == (kind is STOP, kind is PAUSE)
        assert report.speed_mps == 0.0
        ways_m[kind] = report.odometer_m - before.odometer_m
        assert robot.run(60.0).odometer_m == report.odometer_m
        assert report.obeyed == 1
        robot.told(kind, on=False)
        after = robot.run(60.0)
        assert after.progress == after.authority
    # v²/2a: three times the braking is a third of the way
    assert ways_m[STOP] == pytest.approx(ways_m[PAUSE] / 3, rel=0.05)


@given(st.lists(st.tuples(st.integers(1, 6), st.booleans()), max_size=12))
def test_each_number_is_obeyed_once_and_none_after_a_later_one(
    told: list[tuple[int, bool]],
) -> None:
    robot = Robot()
    newest, stopped = 0, False
    for number, on in told:
        if number > newest:
            newest, stopped = number, on
        report = robot.told(STOP, number=number, on=on)
        assert (report.obeyed, report.soft_stop) == (newest, stopped)


def test_what_is_told_again_does_not_lift_a_stop_pressed_at_the_robot() -> None:
    robot = Robot()
    robot.told(STOP, number=7, on=False)
    robot.world.press_soft_stop(SCENE, NAME)
    assert robot.told(STOP, number=7, on=False).soft_stop
    assert not robot.told(STOP, number=8, on=False).soft_stop


def test_a_soft_stop_freezes_an_action_and_a_pause_does_not() -> None:
    robot = Robot()
    robot.world.tell(SCENE, Act(robot=NAME, id="a", name="Load"))
    robot.told(STOP)
    report = robot.run(60.0)
    assert report.action is not None and report.action.phase is ActionPhase.RUNNING
    robot.told(STOP, on=False)
    robot.told(PAUSE)
    report = robot.run(10.0)
    assert report.action is not None and report.action.phase is ActionPhase.DONE


def test_a_robot_obeys_who_has_control_and_drives_on_as_far_as_it_may() -> None:
    robot = Robot()
    before = robot.drives()
    assert robot.told(CONTROL, on=False).controller == ""
    report = robot.run(60.0)
    assert report.progress == report.authority > before.progress
    robot.drive()
    robot.world.tell(SCENE, Act(robot=NAME, id="a", name="Load"))
    robot.world.tell(SCENE, TellRoute(robot=NAME))
    report = robot.run(5.0)
    assert (report.authority, report.action) == (report.progress, None)
    assert report.route == ()
    robot.told(CONTROL)
    robot.drive()
    assert robot.run(60.0).progress > report.progress


@pytest.mark.parametrize(
    ("holder", "on", "gently", "after"),
    [
        ("", True, True, DISPATCHER),
        ("Roboshop", True, True, "Roboshop"),
        ("Roboshop", True, False, DISPATCHER),
        ("Roboshop", False, False, "Roboshop"),
        (DISPATCHER, False, False, ""),
    ],
)
def test_control_is_taken_and_let_go_of(holder: str, on: bool, gently: bool, after: str) -> None:
    robot = Robot()
    robot.world.seize(SCENE, NAME, holder)
    assert robot.told(CONTROL, on=on, gently=gently).controller == after


@pytest.mark.parametrize(
    "act", [{"name": "Fail"}, {"name": "Lift", "arguments": '{"operation":"Fail"}'}]
)
def test_the_failing_operation_fails_with_an_alarm_that_can_be_cleared(
    act: dict[str, str],
) -> None:
    robot = Robot()
    for times in (1, 2):
        robot.world.tell(SCENE, Act(robot=NAME, id=f"a{times}", **act))
        robot.world.tell(SCENE, Act(robot=NAME, id=f"a{times}", **act))
        report = robot.report()
        assert report.action is not None and report.action.phase is ActionPhase.FAILED
        assert [(a.code, a.level, a.times) for a in report.alarms] == [
            ("ActionFailed", "Error", times)
        ]
        assert report.alarms[0].at_ms > 0
    assert robot.told(CLEAR).alarms == ()


def test_an_alarm_whose_cause_persists_comes_again() -> None:
    robot = Robot()
    robot.world.step(2 * 86_400)
    assert [a.code for a in robot.report().alarms] == ["BatteryEmpty"]
    assert [a.code for a in robot.told(CLEAR).alarms] == ["BatteryEmpty"]


def test_a_cut_link_carries_nothing_but_the_call_to_reconnect() -> None:
    robot = Robot()
    before = robot.drives()
    robot.world.cut(SCENE, NAME)
    key = robot_key(SCENE, NAME)
    robot.world.tell(SCENE, Instruct(robot=NAME, instructions=()))
    robot.world.tell(SCENE, Act(robot=NAME, id="a", name="Load"))
    robot.world.step(60.0)
    assert robot.world.reports(robot.at_ms + 100) == []
    assert not robot.world.is_linked(key)
    robot.world.tell(SCENE, Reconnect(robot=NAME))
    report = robot.report()
    assert report.action is None
    assert report.progress == report.authority > before.progress
    robot.world.cut(SCENE, NAME, deaf=True)
    robot.world.tell(SCENE, Reconnect(robot=NAME))
    assert not robot.world.is_linked(key)
    robot.world.mend(SCENE, NAME)
    assert robot.world.is_linked(key)


def test_what_was_obeyed_outlives_the_simulator() -> None:
    robot = Robot()
    robot.drives()
    robot.told(STOP, number=5)
    robot.told(PAUSE, number=6)
    robot.told(CONTROL, number=7, on=False)
    saved = robot.world.save()
    robot.world = World(random.Random(9))
    robot.world.load(saved)
    assert robot.world.add(SMALL, configs(1)[0], at_ms=1_000)
    report = robot.run(5.0)
    assert (report.soft_stop, report.paused, report.controller, report.obeyed) == (
        True,
        True,
        "",
        7,
    )
    assert report.speed_mps == 0.0


def test_a_memory_from_before_there_were_instructions_is_remembered() -> None:
    robot = Robot()
    world = msgspec.msgpack.decode(robot.world.save())
    for memory in world["robots"]:
        for field in ("soft_stop", "paused", "controller", "obeyed"):
            del memory[field]
    again = World(random.Random(9))
    again.load(msgspec.msgpack.encode(world))
    assert again.remembers(robot_key(SCENE, NAME))
