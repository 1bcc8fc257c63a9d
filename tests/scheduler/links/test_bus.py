"""The link over the bus."""

import msgspec

from ledger.bus import MemoryBus, alive_key, report_key, tell_key
from ledger.ids import RobotName
from ledger.link import Act, Cancel, Drive, Mark, Report, TellRoute, ToRobot
from scheduler.links.bus import BusLink
from tests.scheduler.small_site import SCENE

NAME = RobotName("A")


def a_report(robot: str = "A") -> Report:
    return Report(
        scene=SCENE,
        robot=RobotName(robot),
        number=1,
        at_ms=0,
        area=1,
        x_m=0.0,
        y_m=0.0,
        heading_rad=0.0,
    )


def test_robots_are_told_under_their_own_key_and_can_tell_messages_apart() -> None:
    bus = MemoryBus()
    heard: list[object] = []
    bus.subscribe(
        tell_key(SCENE, NAME),
        lambda _, payload: heard.append(msgspec.json.decode(payload, type=ToRobot)),  # type: ignore[arg-type]
    )
    messages: list[ToRobot] = [
        Drive(robot=NAME, session="s", authority=Mark(piece=1, along_m=0.5)),
        Act(robot=NAME, id="1", name="Load"),
        Cancel(robot=NAME, id="1"),
        TellRoute(robot=NAME),
    ]
    for message in messages:
        BusLink(bus).tell(SCENE, message)
    assert heard == messages


def test_reports_and_tokens_come_through_and_nonsense_is_named() -> None:
    bus = MemoryBus()
    heard: list[object] = []
    link = BusLink(bus)
    link.hear(heard.append, lambda *token: heard.append(token), lambda k, w: heard.append((k, w)))
    bus.publish(report_key(SCENE, NAME), msgspec.json.encode(a_report()))
    let_go = bus.live(alive_key(SCENE, NAME))
    let_go()
    assert heard == [a_report(), (SCENE, "A", True), (SCENE, "A", False)]
    heard.clear()
    bus.publish(report_key(SCENE, NAME), b"{}")
    bus.publish(report_key(SCENE, NAME), msgspec.json.encode(a_report("B")))
    bus.publish(report_key(SCENE, NAME), b"\xff")
    assert [key for key, _ in heard] == [report_key(SCENE, NAME)] * 3  # type: ignore[misc]


def test_what_no_robot_can_mean_is_nonsense() -> None:
    bus = MemoryBus()
    heard: list[object] = []
    BusLink(bus).hear(heard.append, lambda *token: None, lambda key, why: heard.append(why))
    for strange in ({"heading_rad": 1e308}, {"x_m": -1e9}, {"speed_mps": 1e12}):
        report = msgspec.structs.replace(a_report(), **strange)
        bus.publish(report_key(SCENE, NAME), msgspec.json.encode(report))
    assert [str(why).split()[0] for why in heard] == ["heading_rad", "x_m", "speed_mps"]
