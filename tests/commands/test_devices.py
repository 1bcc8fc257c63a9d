import pytest

from commands.devices import (
    CloseDoors,
    KeepDoorsOpen,
    KeepLiftOpen,
    LetLiftGo,
    OpenDoors,
)
from commands.rejected import Reason
from ledger.events import (
    AnyEvent,
    DeviceFaulted,
    DeviceRecovered,
    DoorCloseAsked,
    DoorHeldOpen,
    DoorLetGo,
    DoorOpenAsked,
    LiftHeldOpen,
    LiftLetGo,
    SceneImported,
)
from ledger.ids import PointName, path_key
from ledger.proposals import FaultDevice, RecoverDevice
from ledger.scene import Door, Group, Lift, LiftFloor
from ledger.state import DeviceKind
from tests.commands.site import SCENE, area
from tests.scenario import ask, given

DOORS = (
    Door(id=1, name="north", area=1, paths=(path_key(PointName("AP110"), PointName("AP125")),)),
    Door(id=2, name="south", area=1, points=(PointName("PP1"),), disabled=True),
)
LIFTS = (Lift(id=1, name="lift", floors=(LiftFloor(name="G", area=1),)),)


def plant() -> AnyEvent:
    return SceneImported(
        scene=SCENE,
        name="site",
        digest="d" * 64,
        areas=(area(),),
        groups=(Group(id=0, name="default"),),
        doors=DOORS,
        lifts=LIFTS,
    )


def fault(kind: DeviceKind = DeviceKind.DOOR, reason: str = "jammed") -> DeviceFaulted:
    return DeviceFaulted(scene=SCENE, kind=kind, device=1, reason=reason)


def refused(outcome) -> dict[str, Reason]:
    return {key: no.reason for key, no in outcome.decision.refused.items()}


def test_each_door_is_opened_on_its_own() -> None:
    outcome = given(plant()).when(ask(OpenDoors, scene=SCENE, doors=(1, 2, 7, 1), remark="post"))
    outcome.then(DoorOpenAsked(scene=SCENE, door=1, remark="post"))
    assert refused(outcome) == {"2": Reason.DEVICE_DISABLED, "7": Reason.DOOR_UNKNOWN}


@pytest.mark.parametrize("command", [OpenDoors, KeepDoorsOpen])
def test_a_door_that_does_not_work_is_not_asked_to_open(command: type) -> None:
    outcome = given(plant(), fault()).when(ask(command, scene=SCENE, doors=(1,)))
    assert not outcome.decision.events
    assert refused(outcome) == {"1": Reason.DEVICE_FAULTED}
    assert "jammed" in outcome.decision.refused["1"].message


def test_a_door_is_kept_open_once_and_let_go_once() -> None:
    held = DoorHeldOpen(scene=SCENE, door=1)
    given(plant()).when(ask(KeepDoorsOpen, scene=SCENE, doors=(1,))).then(held)
    given(plant(), held).when(ask(KeepDoorsOpen, scene=SCENE, doors=(1,))).nothing()
    let_go = ask(KeepDoorsOpen, scene=SCENE, doors=(1, 2), keep_open=False)
    given(plant(), held).when(let_go).then(DoorLetGo(scene=SCENE, door=1))
    given(plant()).when(let_go).nothing()


def test_closing_lets_go_and_is_always_news() -> None:
    held = DoorHeldOpen(scene=SCENE, door=1)
    closed = DoorCloseAsked(scene=SCENE, door=1)
    outcome = given(plant(), held, fault()).when(ask(CloseDoors, scene=SCENE, doors=(1,)))
    outcome.then(closed)
    given(plant()).when(ask(CloseDoors, scene=SCENE, doors=(1,))).then(closed)


def test_a_lift_is_kept_open_where_it_stops() -> None:
    held = LiftHeldOpen(scene=SCENE, lift=1, area=1)
    keep = ask(KeepLiftOpen, scene=SCENE, lift=1, area=1)
    given(plant()).when(keep).then(held)
    given(plant(), held).when(keep).nothing()
    elsewhere = ask(KeepLiftOpen, scene=SCENE, lift=1, area=2)
    given(plant()).when(elsewhere).rejected(Reason.LIFT_AREA_UNKNOWN)
    unknown = ask(KeepLiftOpen, scene=SCENE, lift=9, area=1)
    given(plant()).when(unknown).rejected(Reason.LIFT_UNKNOWN)
    given(plant(), fault(DeviceKind.LIFT)).when(keep).rejected(Reason.DEVICE_FAULTED)


def test_a_lift_is_let_go_once() -> None:
    let_go = ask(LetLiftGo, scene=SCENE, lift=1)
    held = LiftHeldOpen(scene=SCENE, lift=1, area=1)
    given(plant(), held).when(let_go).then(LiftLetGo(scene=SCENE, lift=1))
    given(plant()).when(let_go).nothing()
    unknown = ask(LetLiftGo, scene=SCENE, lift=9)
    given(plant()).when(unknown).rejected(Reason.LIFT_UNKNOWN)


def test_a_fault_is_news_when_its_reason_is_new() -> None:
    proposal = FaultDevice(scene=SCENE, kind=DeviceKind.DOOR, device=1, reason="jammed")
    given(plant()).when(proposal).then(fault())
    given(plant(), fault()).when(proposal).nothing()
    given(plant(), fault(reason="other")).when(proposal).then(fault())
    gone = FaultDevice(scene=SCENE, kind=DeviceKind.DOOR, device=9, reason="jammed")
    given(plant()).when(gone).rejected(Reason.DOOR_UNKNOWN)


def test_a_recovery_is_news_of_what_had_a_fault() -> None:
    proposal = RecoverDevice(scene=SCENE, kind=DeviceKind.DOOR, device=1)
    recovered = DeviceRecovered(scene=SCENE, kind=DeviceKind.DOOR, device=1)
    given(plant(), fault()).when(proposal).then(recovered)
    given(plant()).when(proposal).nothing()
