"""Doors and lifts that speak our own messages over the bus: simulated ones, and any adapter."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

import msgspec

from ledger.bus import Bus, door_tell_key, doors_key, lift_tell_key
from ledger.ids import SceneId
from ledger.link import DoorReport, DoorState, LiftReport, TellDoor, ToDevice

DOOR_REPORTS = "scenes/*/doors/*/report"
LIFT_REPORTS = "scenes/*/lifts/*/report"

DeviceReport: TypeAlias = DoorReport | LiftReport

_encoder = msgspec.json.Encoder()
_doors: msgspec.json.Decoder[DoorReport] = msgspec.json.Decoder(DoorReport)
_lifts: msgspec.json.Decoder[LiftReport] = msgspec.json.Decoder(LiftReport)


class DeviceLink(Protocol):
    """The way to the devices, and to those who look on."""

    def tell(self, scene: SceneId, message: ToDevice) -> None:
        """Send, or drop if the device is away: what matters is told again."""

    def show(self, scene: SceneId, states: Sequence[DoorState]) -> None:
        """Say for whom doors are open; doors that are not named are so for nobody."""


class NoDevices:
    """For sites where nothing is to be told."""

    def tell(self, scene: SceneId, message: ToDevice) -> None:
        """Drop it."""

    def show(self, scene: SceneId, states: Sequence[DoorState]) -> None:
        """Drop it."""


class BusDevices:
    """DeviceLink over the bus, with the callback through which devices are heard."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    def tell(self, scene: SceneId, message: ToDevice) -> None:
        """Publish under the device's own key."""
        if isinstance(message, TellDoor):
            key = door_tell_key(scene, message.door)
        else:
            key = lift_tell_key(scene, message.lift)
        self._bus.publish(key, _encoder.encode(message))

    def show(self, scene: SceneId, states: Sequence[DoorState]) -> None:
        """Publish for the core."""
        self._bus.publish(doors_key(scene), _encoder.encode(states))

    def hear(
        self,
        on_report: Callable[[DeviceReport], None],
        on_nonsense: Callable[[str, str], None],
    ) -> None:
        """Pass on reports, on the bus's own thread: the callbacks must only hand over.

        What cannot be read, or speaks for another device, goes to `on_nonsense` (key, reason).
        """

        def report(key: str, payload: bytes) -> None:
            try:
                heard = read_device_report(key, payload)
            except ValueError as wrong:
                on_nonsense(key, str(wrong))
            else:
                on_report(heard)

        self._bus.subscribe(DOOR_REPORTS, report)
        self._bus.subscribe(LIFT_REPORTS, report)


def read_device_report(key: str, payload: bytes) -> DeviceReport:
    """Decode a report; raises ValueError if it is none, or another device's than the key says."""
    _, scene, kind, id_, _ = key.split("/")
    # msgspec.ValidationError is a ValueError
    if kind == "doors":
        door = _doors.decode(payload)
        if (door.scene, str(door.door)) == (scene, id_):
            return door
    else:
        lift = _lifts.decode(payload)
        if (lift.scene, str(lift.lift)) == (scene, id_):
            return lift
    raise ValueError(f"the report of another device came under {key}")
