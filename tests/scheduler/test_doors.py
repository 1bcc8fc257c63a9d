"""Which doors are told to be open, and when robots may enter."""

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import DoorReport, DoorState, DoorStatus, TellDoor
from ledger.scene import Door, Group, Scene
from scheduler.doors import FRESH_MS, OPENED_ONCE_MS, TELL_MS, DoorDesk
from scheduler.traffic.doors import DoorNow

SCENE, R1 = SceneId("S"), RobotName("R1")
DOOR = Door(id=1, name="gate", area=1, points=(PointName("A"),))
ALL = frozenset({1})
START_MS = 1_000_000


def scene(**fields: object) -> Scene:
    fields = {"doors": (DOOR,), **fields}
    return Scene(id=SCENE, name="s", digest="", areas=(), groups=(Group(id=0, name="g"),), **fields)  # type: ignore[arg-type]


def said(
    status: DoorStatus, obeyed: int = 0, at_ms: int = START_MS, **fields: object
) -> DoorReport:
    return DoorReport(
        scene=SCENE,
        door=1,
        at_ms=at_ms,
        status=status,
        obeyed=obeyed,
        **fields,  # type: ignore[arg-type]
    )


def now(desk: DoorDesk, at_ms: int = START_MS, fault: str | None = None) -> DoorNow:
    return desk.now(scene(), {} if fault is None else {1: fault}, at_ms)[1]


def want(
    desk: DoorDesk, at_ms: int = START_MS, *robots: RobotName, **fields: object
) -> TellDoor | None:
    wanted = {1: tuple(robots)} if robots else {}
    told = desk.want(scene(**fields), wanted, ALL, at_ms)
    return told[0] if told else None


def test_robots_enter_only_a_door_that_is_open_for_them() -> None:
    desk = DoorDesk()
    assert now(desk) == DoorNow()
    desk.hear(said(DoorStatus.OPENED), START_MS)
    assert now(desk) == DoorNow(leave=True), "it may be about to close"
    told = want(desk, START_MS, R1)
    assert told is not None
    assert (told.open, told.robots) == (True, (R1,))
    assert not now(desk).enter, "it has not answered"
    desk.hear(said(DoorStatus.OPENED, obeyed=told.number), START_MS)
    assert now(desk) == DoorNow(enter=True, leave=True)
    assert now(desk, START_MS + FRESH_MS).enter
    assert now(desk, START_MS + FRESH_MS + 1) == DoorNow(), "it has not been heard of late"


def test_a_number_counts_as_long_as_the_door_is_wanted_without_a_break() -> None:
    desk = DoorDesk()
    first = want(desk, START_MS, R1)
    assert first is not None
    assert want(desk, START_MS + TELL_MS - 1, R1) is None
    again = want(desk, START_MS + TELL_MS, R1)
    assert again == first, "told every second"
    assert want(desk, START_MS + TELL_MS + 1) is None, "it closes by itself"
    desk.hear(said(DoorStatus.OPENED, obeyed=first.number), START_MS)
    third = want(desk, START_MS + TELL_MS + 2, R1)
    assert third is not None
    assert third.number > first.number
    assert not now(desk).enter


def test_a_door_that_does_not_work_is_not_entered_but_left() -> None:
    desk = DoorDesk()
    told = want(desk, START_MS, R1)
    assert told is not None
    desk.hear(said(DoorStatus.OPENED, obeyed=told.number), START_MS)
    assert now(desk, START_MS, fault="jammed") == DoorNow(leave=True, works=False)
    desk.hear(said(DoorStatus.OPENED, told.number, START_MS + 1, fault="jammed"), START_MS)
    assert now(desk) == DoorNow(leave=True)


def test_people_have_doors_open_once_or_for_good() -> None:
    desk = DoorDesk()
    opened = {1: START_MS}
    told = want(desk, START_MS + 1, opened_doors=opened)
    assert told is not None
    assert (told.open, told.robots) == (True, ())
    assert want(desk, START_MS + OPENED_ONCE_MS, opened_doors=opened) is None
    assert desk.states() == []
    assert want(desk, START_MS + 60_000, held_doors=(1,)) is not None
    assert desk.states() == [DoorState(door=1)]


def test_closing_is_told_once_and_not_while_a_robot_passes() -> None:
    desk = DoorDesk()
    desk.close(1)
    told = want(desk, START_MS, R1)
    assert told is not None and told.open
    assert want(desk, START_MS + 100) is None, "the robot was later than the one who asked"
    desk.close(1)
    closing = want(desk, START_MS + 200)
    assert closing == TellDoor(door=1, open=False)
    assert want(desk, START_MS + 300) is None


def test_after_a_start_an_open_door_stays_open_until_robots_are_placed() -> None:
    desk = DoorDesk()
    desk.hear(said(DoorStatus.OPENED), START_MS)
    (told,) = desk.want(scene(), {}, frozenset(), START_MS)
    assert told.open
    assert desk.want(scene(), {}, ALL, START_MS + TELL_MS) == []
    closed = DoorDesk()
    closed.hear(said(DoorStatus.CLOSED), START_MS)
    assert closed.want(scene(), {}, frozenset(), START_MS) == []


def test_an_old_report_is_dropped() -> None:
    desk = DoorDesk()
    desk.hear(said(DoorStatus.CLOSED, at_ms=START_MS + 1), START_MS)
    desk.hear(said(DoorStatus.OPENED), START_MS)
    assert not now(desk).leave
