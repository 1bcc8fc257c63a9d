"""Events of doors and lifts."""

from typing import TypeAlias

from ledger.events.base import Event
from ledger.state import DeviceKind


class DoorOpenAsked(Event, frozen=True, kw_only=True):
    """Someone had a door open once (`devices/doors/open-batch`); it closes by itself."""

    door: int
    remark: str = ""


class DoorCloseAsked(Event, frozen=True, kw_only=True):
    """Someone had a door close, held or not (`devices/doors/close-batch`)."""

    door: int
    remark: str = ""


class DoorHeldOpen(Event, frozen=True, kw_only=True):
    """Someone keeps a door open (`devices/doors/keep-open`)."""

    door: int
    remark: str = ""


class DoorLetGo(Event, frozen=True, kw_only=True):
    """A door need not stay open any more (`devices/doors/keep-open`)."""

    door: int
    remark: str = ""


class LiftHeldOpen(Event, frozen=True, kw_only=True):
    """Someone keeps a lift open at an area (`devices/lifts/keep-open`)."""

    lift: int
    area: int
    remark: str = ""


class LiftLetGo(Event, frozen=True, kw_only=True):
    """A lift may go its own ways again (`devices/lifts/cancel-open`)."""

    lift: int
    remark: str = ""


class DeviceFaulted(Event, frozen=True, kw_only=True):
    """A door or a lift reports a fault, or is not heard any more."""

    kind: DeviceKind
    device: int
    reason: str


class DeviceRecovered(Event, frozen=True, kw_only=True):
    """A faulted door or lift works again."""

    kind: DeviceKind
    device: int


DeviceEvent: TypeAlias = (
    DoorOpenAsked
    | DoorCloseAsked
    | DoorHeldOpen
    | DoorLetGo
    | LiftHeldOpen
    | LiftLetGo
    | DeviceFaulted
    | DeviceRecovered
)
