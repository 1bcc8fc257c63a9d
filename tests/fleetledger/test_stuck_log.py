from structlog.testing import capture_logs

from fleetledger.stuck_log import StuckLog
from ledger.ids import RobotName, SceneId
from ledger.link import Alarm, AlarmLevel, Plan


def plan(text: str | None, code: str = "TrafficStuck") -> Plan:
    alarm = None
    if text is not None:
        alarm = Alarm(level=AlarmLevel.ERROR, code=code, message=text)
    scene = SceneId("0123456789abcdef01234567")
    return Plan(scene=scene, robot=RobotName("R1"), at_ms=0, ready=True, alarm=alarm)


def test_each_change_is_told_once():
    stuck = StuckLog()
    with capture_logs() as told:
        for text in (None, "no way", "no way", "R2 in the way", None, None):
            stuck.look([plan(text)])
    assert [(entry["log_level"], entry.get("reason")) for entry in told] == [
        ("warning", "no way"),
        ("warning", "R2 in the way"),
        ("info", None),
    ]


def test_who_is_held_by_the_guard_is_not_stuck():
    with capture_logs() as told:
        StuckLog().look([plan("BodiesOverlap: R1 and R2", code="BodiesOverlap")])
    assert told == []
