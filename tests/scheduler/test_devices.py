"""Faults of devices as news for the ledger, and lifts that are kept open."""

from ledger.evolve_resources import device_key
from ledger.ids import PointName, SceneId
from ledger.link import DoorReport, DoorStatus, LiftReport, TellLift
from ledger.proposals import DOES_NOT_ANSWER, FaultDevice, RecoverDevice
from ledger.scene import Door, Group, Lift, LiftFloor, Scene
from ledger.state import DeviceFault, DeviceKind, Fleet
from scheduler.devices import SILENT_MS, SiteDevices
from scheduler.doors import TELL_MS

SCENE = SceneId("S")
START_MS = 1_000_000
ALL = frozenset({1, 2})
HOUSE = Scene(
    id=SCENE,
    name="s",
    digest="",
    areas=(),
    groups=(Group(id=0, name="g"),),
    doors=(
        Door(id=1, name="gate", area=1, points=(PointName("A"),)),
        Door(id=2, name="shut", area=1, points=(PointName("B"),), disabled=True),
    ),
    lifts=(
        Lift(
            id=1,
            name="lift",
            floors=(LiftFloor(name="G", area=1), LiftFloor(name="1", area=2)),
        ),
    ),
)


def door(at_ms: int, fault: str | None = None) -> DoorReport:
    return DoorReport(scene=SCENE, door=1, at_ms=at_ms, status=DoorStatus.CLOSED, fault=fault)


def lift(at_ms: int) -> LiftReport:
    return LiftReport(scene=SCENE, lift=1, at_ms=at_ms, floor="G")


def heard(site: SiteDevices, at_ms: int, *reports: DoorReport | LiftReport) -> SiteDevices:
    for report in reports:
        site.hear(report)
    site.take_in(HOUSE, at_ms)
    return site


def faulted(reason: str) -> Fleet:
    key = device_key(SCENE, DeviceKind.DOOR, 1)
    fault = DeviceFault(scene=SCENE, kind=DeviceKind.DOOR, device=1, reason=reason, at_ms=0)
    return Fleet(device_faults={key: fault})


def test_a_fault_is_said_until_the_ledger_has_it_and_so_is_its_end() -> None:
    site = heard(SiteDevices(START_MS), START_MS + 1, door(1, "jammed"), lift(1))
    jammed = FaultDevice(scene=SCENE, kind=DeviceKind.DOOR, device=1, reason="jammed")
    assert site.news(Fleet(), HOUSE, START_MS + 1) == [jammed]
    assert site.news(faulted("jammed"), HOUSE, START_MS + 1) == []
    assert site.news(faulted("other"), HOUSE, START_MS + 1) == [jammed]
    heard(site, START_MS + 2, door(2))
    mended = RecoverDevice(scene=SCENE, kind=DeviceKind.DOOR, device=1)
    assert site.news(faulted("jammed"), HOUSE, START_MS + 2) == [mended]
    assert site.news(Fleet(), HOUSE, START_MS + 2) == []


def test_a_device_in_service_that_is_not_heard_does_not_answer() -> None:
    site = SiteDevices(START_MS)
    assert site.news(Fleet(), HOUSE, START_MS + SILENT_MS) == []
    silent = site.news(Fleet(), HOUSE, START_MS + SILENT_MS + 1)
    assert {(p.kind, p.device, p.reason) for p in silent if isinstance(p, FaultDevice)} == {
        (DeviceKind.DOOR, 1, DOES_NOT_ANSWER),
        (DeviceKind.LIFT, 1, DOES_NOT_ANSWER),
    }
    assert not site.doors(HOUSE, START_MS + SILENT_MS + 1)[1].works


def test_what_the_ledger_knows_is_not_taken_back_unheard() -> None:
    assert SiteDevices(START_MS).news(faulted("jammed"), HOUSE, START_MS + 1) == []


def test_a_device_that_is_gone_has_no_fault() -> None:
    site = SiteDevices(START_MS)
    empty = Scene(id=SCENE, name="s", digest="", areas=(), groups=())
    mended = RecoverDevice(scene=SCENE, kind=DeviceKind.DOOR, device=1)
    assert site.news(faulted("jammed"), empty, START_MS + 1) == [mended]


def test_a_lift_is_told_its_floor_every_second_and_once_that_it_may_go() -> None:
    site = SiteDevices(START_MS)
    held = Scene(
        id=SCENE, name="s", digest="", areas=(), groups=(), lifts=HOUSE.lifts, held_lifts={1: 2}
    )
    assert site.tell(held, {}, ALL, START_MS) == [TellLift(lift=1, floor="1")]
    assert site.tell(held, {}, ALL, START_MS + TELL_MS - 1) == []
    assert site.tell(held, {}, ALL, START_MS + TELL_MS) == [TellLift(lift=1, floor="1")]
    assert site.tell(HOUSE, {}, ALL, START_MS + TELL_MS + 1) == [TellLift(lift=1, floor=None)]
    assert site.tell(HOUSE, {}, ALL, START_MS + TELL_MS + 2) == []
