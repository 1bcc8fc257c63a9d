"""What robots report and the scheduler intends, on its way to the live view and the log."""

import asyncio
import threading
from collections.abc import Callable, Sequence
from typing import Protocol

import msgspec
import structlog

from ledger.bus import Bus
from ledger.ids import SceneId
from ledger.link import DoorReport, DoorState, LiftReport, Plan, Report, implausible

log = structlog.get_logger()

QUEUE_MAX = 20_000  # messages not yet taken; beyond it new ones are dropped, for newer will come
WRITE_EVERY_S = 0.2  # at most five records a second and robot

_report = msgspec.json.Decoder(Report)
_plans = msgspec.json.Decoder(list[Plan])
_door_report: msgspec.json.Decoder[DoorReport | LiftReport] = msgspec.json.Decoder(DoorReport)
_lift_report: msgspec.json.Decoder[DoorReport | LiftReport] = msgspec.json.Decoder(LiftReport)
_door_states = msgspec.json.Decoder(list[DoorState])

DEVICE_KEYS = ("scenes/*/doors/*/report", "scenes/*/lifts/*/report", "scenes/*/doors")


class Log(Protocol):
    """The telemetry log, as far as this module needs it."""

    def write(self, reports: list[Report]) -> None:
        """Write reports."""

    def write_plans(self, plans: list[Plan]) -> None:
        """Write plans."""


class Devices(Protocol):
    """Where news of doors and lifts goes; called on the event loop."""

    def observe(self, report: DoorReport | LiftReport) -> None:
        """Take in what a device reports."""

    def intend(self, scene: SceneId, states: Sequence[DoorState]) -> None:
        """Take in for whom the doors of a scene are open."""


class Intake:
    """Takes messages on the bus's threads, shows them on the event loop, logs them on its own."""

    def __init__(
        self,
        bus: Bus,
        loop: asyncio.AbstractEventLoop,
        telemetry: Log,
        observe: Callable[[Report], None],
        intend: Callable[[Plan], None],
        logged: Callable[[SceneId], bool] = lambda scene: True,
        devices: Devices | None = None,
    ) -> None:
        """Take where messages come from and where they go, and which scenes' are written down.

        `logged` is asked on the event loop for every message (robot_message_log_off).
        """
        self._loop = loop
        self._telemetry = telemetry
        self._observe = observe
        self._intend = intend
        self._logged = logged
        self._devices = devices
        self._lock = threading.Lock()
        self._raw: list[tuple[bool, bytes]] = []  # is a report, payload
        self._device_raw: list[tuple[str, bytes]] = []  # key, payload
        self._woken = False
        self._reports: dict[str, Report] = {}  # to be logged, newest of each robot
        self._planned: dict[str, Plan] = {}
        self._stopped = threading.Event()
        self._writer = threading.Thread(target=self._write, name="telemetry", daemon=True)
        bus.subscribe("scenes/*/robots/*/report", lambda _, payload: self._heard(True, payload))
        bus.subscribe("scenes/*/plans", lambda _, payload: self._heard(False, payload))
        for pattern in DEVICE_KEYS:
            bus.subscribe(pattern, self._device_heard)

    def start(self) -> None:
        """Begin to log."""
        self._writer.start()

    def _heard(self, is_report: bool, payload: bytes) -> None:
        with self._lock:
            if len(self._raw) >= QUEUE_MAX:
                return
            self._raw.append((is_report, payload))
            wake, self._woken = not self._woken, True
        if wake:
            self._loop.call_soon_threadsafe(self._drain)

    def _device_heard(self, key: str, payload: bytes) -> None:
        with self._lock:
            if len(self._device_raw) >= QUEUE_MAX:
                return
            self._device_raw.append((key, payload))
            wake, self._woken = not self._woken, True
        if wake:
            self._loop.call_soon_threadsafe(self._drain)

    def _take_devices(self, raw: list[tuple[str, bytes]]) -> None:
        devices = self._devices
        for key, payload in raw if devices is not None else ():
            assert devices is not None
            _, scene, *of_device = key.split("/")
            try:
                if len(of_device) == 1:
                    devices.intend(SceneId(scene), _door_states.decode(payload))
                else:
                    kind = _door_report if of_device[0] == "doors" else _lift_report
                    devices.observe(kind.decode(payload))
            except msgspec.DecodeError as trouble:
                log.warning("message dropped", reason=str(trouble), key=key)

    def _drain(self) -> None:
        with self._lock:
            raw, self._raw = self._raw, []
            device_raw, self._device_raw = self._device_raw, []
            self._woken = False
        self._take_devices(device_raw)
        for is_report, payload in raw:
            try:
                if is_report:
                    report = _report.decode(payload)
                    if (what := implausible(report)) is not None:
                        log.warning("report dropped", robot=report.robot, reason=what)
                        continue
                    self._observe(report)
                    if self._logged(report.scene):
                        self._reports[f"{report.scene}/{report.robot}"] = report
                else:
                    for plan in _plans.decode(payload):
                        self._intend(plan)
                        if self._logged(plan.scene):
                            self._planned[f"{plan.scene}/{plan.robot}"] = plan
            except msgspec.ValidationError as trouble:
                log.warning("message dropped", reason=str(trouble), report=is_report)

    def _write(self) -> None:
        while not self._stopped.wait(WRITE_EVERY_S):
            # the event loop may add while we take: one swap is atomic under the interpreter's lock
            reports, self._reports = self._reports, {}
            plans, self._planned = self._planned, {}
            try:
                if reports:
                    self._telemetry.write(list(reports.values()))
                if plans:
                    self._telemetry.write_plans(list(plans.values()))
            except OSError as trouble:
                log.error("telemetry not written", reason=str(trouble))

    def stop(self) -> None:
        """Log what is left, and end."""
        self._stopped.set()
        if self._writer.is_alive():
            self._writer.join(1.0)
