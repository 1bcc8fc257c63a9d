"""The simulator's role on the bus: its robots connect, listen and report exactly as real ones do.

A robot reports ten times a second while anything about it changes, and at rest as often as its
scene asks for (state_fetch_ms).
"""

from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import msgspec
import structlog

from ledger.bus import Bus, alive_key, report_key, tell_key
from ledger.events import AnyEvent
from ledger.events.robots import OfRobot, RobotReconfigured
from ledger.events.scenes import (
    SceneDisabled,
    SceneEnabled,
    SceneImported,
    SceneMapReplaced,
    SceneRemoved,
)
from ledger.evolve import evolve
from ledger.ids import RobotKey, SceneId, robot_key
from ledger.link import ToRobot
from ledger.state import Fleet, Robot
from sim.device_link import DeviceLink
from sim.devices import Devices
from sim.memory import Memory
from sim.world import World

log = structlog.get_logger()

REPORT_MS = 100
CATCH_UP_MS_MAX = 60_000  # longer gaps (a suspended machine) are not simulated
NO_ROOM_RETRY_MS = 10_000
INBOX_MAX = 20_000  # messages between two ticks; the oldest are lost beyond it

_COMING_AND_GOING = (OfRobot, SceneDisabled, SceneEnabled, SceneRemoved)


class Follower(Protocol):
    """The feed of events, as `ledger.feed.FeedFollower` gives it."""

    def start(self) -> Fleet:
        """Begin to follow, and give the state to evolve from."""

    def drain(self) -> Sequence[AnyEvent]:
        """Give the events since, in order and without a gap."""


class SimRole:
    """Keeps a world in step with the simulated, enabled robots of the fleet.

    With a `memory` path the world is saved before its reports go out, so that nobody has ever
    heard of a progress that a killed simulator does not remember: ground given up stays given up.
    The file outlives the process, not a power cut; then, as without it, robots are placed anew.
    """

    def __init__(
        self,
        bus: Bus,
        follower: Follower,
        world: World,
        *,
        memory: Path | None = None,
        report_ms: int = REPORT_MS,
    ) -> None:
        self._bus = bus
        self._follower = follower
        self._world = world
        self._devices = DeviceLink(bus, memory)
        self._memory = Memory(memory)
        self._report_ms = report_ms
        self._fleet = Fleet()
        self._inbox: deque[tuple[SceneId, bytes]] = deque(
            maxlen=INBOX_MAX
        )  # foreign threads append
        self._heard: set[RobotKey] = set()  # keys subscribed to, for ever
        self._tokens: dict[RobotKey, Callable[[], None]] = {}
        self._cut: set[RobotKey] = set()  # in the world, without a link
        self._resting: set[RobotKey] = set()  # will be back with their scenes
        self._refused: set[RobotKey] = set()  # there was no room for them
        self._retry_ms = 0
        self._now_ms: int | None = None
        self._report_due_ms = 0
        self._rest_due_ms: dict[SceneId, int] = {}  # when those at rest report again
        self._decoder: msgspec.json.Decoder[ToRobot] = msgspec.json.Decoder(ToRobot)
        self._encoder = msgspec.json.Encoder()

    def start(self, now_ms: int) -> None:
        """Remember the last run, and connect the robots that the fleet has."""
        self._now_ms = now_ms
        kept = self._memory.read()
        if kept is not None:
            try:
                self._world.load(kept)
            except (msgspec.DecodeError, ValueError) as error:
                log.warning("simulated robots are placed anew", reason=str(error))
        self._fleet = self._follower.start()
        self._connect(now_ms)
        self._devices.start(self._fleet, now_ms)

    @property
    def devices(self) -> Devices:
        """The doors and lifts."""
        return self._devices.devices

    def tick(self, now_ms: int) -> None:
        """Hear, let time pass up to now, and report. Call it as often as smoothness is wanted."""
        if self._now_ms is None:
            self.start(now_ms)
        self._follow(now_ms)
        self._hear()
        self._follow_links()
        dt_ms = min(now_ms - (self._now_ms or 0), CATCH_UP_MS_MAX)
        if dt_ms > 0:
            self._world.step(dt_ms / 1000)
            self._now_ms = now_ms
        self._devices.tick(self._fleet, now_ms)
        if now_ms >= self._report_due_ms:
            self._report_due_ms = now_ms - now_ms % self._report_ms + self._report_ms
            self._report(now_ms)

    def close(self) -> None:
        """Disconnect all robots, and save where they are."""
        if self._now_ms is not None:
            self._memory.save(self._world.save)
        for let_go in self._tokens.values():
            let_go()
        self._tokens.clear()

    def _follow(self, now_ms: int) -> None:
        robots_changed = False
        remapped: set[SceneId] = set()
        rebuilt: set[RobotKey] = set()  # perhaps of another group
        for event in self._follower.drain():
            evolve(self._fleet, event)
            if isinstance(event, SceneImported | SceneMapReplaced):
                remapped.add(event.scene)
            elif isinstance(event, RobotReconfigured):
                rebuilt.add(robot_key(event.scene, event.robot))
            robots_changed |= isinstance(event, _COMING_AND_GOING)
        for key, robot in self._wanted().items() if remapped or rebuilt else ():
            if robot.scene in remapped or (key in rebuilt and key in self._world):
                scene = self._fleet.scenes[robot.scene]
                if not self._world.remap(scene, robot.config, now_ms):
                    log.warning("no room for a simulated robot", robot=robot.name, scene=scene.id)
        if robots_changed or remapped or (self._refused and now_ms >= self._retry_ms):
            self._connect(now_ms)

    def _wanted(self) -> dict[RobotKey, Robot]:
        return {
            key: robot
            for key, robot in self._fleet.robots.items()
            if robot.config.simulated
            and not robot.config.disabled
            and not self._fleet.scenes[robot.scene].disabled
        }

    def _connect(self, now_ms: int) -> None:
        wanted = self._wanted()
        known = [*self._tokens, *self._cut, *self._resting]
        for key in [key for key in known if key not in wanted or key not in self._world]:
            self._forget(key)
            if key not in wanted:
                self._leave(key)
        self._refused &= wanted.keys()
        missing = [key for key in wanted if key not in self._tokens and key not in self._cut]
        for key in sorted(missing, key=lambda k: not self._world.remembers(k)):
            robot = wanted[key]
            if self._world.add(self._fleet.scenes[robot.scene], robot.config, now_ms):
                self._refused.discard(key)
                self._listen(key, robot)
            elif key not in self._refused:
                self._refused.add(key)
                log.warning("no room for a simulated robot", robot=robot.name, scene=robot.scene)
        self._retry_ms = now_ms + NO_ROOM_RETRY_MS

    def _forget(self, key: RobotKey) -> None:
        let_go = self._tokens.pop(key, None)
        if let_go is not None:
            let_go()
        self._cut.discard(key)
        self._resting.discard(key)

    def _leave(self, key: RobotKey) -> None:
        """Who rests with its whole scene will come back as it was; others are placed anew."""
        robot = self._fleet.robots.get(key)
        if robot is not None and robot.config.simulated and not robot.config.disabled:
            self._world.rest(key)
            self._resting.add(key)
        else:
            self._world.remove(key)

    def _follow_links(self) -> None:
        """A robot whose link is cut has no token; it gets one when the link stands again."""
        for key in [key for key in self._tokens if not self._world.is_linked(key)]:
            self._tokens.pop(key)()
            self._cut.add(key)
        for key in [key for key in self._cut if self._world.is_linked(key)]:
            self._cut.discard(key)
            robot = self._fleet.robots[key]
            self._tokens[key] = self._bus.live(alive_key(robot.scene, robot.name))

    def _listen(self, key: RobotKey, robot: Robot) -> None:
        scene = robot.scene
        if key not in self._heard:
            self._heard.add(key)
            self._bus.subscribe(
                tell_key(scene, robot.name),
                lambda _, payload: self._inbox.append((scene, payload)),
            )
        self._tokens[key] = self._bus.live(alive_key(scene, robot.name))

    def _hear(self) -> None:
        for _ in range(len(self._inbox)):
            scene, payload = self._inbox.popleft()
            try:
                message = self._decoder.decode(payload)
            except msgspec.DecodeError as error:
                log.warning("a robot was told nonsense", scene=scene, reason=str(error))
                continue
            self._world.tell(scene, message)

    def _report(self, now_ms: int) -> None:
        whole: set[SceneId] = set()
        for scene in self._fleet.scenes.values():
            if now_ms >= self._rest_due_ms.get(scene.id, 0):
                whole.add(scene.id)
                every_ms = max(scene.config.state_fetch_ms, 1)
                self._rest_due_ms[scene.id] = now_ms - now_ms % every_ms + every_ms
        reports = self._world.reports(now_ms, changed_only=True, whole=whole)
        if reports:
            self._memory.save(self._world.save)
        for report in reports:
            key = report_key(report.scene, report.robot)
            self._bus.publish(key, self._encoder.encode(report))
