"""Simulated doors and lifts on the bus: they listen and report as real ones would.

Each reports at every change and once a second. With a memory their state is saved before a change
is reported, so that after a kill nobody has heard of a door that has forgotten being open.
"""

from collections import deque
from pathlib import Path

import msgspec
import structlog

from ledger.bus import Bus, door_report_key, lift_report_key
from ledger.ids import SceneId
from ledger.link import DoorReport, ToDevice
from ledger.scene import Scene
from ledger.state import Fleet
from sim.devices import Devices
from sim.memory import Memory

log = structlog.get_logger()

REPORT_MS = 1_000
TELLS = ("scenes/*/doors/*/tell", "scenes/*/lifts/*/tell")
INBOX_MAX = 20_000  # messages between two ticks; the oldest are lost beyond it


class DeviceLink:
    """Keeps the simulated devices in step with the scenes of the fleet."""

    def __init__(self, bus: Bus, memory: Path | None) -> None:
        """`memory` is the robots' file; that of the devices lies beside it."""
        self.devices = Devices()
        self._bus = bus
        self._memory = Memory(memory and memory.with_name(f"{memory.name}.devices"))
        self._inbox: deque[tuple[SceneId, bytes]] = deque(maxlen=INBOX_MAX)
        self._scenes: list[Scene] = []
        self._now_ms: int | None = None
        self._report_due_ms = 0
        self._decoder: msgspec.json.Decoder[ToDevice] = msgspec.json.Decoder(ToDevice)
        self._encoder = msgspec.json.Encoder()

    def start(self, fleet: Fleet, now_ms: int) -> None:
        """Remember the last run, and listen."""
        self._now_ms = now_ms
        kept = self._memory.read()
        if kept is not None:
            try:
                self.devices.load(kept)
            except (msgspec.DecodeError, ValueError) as error:
                log.warning("simulated doors begin closed", reason=str(error))
        self._follow(fleet)
        for pattern in TELLS:
            self._bus.subscribe(pattern, self._told)

    def _told(self, key: str, payload: bytes) -> None:
        self._inbox.append((SceneId(key.split("/")[1]), payload))  # on a foreign thread

    def tick(self, fleet: Fleet, now_ms: int) -> None:
        """Hear, let time pass up to now, and report."""
        if self._now_ms is None:
            self.start(fleet, now_ms)
        self._follow(fleet)
        self._hear()
        self.devices.step((now_ms - (self._now_ms or now_ms)) / 1000)
        self._now_ms = now_ms
        whole = now_ms >= self._report_due_ms
        if whole:
            self._report_due_ms = now_ms - now_ms % REPORT_MS + REPORT_MS
        self._report(now_ms, changed_only=not whole)

    def _follow(self, fleet: Fleet) -> None:
        scenes = list(fleet.scenes.values())
        known = self._scenes
        if len(scenes) != len(known) or any(a is not b for a, b in zip(scenes, known, strict=True)):
            self._scenes = scenes
            self.devices.follow(scenes)

    def _hear(self) -> None:
        for _ in range(len(self._inbox)):
            scene, payload = self._inbox.popleft()
            try:
                message = self._decoder.decode(payload)
            except msgspec.DecodeError as error:
                log.warning("a device was told nonsense", scene=scene, reason=str(error))
                continue
            self.devices.tell(scene, message)

    def _report(self, now_ms: int, *, changed_only: bool) -> None:
        changed = self.devices.reports(now_ms, changed_only=True)
        if changed:
            self._memory.save(self.devices.save)
        for report in changed if changed_only else self.devices.reports(now_ms):
            if isinstance(report, DoorReport):
                key = door_report_key(report.scene, report.door)
            else:
                key = lift_report_key(report.scene, report.lift)
            self._bus.publish(key, self._encoder.encode(report))
