"""What robots report and the scheduler intends, on its way to the live view and the log."""

import asyncio
import threading
from collections.abc import Callable, Sequence
from typing import Protocol

import msgspec
import structlog

from fleetledger.config import Settings
from ledger.bus import Bus
from ledger.ids import RobotKey, SceneId, robot_key
from ledger.link import DoorReport, DoorState, LiftReport, Plan, Report, implausible
from ledger.telemetry import CHUNK_MS, DAY_MS, FILE_BYTES_MAX, TelemetryLog

log = structlog.get_logger()

QUEUE_MAX = 20_000  # messages not yet taken; beyond it new ones are dropped, for newer will come
FILES_MIN = 4  # of telemetry, that its limit of size is made of at least
WRITE_EVERY_S = 0.2  # at most five records a second and robot
# Reports are fetched so often: to be called for each of ten thousand a second, and to wake the
# event loop each time, cost as much as all the rest of the intake.
FETCH_S = 0.02
FETCH_IDLE_S = 0.1  # after a fetch that brought nothing
FETCH_MAX = 500  # of each kind before others on the event loop have their turn: a few milliseconds

_report = msgspec.json.Decoder(Report)
_plans = msgspec.json.Decoder(list[Plan])
_door_report: msgspec.json.Decoder[DoorReport | LiftReport] = msgspec.json.Decoder(DoorReport)
_lift_report: msgspec.json.Decoder[DoorReport | LiftReport] = msgspec.json.Decoder(LiftReport)
_door_states = msgspec.json.Decoder(list[DoorState])

DEVICE_KEYS = ("scenes/*/doors/*/report", "scenes/*/lifts/*/report", "scenes/*/doors")


class Log(Protocol):
    """The telemetry log, as far as this module needs it."""

    def write(self, reports: list[Report], now_ms: int | None = None) -> None:
        """Write reports."""

    def write_plans(self, plans: list[Plan], now_ms: int | None = None) -> None:
        """Write plans."""

    def close(self) -> None:
        """Finish the file."""


class NoLog:
    """The log where none is kept."""

    def write(self, reports: list[Report], now_ms: int | None = None) -> None:
        """Forget them."""

    def write_plans(self, plans: list[Plan], now_ms: int | None = None) -> None:
        """Forget them."""

    def close(self) -> None:
        """Do nothing."""


def telemetry_log(settings: Settings) -> Log:
    """Open the log as settings say, with files small enough for its limit to mean something."""
    keep_bytes = settings.telemetry_keep_mb * 10**6
    if keep_bytes == 0 or settings.telemetry_keep_days == 0:
        return NoLog()
    return TelemetryLog(
        settings.telemetry,
        chunk_ms=int(CHUNK_MS * max(1.0, settings.speed)),
        file_bytes_max=min(FILE_BYTES_MAX, keep_bytes // FILES_MIN),
        keep_ms=int(settings.telemetry_keep_days * DAY_MS),
        keep_bytes_max=keep_bytes,
    )


class Devices(Protocol):
    """Where news of doors and lifts goes; called on the event loop."""

    def observe(self, report: DoorReport | LiftReport) -> None:
        """Take in what a device reports."""

    def intend(self, scene: SceneId, states: Sequence[DoorState]) -> None:
        """Take in for whom the doors of a scene are open."""


class Intake:
    """Fetches messages and shows them on the event loop, logs them on a thread of its own."""

    def __init__(
        self,
        bus: Bus,
        loop: asyncio.AbstractEventLoop,
        telemetry: Log,
        observe: Callable[[Report], None],
        intend: Callable[[Plan], None],
        logged: Callable[[SceneId], bool] = lambda scene: True,
        devices: Devices | None = None,
        now_ms: Callable[[], int] | None = None,
    ) -> None:
        """Take where messages come from and where they go, and which scenes' are written down.

        `logged` is asked on the event loop for every message (robot_message_log_off). The log is
        told the time by `now_ms`; without, the newest report does, and a robot whose clock is wrong
        would say how old all files are.
        """
        self._loop = loop
        self._telemetry = telemetry
        self._observe = observe
        self._intend = intend
        self._logged = logged
        self._devices = devices
        self._now_ms: Callable[[], int | None] = now_ms or (lambda: None)
        self._lock = threading.Lock()
        self._device_raw: list[tuple[str, bytes]] = []  # key, payload
        self._woken = False
        self._reports: dict[RobotKey, Report] = {}  # to be logged, newest of each robot
        self._planned: dict[RobotKey, Plan] = {}
        self._stopped = threading.Event()
        self._writer = threading.Thread(target=self._write, name="telemetry", daemon=True)
        self._report = bus.collect("scenes/*/robots/*/report", QUEUE_MAX)
        self._plans = bus.collect("scenes/*/plans", QUEUE_MAX)
        self._fetching = loop.call_soon(self._fetch)
        for pattern in DEVICE_KEYS:
            bus.subscribe(pattern, self._device_heard)

    def start(self) -> None:
        """Begin to log."""
        self._writer.start()

    def _fetch(self) -> None:
        """Take all that came since, and come again."""
        logs: dict[SceneId, bool] = {}
        pause_s = FETCH_IDLE_S
        for take, fetch in ((self._take_report, self._report), (self._take_plans, self._plans)):
            for _ in range(FETCH_MAX):
                if (payload := fetch()) is None:
                    break
                pause_s = min(pause_s, FETCH_S)
                try:
                    take(payload, logs)
                except msgspec.DecodeError as trouble:
                    log.warning("message dropped", reason=str(trouble))
            else:
                pause_s = 0.0  # there may be more
        self._fetching = self._loop.call_later(pause_s, self._fetch)

    def _is_logged(self, scene: SceneId, logs: dict[SceneId, bool]) -> bool:
        if scene not in logs:
            logs[scene] = self._logged(scene)
        return logs[scene]

    def _take_report(self, payload: bytes, logs: dict[SceneId, bool]) -> None:
        report = _report.decode(payload)
        if (what := implausible(report)) is not None:
            log.warning("report dropped", robot=report.robot, reason=what)
            return
        self._observe(report)
        if self._is_logged(report.scene, logs):
            self._reports[robot_key(report.scene, report.robot)] = report

    def _take_plans(self, payload: bytes, logs: dict[SceneId, bool]) -> None:
        for plan in _plans.decode(payload):
            self._intend(plan)
            if self._is_logged(plan.scene, logs):
                self._planned[robot_key(plan.scene, plan.robot)] = plan

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
            raw, self._device_raw = self._device_raw, []
            self._woken = False
        self._take_devices(raw)

    def _write(self) -> None:
        while not self._stopped.wait(WRITE_EVERY_S):
            # the event loop may add while we take: one swap is atomic under the interpreter's lock
            reports, self._reports = self._reports, {}
            plans, self._planned = self._planned, {}
            try:
                if reports:
                    self._telemetry.write(list(reports.values()), self._now_ms())
                if plans:
                    self._telemetry.write_plans(list(plans.values()), self._now_ms())
            except Exception:  # telemetry may fail, the fleet goes on
                log.exception("telemetry not written")

    def stop(self) -> None:
        """Take nothing more, log what is left, and end; called on the event loop."""
        self._fetching.cancel()
        self._stopped.set()
        if self._writer.is_alive():
            self._writer.join(1.0)
